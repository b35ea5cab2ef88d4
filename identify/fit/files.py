"""A fit on disk: JSON with a schema version, every number to full precision."""

import json
from dataclasses import asdict, fields
from pathlib import Path

import numpy as np

from identify.fit.result import Estimate, FitResult
from identify.fit.search import FitIteration
from identify.json_record import read_json_record
from identify.map.gaussian_map import GaussianMap
from identify.measurement.noise import Noise
from models import replaced

SCHEMA = 1

_ARRAYS = (
    "covariance", "press_index", "force_n", "displacement_m", "latent_force_n", "predicted_m",
    "sigma_m", "residual_m", "compliance_m_per_n", "compliance_jacobian", "discretization_error",
    "model_error", "derivative_m",
)  # fmt: skip


def write_fit(fit: FitResult, path: str | Path) -> None:
    """Write a fit as JSON."""
    content: dict = {"schema": SCHEMA}
    for field in fields(FitResult):
        value = getattr(fit, field.name)
        if field.name in ("estimates", "solution"):
            continue  # the first stands under parameters, the second stays in memory
        if field.name == "map":
            content["map"] = dict(zip(value.names, value.values.tolist(), strict=True))
            content["parameters"] = {name: asdict(e) for name, e in fit.parameters.items()}
        elif field.name == "history":
            content["history"] = [{**vars(i), "parameters": dict(i.parameters)} for i in value]
        elif field.name == "noise":
            content["noise"] = asdict(value)
        else:
            content[field.name] = value.tolist() if isinstance(value, np.ndarray) else value
    text = json.dumps(content, indent=1, allow_nan=False)
    with replaced(path) as beside:
        beside.write_text(text + "\n", encoding="utf-8")


def read_fit(path: str | Path) -> FitResult:
    """Read a fit that `write_fit` wrote; `InputError` for a newer schema or another file."""
    return read_json_record(path, "fit", "palpmap fit", SCHEMA, _fit)


def _fit(content: dict) -> FitResult:
    """Build the record from the JSON object."""
    values = {
        **content,
        "map": GaussianMap.from_values(np.array(list(content["map"].values()))),
        "estimates": {name: Estimate(**entry) for name, entry in content["parameters"].items()},
        "noise": Noise(**content["noise"]),
        "covariance_names": tuple(content["covariance_names"]),
        "history": tuple(FitIteration(**entry) for entry in content["history"]),
    }
    for name in _ARRAYS:
        if content.get(name) is not None:
            kind = np.int64 if name == "press_index" else float
            values[name] = np.array(content[name], dtype=kind)
    del values["parameters"]
    return FitResult(**values)
