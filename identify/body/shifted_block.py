"""Models of a block that lies elsewhere under the same presses.

Presses, map and study share one frame. The sides of a body beside its stated place are nearer to
some presses and further from others; the map below the presses stays. Only the sides of the mesh
are moved.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from fem import PalpationModel, RefinedModel
from fem.mesh import moved_sides
from identify.body.discretization_error import FineModel
from identify.body.settings import BODY, BodySettings
from identify.optimize.result import InadmissibleError

Shift = tuple[float, float]
_KEPT = 4  # coarse models, the last ones used, of 50 MB each: so many are at work at a time
_SIDES = {"x0", "x1", "y0", "y1"}


def room_m(
    points_m: np.ndarray, radius_m: np.ndarray, box_m: np.ndarray, settings: BodySettings = BODY
) -> np.ndarray:
    """Largest shifts of the body with all tips within its edges, (2, 2) m: x and y, -, +.

    Parameters
    ----------
    points_m, radius_m : (j, 3) and (j,) of the presses
    box_m : (2, 3) of the body
    """
    low = (points_m[:, :2] - radius_m[:, None]).min(axis=0) - box_m[0, :2]
    high = box_m[1, :2] - (points_m[:, :2] + radius_m[:, None]).max(axis=0)
    return settings.shift_room * np.maximum(np.column_stack([high, low]), 0.0)


def lagrange_weights(at: float, nodes: np.ndarray) -> np.ndarray:
    """Weights (n,) of the values at distinct nodes (n,) in Lagrange's polynomial.

    >>> lagrange_weights(0.5, np.array([0.0, 1.0, 2.0])).round(3).tolist()
    [0.375, 0.75, -0.125]
    """
    return np.array([np.prod([(at - b) / (a - b) for b in nodes if b != a]) for a in nodes])


@dataclass(frozen=True)
class ShiftedBlock:
    """Models of a block with its sides moved.

    Attributes
    ----------
    coarse, fine : of the block at its stated place, see `BodyMechanics`
    like : the same block under other presses, whose near fields serve where cells lie alike
    """

    coarse: PalpationModel
    fine: FineModel | None
    settings: BodySettings = BODY
    like: ShiftedBlock | None = None
    _models: dict[Shift, PalpationModel] = field(default_factory=dict)
    _fine: dict[Shift, tuple[PalpationModel, FineModel]] = field(default_factory=dict)

    def log_factor(
        self, shift_m: Shift, straight: bool, log_ratio: Callable[[Shift], np.ndarray]
    ) -> np.ndarray:
        """Logarithm (j,) of the compliance at a shift over that at none.

        Parameters
        ----------
        straight : take the chord to the nearest model on that side, for shifts up to it; half the
            work
        log_ratio : returns the same for shifts along x or y with a model
        """
        total = np.zeros(len(self.coarse.contacts))
        for axis, shift in enumerate(shift_m):
            if shift == 0:
                continue
            places = self._places(axis)
            beside = places[places * shift > 0][:1]
            if straight and abs(shift) <= abs(beside[0]):
                places, weights = beside, shift / beside
            else:
                places = places[np.argsort(np.abs(places - shift), kind="stable")[:2]]
                weights = lagrange_weights(shift, np.array([0.0, *places]))[1:]
            for weight, place in zip(weights, places, strict=True):
                total += weight * log_ratio((place, 0.0) if axis == 0 else (0.0, place))
        return total

    def _places(self, axis: int) -> np.ndarray:
        """Shifts of the models along an axis, the smallest first."""
        mesh, contacts = self.coarse.mesh, self.coarse.contacts
        if not mesh.surfaces.keys() >= _SIDES:
            raise InadmissibleError("only a block can lie elsewhere")
        box = mesh.box_m
        room = room_m(contacts.points_m, contacts.radius_m, box, self.settings)[axis]
        if room.min() < self.settings.least_shift_m:
            raise InadmissibleError("a tip stands at an edge of the body as the study states it")
        places = np.array(self.settings.shifts) * (box[1, axis] - box[0, axis])
        down, up = (np.unique(np.minimum(places, most)) for most in room)
        both = np.concatenate([-down, up])
        return both[np.argsort(np.abs(both), kind="stable")]

    def coarse_at(self, shift_m: Shift) -> PalpationModel:
        """Return the coarse model of the block elsewhere."""
        alike = self.like and self.like._models.get(shift_m)
        model = self._models.pop(shift_m, None) or _moved(self.coarse, shift_m, alike)
        self._models[shift_m] = model
        while len(self._models) > _KEPT:
            self._models.pop(next(iter(self._models)))
        return model

    def near(self, shift_m: Shift) -> Shift:
        """Return the nearest shift with a finer model; that of the model at hand, if it is near."""
        step = self.settings.shift_step_m
        for place in self._fine:
            if max(abs(a - b) for a, b in zip(place, shift_m, strict=True)) <= step:
                return place
        x, y = (step * round(shift / step) for shift in shift_m)
        return x, y

    def forget_fine(self) -> None:
        """Free the finer model of the body elsewhere, of 300 MB."""
        self._fine.clear()

    def fine_at(self, shift_m: Shift) -> tuple[PalpationModel, FineModel]:
        """Return the coarse and the finer model of the block elsewhere; the last are kept."""
        assert self.fine is not None
        if shift_m not in self._fine:
            self._fine.clear()
            coarse = _moved(self.coarse, shift_m)
            if isinstance(self.fine, RefinedModel):
                fine = RefinedModel(coarse, _moved(self.fine.fine, shift_m))
            else:
                fine = _moved(self.fine, shift_m)
            self._fine[shift_m] = coarse, fine
        return self._fine[shift_m]


def _moved(
    model: PalpationModel, shift_m: Shift, alike: PalpationModel | None = None
) -> PalpationModel:
    return (alike or model).on(moved_sides(model.mesh, shift_m), model.contacts)
