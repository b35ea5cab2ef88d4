"""Energies of fields with their near fields: by modulus sample, and as forces on a basis."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fem.linear.modulus_samples import CLOSE_SAMPLES, QuadraticModulus, at_rule
from fem.palpation.model import Material, PalpationModel, Response


class Fields(NamedTuple):
    """Displacement of every press: finite element part (3 f, j), near-field amplitudes (j, m)."""

    free: np.ndarray
    amplitude: np.ndarray

    @classmethod
    def of(cls, response: Response) -> Fields:
        """Return the fields of a full solution."""
        return cls(response._free, response.amplitude)

    def plus(self, other: Fields) -> Fields:
        """Return the sum."""
        return Fields(self.free + other.free, self.amplitude + other.amplitude)

    def times(self, factor: np.ndarray) -> Fields:
        """Return every press's field times its factor (j,)."""
        return Fields(self.free * factor, self.amplitude * factor[:, None])


def samples(material: Material) -> np.ndarray:
    """Modulus samples (p,) in which the energy is linear: of all cells, then of the close ones."""
    return np.concatenate([material.modulus, material.close.values.ravel()])


def positive_samples(material: Material) -> np.ndarray:
    """Modulus wherever an integration point carries positive energy, Pa."""
    return np.concatenate([material.modulus, at_rule(material.close.values).ravel()])


def by_sample(model: PalpationModel, fields: Fields) -> np.ndarray:
    """Twice the strain energy of every press's field at each of `samples` for E = 1, (j, p)."""
    count, close = len(model.stiffness.points_m), len(model.close_cells)
    unit = Material(
        np.ones(count),
        None,
        None,
        QuadraticModulus(np.ones((close, len(CLOSE_SAMPLES)))),
        np.ones(len(model.contacts)),
    )
    probe = Response(np.ones(len(model.contacts)), model, model._bonded, unit, *fields, None)
    return -probe.sensitivity[:, : -len(model.contacts)]


def forces(model: PalpationModel, material: Material, fields: Fields) -> Fields:
    """Return the forces that hold the fields in a body, (3 f, j) and (j, m)."""
    stiffness = model.stiffness
    field, amplitude = fields
    free = stiffness.product(model.values(model._bonded, material), field)
    near_field = np.zeros_like(amplitude)
    for group, near in model.near_fields(stiffness, material):
        free[:, group] += np.einsum("djm,jm->dj", near.coupling, amplitude[group])
        near_field[group] = np.einsum("djm,dj->jm", near.coupling, field[:, group])
        near_field[group] += np.einsum("jmn,jn->jm", near.energy, amplitude[group])
    return Fields(free, near_field)


def loads(model: PalpationModel) -> Fields:
    """Return the unit loads of every press, (3 f, j) and (j, m)."""
    none = np.zeros((len(model.contacts), 0))
    own = none if model.enrichment is None else model.enrichment.load
    return Fields(model._bonded.loads, own)


def dual_norm_squared(model: PalpationModel, reference: Material, residual: Fields) -> np.ndarray:
    """Square (j,) of a residual's dual norm r' K0^-1 r in the energy of a reference body, m/N.

    One factorisation; eliminated as in `fem.palpation.model`, with the residual for the load.
    """
    factor = model._bonded.pattern.factorize(model.values(model._bonded, reference))
    half = factor.forward(residual.free)
    result = np.einsum("dj,dj->j", half, half)
    for group, near in model.near_fields(model.stiffness, reference):
        k = near.coupling
        k = factor.forward(k.reshape(len(k), -1)).T.reshape(*k.shape[1:], -1)
        rest = residual.amplitude[group] - (k @ half[:, group].T[..., None])[..., 0]
        schur = near.energy - k @ k.swapaxes(1, 2)
        result[group] += np.sum(rest * np.linalg.solve(schur, rest[..., None])[..., 0], axis=1)
    return result
