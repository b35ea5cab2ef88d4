"""Snapshots of a reduced basis: full solutions, with what springs and skins ask of them."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from fem.palpation.fibres import HORIZONTAL, in_plane_projection
from fem.palpation.material import Material
from fem.palpation.model import Response
from fem.reduced.energies import Strains

_LEAST_SHARE = -0.9  # of the modulus along the fibres nothing is left at -1


class Law(NamedTuple):
    """Support, skin and fibres of a body.

    Attributes
    ----------
    springs : (normal, tangential) m/Pa under the base, None where it is bonded
    stretch_m : of the membrane, m
    share : of the fibres' modulus in the body's; not a number where it varies
    direction : (3,) of the fibres
    """

    springs: tuple[float, float] | None
    stretch_m: float
    share: float = 0.0
    direction: tuple[float, ...] = (1.0, 0.0, 0.0)

    @property
    def kind(self) -> tuple[bool, bool, bool]:
        """Whether there are springs, a membrane, and fibres."""
        return self.springs is not None, self.stretch_m > 0, self.share != 0

    @property
    def projection(self) -> np.ndarray:
        """T (3,) of the fibres on horizontal strains, see `fem.palpation.fibres`."""
        return in_plane_projection(np.array(self.direction[:2]))

    @property
    def is_reducible(self) -> bool:
        """Whether reduced bases know these fibres: one share, and in the horizontal plane."""
        in_plane = np.linalg.norm(HORIZONTAL @ self.direction) > 1 - 1e-12
        return self.share == 0 or bool(in_plane and self.share > _LEAST_SHARE)


class Snapshot:
    """Full solution at modulus samples (p,), in units of the first one's."""

    def __init__(self, response: Response, modulus: np.ndarray) -> None:
        self.modulus, self.law = modulus, law_of(response._material, response._springs)
        self._of = replace(response)  # without the sensitivities that are kept there

    def strains_inside(self) -> Strains:
        """Return the strains of the displacement of every press, made anew."""
        return Strains.of(self._of)

    @cached_property
    def inside(self) -> Strains:
        """These strains, kept: three times as large as the displacement."""
        return self.strains_inside()

    @property
    def _nodal(self) -> np.ndarray:
        """Displacement of every press, finite element part, (j, n, 3)."""
        return self._of._body.stiffness.prolong(self._of._free)

    @property
    def has_skin(self) -> bool:
        """Whether a skin counts in its compliance, be it as soft as to bear no stretching."""
        return self._of._material.skin is not None

    @cached_property
    def base(self) -> np.ndarray:
        """Displacement of the supported nodes, (j, b, 3)."""
        return self._nodal[:, self._of.model.floating.foundation.nodes]

    @cached_property
    def traction(self) -> np.ndarray:
        """Traction of the support on the body, (j, b, 3)."""
        return self._of.base_traction()

    @cached_property
    def strains(self) -> np.ndarray:
        """Strains of the surface that may bear a skin, see `fem.palpation.skin.Membrane`."""
        return self._of.model.floating.membrane.strains(self._nodal)


def law_of(material: Material, springs: tuple[float, float] | None) -> Law:
    """Return springs and membrane of a body with these springs under its base."""
    skin, stretch = material.skin, 0.0
    if skin is not None:
        stretch = skin.stretch_m
    if material.fibres is None:
        return Law(springs, stretch)
    direction, strength = material.fibres
    shares = strength / material.modulus
    share = shares[0] if np.ptp(shares) <= 1e-9 * np.abs(shares).max() else np.nan
    return Law(springs, stretch, float(share), tuple(map(float, direction)))


def modulus_samples(material: Material) -> np.ndarray | None:
    """Return the modulus samples (p,); None where a steep cell has others than were asked for."""
    if material.close.steep:
        return None
    return np.concatenate([material.modulus, material.close.asked.ravel()])
