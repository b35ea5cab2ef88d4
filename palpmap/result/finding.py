"""All that figures and report show of one run: fit, scan, comparison, truth, body, its making."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from identify.body.state import BodyState, ChangedMap
from identify.catalogue.catalogue import CATALOGUE
from identify.effects.base import BodyEffect
from identify.fit.result import FitResult
from identify.map.gaussian_map import GaussianMap, Inclusion
from identify.residual.comparison import Comparison
from models.errors import InputError
from models.scan import Scan
from palpmap.run_folder import read_record
from palpmap.study.study import Study


@dataclass(frozen=True)
class Outline:
    """The body's box and what of it is body.

    Attributes
    ----------
    lower_m, upper_m : (3,)
        Corners of the box, body frame, m.
    inside : callable
        Points (p, 3) -> (p,) bool, whether each lies in the body.
    """

    lower_m: np.ndarray
    upper_m: np.ndarray
    inside: Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Finding:
    """One fitted scan with its comparison; positions are in the body's frame.

    Attributes
    ----------
    name : str
        Name of the study.
    fit, scan, comparison :
        `scan` holds the readings that the fit used.
    outline : Outline
        The body.
    truth : GaussianMap or None
        The true map, of a virtual laboratory only.
    origin_m : (3,)
        Added to a position it gives the scan's own frame.
    stage_s : mapping
        Seconds that each stage took.
    how : mapping
        How the run was made: text by heading.
    limits : tuple of str
        What the reader must know of the limits.
    """

    name: str
    fit: FitResult
    scan: Scan
    comparison: Comparison
    outline: Outline
    truth: GaussianMap | None = None
    origin_m: np.ndarray = field(default_factory=lambda: np.zeros(3))
    stage_s: Mapping[str, float] = field(default_factory=dict)
    how: Mapping[str, str] = field(default_factory=dict)
    limits: tuple[str, ...] = ()

    @cached_property
    def map(self) -> ChangedMap:
        """The found map with what the fitted effects of the catalogue make of it."""
        low, high = (tuple(corner) for corner in (self.outline.lower_m, self.outline.upper_m))
        state = BodyState((low, high), poisson_ratio=0.0)  # no part of the modulus
        for effect in CATALOGUE:
            if not isinstance(effect, BodyEffect):
                continue
            named = {p.name: f"{effect.name}.{p.name}" for p in effect.parameters}
            if set(named.values()) <= set(self.fit.parameters):
                values = {p: self.fit.parameters[name].value for p, name in named.items()}
                state = effect.body(state, **values)
        return ChangedMap(self.fit.map, state)


def study_outline(study: Study) -> Outline:
    """Return the body's box; of a surface, also what lies inside it."""
    if study.body.size_m is not None:
        size = np.array(study.body.size_m)
        return Outline(np.zeros(3), size, lambda points: np.ones(len(points), dtype=bool))
    import pyvista

    surface: Any = pyvista.read(str(study.body.file))
    lower, upper = np.array(surface.bounds).reshape(3, 2).T

    def inside(points: np.ndarray) -> np.ndarray:
        distance = pyvista.PolyData(np.asarray(points)).compute_implicit_distance(surface)
        return np.asarray(distance["implicit_distance"]) <= 0

    return Outline(lower, upper, inside)


def read_truth(path: Path) -> GaussianMap:
    """Read the true map of a virtual laboratory: `body` with background and inclusions.

    Raises
    ------
    InputError
        The file is missing, is no JSON, or holds no such map.
    """
    body = read_record(path).get("body")
    try:
        inclusions = tuple(Inclusion(**i) for i in body["inclusions"])  # type: ignore[index]
        return GaussianMap(float(body["background_pa"]), inclusions)  # type: ignore[index]
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"{path}, key body: expected background_pa and inclusions with weight_pa, x_m, y_m, "
            f"z_m, radius_m ({error}); remove the file or write the run anew"
        ) from error


def matched(found: GaussianMap, truth: GaussianMap) -> dict[str, float]:
    """Return the truth's parameters under the names of the found inclusions nearest to them.

    Inclusions have no order of their own: each true one goes to the nearest found one that is
    still free.
    """
    values = {"background_pa": truth.background_pa}
    free = dict(enumerate(found.inclusions, start=1))
    for inclusion in truth.inclusions:
        if not free:
            break
        centre = np.array([inclusion.x_m, inclusion.y_m, inclusion.z_m])
        nearest = min(
            free, key=lambda i: np.linalg.norm(centre - (free[i].x_m, free[i].y_m, free[i].z_m))
        )
        del free[nearest]
        for name, value in vars(inclusion).items():
            values[f"inclusion_{nearest}.{name}"] = value
    return values
