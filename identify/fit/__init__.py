"""The fit of map and effects to a scan, with intervals."""

from identify.fit.files import read_fit, write_fit
from identify.fit.free_compliance_fit import FreeComplianceFit
from identify.fit.free_map.areas import Area
from identify.fit.free_map.field import Field, RegionEstimate
from identify.fit.free_map.field_evidence import Hyper
from identify.fit.free_map.settings import SPOTS
from identify.fit.free_map.spots import Spot
from identify.fit.free_map_fit import FreeMapIteration
from identify.fit.joint_fit import fit_jointly
from identify.fit.posterior import (
    Posterior,
    SampledParameter,
    draw_posterior,
    refuse_samples,
    refuse_without_arviz,
)
from identify.fit.result import Estimate, FitResult
from identify.fit.search import FitIteration
from identify.fit.settings import CONTACT_LAW
from identify.fit.start_map import fit_map

__all__ = [
    "CONTACT_LAW",
    "SPOTS",
    "Area",
    "Estimate",
    "Field",
    "FitIteration",
    "FitResult",
    "FreeComplianceFit",
    "FreeMapIteration",
    "Hyper",
    "Posterior",
    "RegionEstimate",
    "SampledParameter",
    "Spot",
    "draw_posterior",
    "fit_jointly",
    "fit_map",
    "read_fit",
    "refuse_samples",
    "refuse_without_arviz",
    "write_fit",
]
