"""Stiffness maps of soft bodies from robotic palpation: scan, fit, compare, explain.

    import palpmap as pm

    experiment = pm.read_study("study.toml")
    fit = pm.fit(experiment, inclusions=1)
    why = pm.explain(experiment)
    print(why.verdict)

Every name is loaded when it is first used, so that the import itself is quick.
"""

import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

from palpmap.version import __version__ as __version__

# numpy's own threads (OpenBLAS) go on spinning after each product, on the core that the sparse
# solver's next step waits for: on two cores everything took 1.8 times as long. Read when numpy is
# loaded, which comes later.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

if TYPE_CHECKING:
    from identify.catalogue import CATALOGUE
    from identify.effects import Advice, Effect, EffectParameter, WorkedExample
    from identify.effects.conformance import check_effect
    from identify.map import GaussianMap, Inclusion
    from models import (
        InputError,
        PressProgram,
        Scan,
        grid_program,
        join_scans,
        read_scan,
        write_scan,
    )
    from palpmap.api import (
        Comparison,
        Diagnosis,
        Explanation,
        FitResult,
        Limits,
        MapChange,
        Prediction,
        Run,
        compare,
        compare_runs,
        diagnose,
        explain,
        fit,
        limits,
        predict,
        read_run,
        scan,
    )
    from palpmap.experiment import Block, Experiment, FlatTip, Noise, Sphere, read_study
    from palpmap.export.mujoco import load_mujoco
    from palpmap.importing.importing import Imported, import_recording
    from palpmap.robot import Presses, Robot, assert_force_kept, assert_path_clear
    from palpmap.study.body import Body
    from palpmap.study.study import Study
    from sim.motion import ScanSettings
    from sim.robot import Mechanism

_HOMES = {
    "identify.catalogue.catalogue": ("CATALOGUE",),
    "identify.effects.base": ("Advice", "Effect", "EffectParameter", "WorkedExample"),
    "identify.effects.conformance.kit": ("check_effect",),
    "identify.map.gaussian_map": ("GaussianMap", "Inclusion"),
    "models.errors": ("InputError",),
    "models.press_program": ("PressProgram", "grid_program"),
    "models.scan": ("Scan",),
    "models.scan_file": ("read_scan", "write_scan"),
    "models.scan_join": ("join_scans",),
    "palpmap.api": (
        "Comparison", "Diagnosis", "Explanation", "FitResult", "Limits", "MapChange",
        "Prediction", "Run", "compare", "compare_runs", "diagnose", "explain", "fit",
        "limits", "predict", "read_run", "scan",
    ),
    "palpmap.experiment": ("Block", "Experiment", "FlatTip", "Noise", "Sphere", "read_study"),
    "palpmap.export.mujoco": ("load_mujoco",),
    "palpmap.importing.importing": ("Imported", "import_recording"),
    "palpmap.robot": ("Presses", "Robot", "assert_force_kept", "assert_path_clear"),
    "palpmap.study.body": ("Body",),
    "palpmap.study.study": ("Study",),
    "sim.motion.settings": ("ScanSettings",),
    "sim.robot.mechanism": ("Mechanism",),
}  # fmt: skip
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}

__all__ = [
    "CATALOGUE",
    "Advice",
    "Block",
    "Body",
    "Comparison",
    "Diagnosis",
    "Effect",
    "EffectParameter",
    "Experiment",
    "Explanation",
    "FitResult",
    "FlatTip",
    "GaussianMap",
    "Imported",
    "Inclusion",
    "InputError",
    "Limits",
    "MapChange",
    "Mechanism",
    "Noise",
    "Prediction",
    "PressProgram",
    "Presses",
    "Robot",
    "Run",
    "Scan",
    "ScanSettings",
    "Sphere",
    "Study",
    "WorkedExample",
    "__version__",
    "assert_force_kept",
    "assert_path_clear",
    "check_effect",
    "compare",
    "compare_runs",
    "diagnose",
    "explain",
    "fit",
    "grid_program",
    "import_recording",
    "join_scans",
    "limits",
    "load_mujoco",
    "predict",
    "read_run",
    "read_scan",
    "read_study",
    "scan",
    "write_scan",
]


def __getattr__(name: str) -> Any:
    home = _HOME_OF.get(name)
    if home is None:
        raise AttributeError(f"palpmap has no '{name}'; there are {', '.join(__all__)}")
    return getattr(import_module(home), name)


def __dir__() -> list[str]:
    return __all__
