"""A placed scan, the models of its body, its noise and the map's guesses: input of every fit."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from fem import Contacts, Mesh, PalpationModel, RefinedModel, Surface
from fem.contact import PressedSurface, surface_curvature
from identify.effects.base import Effect, Values
from identify.measurement.noise import Noise
from models import LabelVolume, Scan, thinned

Progress = Callable[[str], None]
"""Called with the step under way, in words."""

FEWEST_PRESSES = 2  # one alone leaves no residual to judge
_SAME_M, _SAME_DIRECTION = 1e-4, 1e-2  # presses that differ by less are repeats


def silent(text: str) -> None:
    """Report no progress."""


@dataclass(frozen=True)
class BodyModel:
    """Finite element models of one body under the presses of one scan.

    Attributes
    ----------
    search : quick, cruder than `coarse` and without the near field of the presses: starts are
        tried on it
    coarse : with near field and derivatives; the fit corrects it towards `fine`
    fine : of a block two meshes extrapolated, right to 0.2 to 1 %, see `RefinedModel`; of a closed
        surface the finer mesh as it is, where its facets are small beside the curve right to 0.2 %
        under a ball and 0.5 % under a flat tip, see `benchmarks/curved.py`. Meshes of one surface
        differ at random (each cuts its corners elsewhere), so that an extrapolation would add to
        the error. Under a free map, which no coarser mesh resolves, all three are one
    note : simplification of the contact, for the reader of a report; empty where there is none
    surface : of a body that is no block, which curves under its tips
    """

    search: PalpationModel
    coarse: PalpationModel
    fine: PalpationModel | RefinedModel
    note: str
    surface: Surface | None = None

    @property
    def _meshes(self) -> tuple[Mesh, ...]:
        fine = self.fine.fine if isinstance(self.fine, RefinedModel) else self.fine
        return tuple({id(m.mesh): m.mesh for m in (self.coarse, fine)}.values())

    def under(self, scan: Scan, most_m: float = np.inf) -> BodyModel:
        """Return the models on the same meshes, under the presses of another placed scan.

        `most_m` see `contacts_of`.
        """
        sphere = self.coarse.contacts.profile == "hertz"
        contacts, note = contacts_of(scan, sphere, self._meshes, self.surface, most_m)

        def pressed(model: PalpationModel) -> PalpationModel:
            return model.on(model.mesh, contacts)

        coarse = pressed(self.coarse)
        search = coarse if self.search is self.coarse else pressed(self.search)
        if self.fine is self.coarse:
            fine = coarse
        elif isinstance(self.fine, RefinedModel):
            fine = RefinedModel(coarse, pressed(self.fine.fine))
        else:
            fine = pressed(self.fine)
        return BodyModel(search, coarse, fine, note, self.surface)


def contacts_of(
    scan: Scan,
    sphere: bool,
    meshes: Sequence[Mesh] = (),
    surface: Surface | None = None,
    most_m: float = np.inf,
) -> tuple[Contacts, str]:
    """Return the presses as contacts of fixed size, and a note for the report.

    A sphere's contact grows with the load, through the one Hertz contact a = sqrt(R d) that the
    linear model gives each press: that at the press's largest depth, or at `most_m` in a deeper
    one, since a fit's model of a press deeper than its own is that of its own. Beside an inclusion
    the law of a contact half as deep, followed that far, was 2.7 % off at the largest force. Where
    it hangs over the edge of one of the `meshes`, half the depth is taken.
    """
    points, directions, radii = scan.contact_points, scan.contact_directions, scan.contact_radii
    if not sphere:
        return _curved(Contacts(points, directions, radii), surface), ""
    deepest = np.zeros(len(points))
    np.maximum.at(deepest, scan.press_index, scan.displacement_m)
    deepest = np.minimum(deepest, most_m)
    typical = np.maximum(deepest, 0.1 * np.median(deepest[deepest > 0]))
    contact = np.minimum(np.sqrt(radii * typical), radii)
    for mesh in meshes:
        borne = PressedSurface(mesh).bears(Contacts(points, directions, contact, "hertz"))
        contact = np.where(borne, contact, np.minimum(np.sqrt(radii * typical / 2), radii))
    note = (
        "The tip is a sphere: the finite elements have the contact of the largest depth (radius "
        f"{1e3 * contact.min():.2g} to {1e3 * contact.max():.2g} mm), and it grows with the force."
    )
    return _curved(Contacts(points, directions, contact, "hertz"), surface), note


def _curved(contacts: Contacts, surface: Surface | None) -> Contacts:
    """Return contacts that know the curvature of a closed surface under them."""
    if surface is None:
        return contacts
    return replace(contacts, curvature_per_m=surface_curvature(surface, contacts))


@dataclass(frozen=True)
class FieldGuess:
    """Length (m) and spread of a free map's prior; None is found by evidence.

    Its smoothness is that of a Matern field, 0.5, which None is, or 1.5. `regions`, in the body's
    frame, have a level each.
    """

    length_m: float | None = None
    spread: float | None = None
    smoothness: float | None = None
    regions: LabelVolume | None = None


@dataclass(frozen=True)
class MapGuess:
    """Number of inclusions, first guesses and fixed values by parameter name, body frame.

    With a `field` the map is free and has no inclusions. `either`: or has, as the evidence says.
    """

    inclusions: int | Literal["auto"] = 1
    initial: Mapping[str, float] = field(default_factory=dict)
    fixed: Mapping[str, float] = field(default_factory=dict)
    field: FieldGuess | None = None
    either: bool = False

    @property
    def unknowns(self) -> int:
        """Number of free parameters of the map; of "auto" the least, of a free one its level."""
        if self.field is not None:
            return 1
        number = 0 if self.inclusions == "auto" else self.inclusions
        return 1 + 5 * number - len(self.fixed)


@dataclass(frozen=True)
class PlacedExperiment:
    """A placed scan and its models.

    Attributes
    ----------
    scan : readings in the body's frame
    body : finite element models under the scan's presses
    noise : of both readings
    map : guesses of the map
    effects : effects of the model from the start, with values to start from (may be empty)
    origin_m : (3,) added to a position it gives the scan's own frame, m
    onto_another_shape : a block stands in for a body of clearly another shape
    whole : every press as measured and as placed, where `scan` is a part of them
    say : progress
    """

    scan: Scan
    body: BodyModel
    noise: Noise
    map: MapGuess = MapGuess()
    effects: tuple[tuple[Effect, Values], ...] = ()
    origin_m: np.ndarray = field(default_factory=lambda: np.zeros(3))
    onto_another_shape: bool = False
    whole: tuple[Scan, Scan] | None = None
    say: Progress = silent

    @property
    def left_out(self) -> int:
        """Number of presses beyond the most that are used."""
        every = self.scan if self.whole is None else self.whole[0]
        return len(every.press_ids) - len(self.scan.press_ids)

    @property
    def is_determined(self) -> bool:
        """Whether the different presses are as many as the map's unknowns."""
        presses = different_presses(self.scan.used())
        enough = len(self.scan.used().press_ids) >= FEWEST_PRESSES
        return enough and presses >= self.map.unknowns

    def without(self, presses: tuple[int, ...], refill: bool = True) -> PlacedExperiment:
        """Return the experiment without some presses (ids), on the same meshes, with its noise.

        Parameters
        ----------
        refill : take others of the `whole` scan in their place
        """
        whole = self.whole
        if whole is not None and refill:
            measured, placed = (each.rows(~np.isin(each.press, presses)) for each in whole)
            whole = (measured, placed)
            scan = placed.rows(np.isin(placed.press, thinned(measured).press_ids))
        else:
            scan = self.scan.rows(~np.isin(self.scan.press, presses))
        return replace(self, scan=scan, body=self.body.under(scan.used()), whole=whole)


def different_presses(scan: Scan) -> int:
    """Return the number of presses that differ in place, direction or tip radius."""
    kinds = np.column_stack(
        [
            scan.contact_points / _SAME_M,
            scan.contact_directions / _SAME_DIRECTION,
            scan.contact_radii / _SAME_M,
        ]
    )
    return len(np.unique(np.rint(kinds), axis=0))
