"""Strain energies of fields with their near fields, by modulus sample, and their sums."""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from fem.linear.modulus_samples import CLOSE_SAMPLES, QuadraticModulus
from fem.palpation.model import Material, PalpationModel, Response


class Fields(NamedTuple):
    """Displacement of every press: finite element part (3 f, j), near-field amplitudes (j, m).

    The supported surface is free in all of them, so that fields of a bonded body and of one on
    springs can be added.
    """

    free: np.ndarray
    amplitude: np.ndarray

    @classmethod
    def of(cls, response: Response) -> Fields:
        """Return the fields of a full solution."""
        nodal = response._body.stiffness.prolong(response._free)
        return cls(response.model.floating.stiffness.restrict(nodal), response.amplitude)

    def plus(self, other: Fields) -> Fields:
        """Return the sum."""
        return Fields(self.free + other.free, self.amplitude + other.amplitude)

    def nodal(self, model: PalpationModel) -> np.ndarray:
        """Return the finite element part at the nodes, (j, n, 3)."""
        return model.floating.stiffness.prolong(self.free)


def by_sample(model: PalpationModel, fields: Fields) -> np.ndarray:
    """Twice the strain energy of every press's field at each modulus sample for E = 1, (j, p).

    The samples are those of all cells, then those of the close ones: the model's `points_m` without
    the contact points.
    """
    count, close = len(model.stiffness.points_m), len(model.close_cells)
    unit = Material(
        np.ones(count),
        None,
        None,
        QuadraticModulus(np.ones((close, len(CLOSE_SAMPLES)))),
        np.ones(len(model.contacts)),
    )
    probe = Response(np.ones(len(model.contacts)), model, model.floating, unit, *fields, None)
    return -probe.sensitivity[:, : -len(model.contacts)]


@numba.njit(cache=True, fastmath=True)
def summed(energies, fields):
    """Return the sums (j, k) of energies (j, p), in single precision, over fields (k, p)."""
    presses, samples = energies.shape
    count = len(fields)
    result = np.zeros((presses, count))
    for j in range(presses):
        for k in range(count):
            total = 0.0
            for p in range(samples):
                total += energies[j, p] * fields[k, p]
            result[j, k] = total
    return result
