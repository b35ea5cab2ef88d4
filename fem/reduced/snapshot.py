"""Snapshots of a reduced basis: full solutions, with what springs and skins ask of them."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from fem.palpation.model import Material, Response
from fem.reduced.energies import Fields


class Law(NamedTuple):
    """Springs (normal, tangential) m/Pa under the base, None where it is bonded; membrane (m)."""

    springs: tuple[float, float] | None
    stretch_m: float

    @property
    def kind(self) -> tuple[bool, bool]:
        """Whether there are springs, and whether there is a membrane."""
        return self.springs is not None, self.stretch_m > 0


class Snapshot:
    """Full solution at modulus samples (p,), in units of the first one's."""

    def __init__(self, response: Response, modulus: np.ndarray) -> None:
        self.modulus, self.law = modulus, law_of(response._material, response._springs)
        self._of = replace(response)  # without the sensitivities that are kept there

    @property
    def fields(self) -> Fields:
        """The displacement of every press."""
        return Fields.of(self._of)

    @property
    def has_skin(self) -> bool:
        """Whether a skin counts in its compliance, be it as soft as to bear no stretching."""
        return self._of._material.skin is not None

    @cached_property
    def base(self) -> np.ndarray:
        """Displacement of the supported nodes, (j, b, 3)."""
        model = self._of.model
        return self.fields.nodal(model)[:, model.floating.foundation.nodes]

    @cached_property
    def traction(self) -> np.ndarray:
        """Traction of the support on the body, (j, b, 3)."""
        return self._of.base_traction()

    @cached_property
    def strains(self) -> np.ndarray:
        """Strains of the surface that may bear a skin, see `fem.palpation.skin.Membrane`."""
        model = self._of.model
        return model.floating.membrane.strains(self.fields.nodal(model))


def law_of(material: Material, springs: tuple[float, float] | None) -> Law:
    """Return springs and membrane of a body with these springs under its base."""
    return Law(springs, 0.0 if material.skin is None else material.skin.stretch_m)


def modulus_samples(material: Material) -> np.ndarray | None:
    """Return the modulus samples (p,); None where a steep cell has others than were asked for."""
    if material.close.steep:
        return None
    return np.concatenate([material.modulus, material.close.asked.ravel()])
