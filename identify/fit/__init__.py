"""The fit of map and effects to a scan, with intervals."""

from identify.fit.files import read_fit, write_fit
from identify.fit.free_compliance import FreeComplianceFit
from identify.fit.joint_fit import fit_jointly
from identify.fit.result import Estimate, FitResult
from identify.fit.search import FitIteration
from identify.fit.start_map import fit_map

__all__ = [
    "Estimate",
    "FitIteration",
    "FitResult",
    "FreeComplianceFit",
    "fit_jointly",
    "fit_map",
    "read_fit",
    "write_fit",
]
