"""A fit on disk: JSON with a schema version, every number to full precision."""

import json
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np

from identify.fit.free_map.areas import Area
from identify.fit.free_map.field import Field, Finds, RegionEstimate
from identify.fit.free_map.field_evidence import GRADUAL, Hyper
from identify.fit.free_map.spots import Spot
from identify.fit.posterior import Posterior, SampledParameter
from identify.fit.result import Estimate, FitResult
from identify.fit.search import FitIteration
from identify.map import FreeMap, GaussianMap, Grid, LabelledGrid
from identify.measurement.noise import Noise
from models import InputError, LabelVolume, replaced

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
        if field.name in ("estimates", "solution", "field"):
            continue  # the first stands under parameters, the second stays in memory
        if field.name == "map":
            content["map"] = _map_content(value)
            content["parameters"] = {name: asdict(e) for name, e in fit.parameters.items()}
        elif field.name == "history":
            content["history"] = [_step_content(step) for step in value]
        elif field.name == "noise":
            content["noise"] = asdict(value)
        elif field.name == "posterior":
            content["posterior"] = None if value is None else value.to_dict()
        else:
            content[field.name] = value.tolist() if isinstance(value, np.ndarray) else value
    content["field"] = None if fit.field is None else _field_content(fit.field)
    text = json.dumps(content, indent=1, allow_nan=False)
    with replaced(path) as beside:
        beside.write_text(text + "\n", encoding="utf-8")


def read_fit(path: str | Path) -> FitResult:
    """Read a fit that `write_fit` wrote.

    Raises
    ------
    InputError
        The file is missing, is no such record, or was written by a newer version.
    """
    try:
        content = json.loads(Path(path).read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise InputError(
            f"{path}: not a readable fit ({error}); `palpmap fit` writes it"
        ) from error
    found = content.pop("schema", None) if isinstance(content, dict) else None
    if not isinstance(found, int):
        raise InputError(f"{path}: no 'schema' number found, expected a fit of palpmap")
    if found > SCHEMA:
        raise InputError(
            f"{path}: written with schema {found}, this palpmap reads up to {SCHEMA}; "
            "update palpmap"
        )
    try:
        return _fit(content)
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"{path}: damaged fit, cannot use {error}; `palpmap fit` writes it anew"
        ) from error


def _fit(content: dict) -> FitResult:
    """Build the record from the JSON object."""
    values = {
        **content,
        "map": _map(content["map"]),
        "field": _field(content["field"]) if content.get("field") else None,
        "estimates": {name: Estimate(**entry) for name, entry in content["parameters"].items()},
        "noise": Noise(**content["noise"]),
        "posterior": _posterior(content["posterior"]) if content.get("posterior") else None,
        "covariance_names": tuple(content["covariance_names"]),
        "history": tuple(FitIteration(**entry) for entry in content["history"]),
        "at_bound": tuple(content.get("at_bound", ())),
    }
    for name in _ARRAYS:
        if content.get(name) is not None:
            kind = np.int64 if name == "press_index" else float
            values[name] = np.array(content[name], dtype=kind)
    del values["parameters"]
    return FitResult(**values)


def _posterior(content: dict) -> Posterior:
    marginal = {name: SampledParameter(**p) for name, p in content["parameters"].items()}
    return Posterior(**{**content, "parameters": marginal})


def _map_content(stiffness: GaussianMap) -> dict:
    if isinstance(stiffness, FreeMap):
        grid = stiffness.grid
        content = {"grid": {f.name: getattr(grid, f.name) for f in fields(Grid)}}
        if isinstance(grid, LabelledGrid):
            content["regions"] = grid.regions.to_dict()
        return content | {"log_pa": stiffness.log_pa.tolist()}
    return dict(zip(stiffness.names, stiffness.values.tolist(), strict=True))


def _map(content: dict) -> GaussianMap:
    if "grid" not in content:
        return GaussianMap.from_values(np.array(list(content.values())))
    grid = Grid(**{name: tuple(value) for name, value in content["grid"].items()})
    if regions := content.get("regions"):
        grid = LabelledGrid(
            grid.lower_m, grid.spacing_m, grid.counts, LabelVolume.from_dict(regions)
        )
    return FreeMap(grid, np.array(content["log_pa"], float))


def _step_content(step: FitIteration) -> dict:
    known = {field.name: getattr(step, field.name) for field in fields(FitIteration)}
    return known | {"parameters": dict(step.parameters)}


_LIVE = ("posterior", "sought")  # parts of a field that stay in memory


def _field_content(field: Field) -> dict:
    found = {f.name: getattr(field, f.name) for f in fields(Field) if f.name not in _LIVE}
    found |= {"slips": field.slips, "ball_sight_m": field.ball_sight_m}
    found = {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in found.items()}
    return found | {"hyper": asdict(field.hyper), "spots": [asdict(s) for s in field.spots],
                    "areas": [asdict(a) for a in field.areas],
                    "regions": [asdict(r) for r in field.regions]}  # fmt: skip


def _field(content: dict) -> Field:
    hyper, named = content["hyper"], dict(content)
    finds = Finds(
        tuple(Spot(**spot) for spot in named.pop("spots")),
        np.array(named.pop("slips", ()), float),
        named.pop("ball_sight_m", 0.0),
        tuple(Area(**area) for area in named.pop("areas", ())),
    )
    arrays = ("log_sd", "share", "by_press_m", "followed", "press_error", "left_out")
    found: dict[str, Any] = {
        **named,
        # Runs from before the name had the other prior
        "hyper": Hyper(**{"smoothness": GRADUAL, **hyper, "given": tuple(hyper["given"])}),
        "sought": lambda: finds,
        "regions": tuple(RegionEstimate(**region) for region in content.get("regions", ())),
    }
    for name in arrays:
        found[name] = np.array(content[name], float)
    found["errs"] = np.array(content["errs"], bool)
    found["lengths_m"] = tuple(content["lengths_m"])
    return Field(**found)
