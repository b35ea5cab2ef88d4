"""Compliance of every press, with bounds, in a reduced basis of its own.

The field of press j is sought among full solutions at a few modulus fields E_a, the snapshots:
u = sum_a y_a u_a, near fields included. With the energies e_ab of pairs of them at the modulus
samples p (for E = 1), and the snapshots' compliances C_a = B'u_a, the Galerkin solution is

    G_ab = sum_p e_ab,p E_p,    G y = (C_a),    C_low = sum_a y_a C_a,    dC/dE_p = -y'e_p y.

The stresses E_a e(u_a) of the snapshots balance the load, and so does any sum of them with weights
g_a that add up to one. The theorem of least complementary energy then gives the other side,

    H_ab = sum_p e_ab,p E_a,p E_b,p / E_p,    C_high = min g'H g = 1 / (1'H^-1 1),

so that the full model's compliance lies between both without any factorisation. Their difference is
the energy of both errors together, of second order in the distance from the snapshots. The bounds
are strict where the samples carry positive energies, which those of the quadratic course of the
modulus around a tip and of the near field need not: their part of the energy is small. Energies are
kept in single precision, so that bounds below 1e-6 mean nothing.

Both matrices are linear in a field, E or 1/E. A new field joins the span of those asked for before
(`_Modes`), at the cost of one pass over the energies; in the span, an evaluation takes about a
millisecond.

Sources: Rozza, Huynh, Patera, Arch. Comput. Methods Eng. 15 (2008) 229 (reduced basis); Ladeveze,
Leguillon, SIAM J. Numer. Anal. 20 (1983) 485 (error in constitutive relation).
"""

from __future__ import annotations

import weakref
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fem.errors import SolverError
from fem.palpation.model import Material, PalpationModel, Response
from fem.reduced.energies import Fields, by_sample, summed

FAR = 3e-3  # relative bound beyond which a solution begins a basis of its own
_BASES = 3  # the last ones that served
_BYTES = 64e6  # of a basis's energies
_MOST = 10  # snapshots of a basis: more are not worth their growth
SPANNED = 1e-6  # of a compliance: first-order error by the part of a field beyond the span
_SPANNED_SLOPE = 1e-3  # ... of a derivative, relative to itself
_RIDGE = 1e-9  # of a matrix's diagonal: keeps both bounds on their side, and the solves stable


class _Snapshot(NamedTuple):
    """Full solution at modulus samples (p,), in units of the first one's."""

    fields: Fields
    modulus: np.ndarray
    compliance: np.ndarray


class _Modes:
    """Span of the fields asked for so far, with the sums of each pair's energies over its modes.

    Parameters
    ----------
    root : (p,) root of each sample's weight
    factor : of two snapshots, on the fields (p,)
    """

    def __init__(
        self, root: np.ndarray, factor: Callable[[_Snapshot, _Snapshot], np.ndarray | float]
    ) -> None:
        self._root, self._factor = root, factor
        self._modes = np.zeros((0, len(root)))  # (q, p), orthonormal, of fields times root
        self.sums: dict[tuple[int, int], np.ndarray] = {}  # (j, q) of each pair of snapshots

    def __len__(self) -> int:
        return len(self._modes)

    def coefficients(self, fields: np.ndarray, tolerance: np.ndarray, pairs: _Pairs) -> np.ndarray:
        """Coefficients (k, q) of fields (k, p); those beyond the span by more than (k,) join it."""
        scaled = fields * self._root
        found = scaled @ self._modes.T
        left = np.sum(scaled**2, axis=1) - np.sum(found**2, axis=1)
        new = []
        for field, beyond, most in zip(scaled, left, tolerance, strict=True):
            if beyond <= most**2:
                continue
            for _ in range(2):  # twice is enough
                for others in (self._modes, *(mode[None] for mode in new)):
                    field = field - (others @ field) @ others
            length = float(np.linalg.norm(field))
            if length > most:
                new.append(field / length)
        if not new:
            return found
        joined = np.array(new)
        self._modes = np.vstack([self._modes, joined])
        for key, (first, second, energies) in pairs.items():
            columns = joined / self._root * self._factor(first, second)
            self.sums[key] = np.hstack([self.sums[key], summed(energies, columns)])
        return scaled @ self._modes.T

    def add(self, key: tuple[int, int], first: _Snapshot, second: _Snapshot, exact) -> None:
        """Sum the energies (j, p) of a new pair over the modes."""
        self.sums[key] = exact @ (self._modes / self._root * self._factor(first, second)).T


_Pairs = dict[tuple[int, int], tuple[_Snapshot, _Snapshot, np.ndarray]]


class ReducedModel:
    """A palpation model in a basis for each press, from full solutions as they come.

    Of bodies on a bonded support, without fibres and skin.

    Parameters
    ----------
    full : the model
    most : largest number of snapshots; the one that has gone unused for longest makes place
    """

    def __init__(self, full: PalpationModel, most: int = _MOST) -> None:
        if not full.support.bonded:
            raise SolverError("a reduced model needs a bonded support; take the full model")
        self.full, self._most = full, most
        self._snapshots: dict[int, _Snapshot] = {}  # by number
        self._used: dict[int, int] = {}  # evaluation in which each one last counted
        self._pairs: _Pairs = {}
        self._next = self._evaluations = 0
        self.served = False  # any search

    def __len__(self) -> int:
        return len(self._snapshots)

    def add(self, response: Response) -> None:
        """Add a full solution to every basis."""
        modulus = _samples(response._material)
        if modulus is None:
            return
        field = Fields.of(response)
        alone = -response.sensitivity[:, : len(modulus)]
        if not self._snapshots:
            self._unit = modulus
            weight = (alone / response.compliance[:, None]).sum(axis=0) * modulus
            root = np.sqrt(np.maximum(weight, 1e-6 * weight.mean()))
            self._primal = _Modes(root, lambda a, b: modulus)
            self._dual = _Modes(root, lambda a, b: modulus * a.modulus * b.modulus)
        while len(self._snapshots) >= self._most:
            self._drop(min(self._used, key=lambda number: self._used[number]))
        new = _Snapshot(field, modulus / self._unit, np.array(response.compliance))
        number, self._next = self._next, self._next + 1
        energies = {number: alone}
        for other, known in self._snapshots.items():
            both = by_sample(self.full, field.plus(known.fields))
            own = self._pairs[other, other][2]
            energies[other] = 0.5 * (both - alone - own)
        self._snapshots[number] = new
        self._used[number] = self._evaluations
        for other, mixed in energies.items():
            key = (other, number)
            first = self._snapshots[other]
            self._pairs[key] = (first, new, mixed.astype(np.float32))
            for modes in (self._primal, self._dual):
                modes.add(key, first, new, mixed)

    def _drop(self, number: int) -> None:
        """Forget a snapshot."""
        del self._snapshots[number], self._used[number]
        for key in [key for key in self._pairs if number in key]:
            del self._pairs[key], self._primal.sums[key], self._dual.sums[key]

    def evaluate(self, modulus_pa: np.ndarray) -> ReducedResponse | None:
        """Solve for all presses and a modulus (p,) at the full model's `points_m`, Pa.

        None before the first snapshot, and where the modulus is too steep for a cell around a tip.
        """
        if not self._snapshots:
            return None
        modulus = _samples(self.full.material(modulus_pa))
        if modulus is None:
            return None
        relative = modulus / self._unit
        spanned = np.array([SPANNED])
        primal = self._primal.coefficients(relative[None], spanned, self._pairs)[0]
        dual = self._dual.coefficients(1 / relative[None], spanned, self._pairs)[0]
        stiffness = self._matrix(self._primal, primal)
        load = np.array([s.compliance for s in self._snapshots.values()]).T
        weights = _solved(stiffness, load)
        low = np.einsum("ja,ja->j", weights, load)
        flexibility = self._matrix(self._dual, dual)
        high = 1 / _solved(flexibility, np.ones_like(load)).sum(axis=1)
        self._evaluations += 1
        nearest = max(zip(np.abs(weights).max(axis=0), self._snapshots, strict=True))[1]
        self._used[nearest] = self._evaluations
        low.setflags(write=False)
        return ReducedResponse(low, high, weights, weakref.ref(self), tuple(self._snapshots))

    def _matrix(self, modes: _Modes, coefficients: np.ndarray) -> np.ndarray:
        """Matrix (j, m, m) of all snapshots for coefficients (q,) of the field."""
        place = {number: index for index, number in enumerate(self._snapshots)}
        size = len(place)
        result = np.empty((len(self.full.contacts), size, size))
        for (a, b), sums in modes.sums.items():
            result[:, place[a], place[b]] = result[:, place[b], place[a]] = sums @ coefficients
        diagonal = np.arange(size)
        result[:, diagonal, diagonal] *= 1 + _RIDGE
        return result


@dataclass(frozen=True)
class ReducedResponse:
    """Compliances (j,) m/N of a reduced model, with bounds and derivatives.

    Attributes
    ----------
    compliance : (j,) never above the full model's
    high : (j,) never below it
    weights : (j, m) of the snapshots, y
    """

    compliance: np.ndarray
    high: np.ndarray
    weights: np.ndarray
    _model: weakref.ref[ReducedModel]
    _numbers: tuple[int, ...]

    @property
    def is_stale(self) -> bool:
        """Whether the basis no longer has the snapshots of this response, and no derivatives."""
        model = self._model()
        return model is None or not all(number in model._snapshots for number in self._numbers)

    @property
    def error(self) -> float:
        """Bound of the relative error of all compliances; infinite where a basis fails."""
        with np.errstate(all="ignore"):
            bound = float(np.max(np.abs(self.high / self.compliance - 1)))
        return bound if np.isfinite(bound) and self.compliance.min() > 0 else np.inf

    def gradient(self, modulus_gradient: np.ndarray) -> np.ndarray:
        """Return the derivative of the compliances with respect to parameters, (j, k).

        Parameters
        ----------
        modulus_gradient : (p, k) dE/dtheta at the full model's `points_m`, or (p,) of one

        Raises
        ------
        SolverError
            The response is stale.
        """
        own = self._model()
        if own is None or self.is_stale:
            raise SolverError("the basis has dropped a snapshot of this response; evaluate anew")
        modes = own._primal
        columns = np.atleast_2d(np.asarray(modulus_gradient).T)[:, : len(own._unit)] / own._unit
        length = np.linalg.norm(columns * modes._root, axis=1)
        by_mode = modes.coefficients(columns, _SPANNED_SLOPE * length, own._pairs)
        place = {number: index for index, number in enumerate(self._numbers)}
        result = np.zeros((len(self.compliance), len(columns)))
        for (a, b), sums in modes.sums.items():
            if a not in place or b not in place:  # has joined since
                continue
            product = self.weights[:, place[a]] * self.weights[:, place[b]]
            result -= (1 if a == b else 2) * product[:, None] * (sums @ by_mode.T)
        return result if np.ndim(modulus_gradient) == 2 else result[:, 0]


class ReducedBases:
    """Reduced models of one palpation model around the maps of a search, grown as it goes.

    A solution joins the basis that came nearest to it, or begins one of its own.
    """

    def __init__(self, full: PalpationModel) -> None:
        self._full = full
        by_pair = 4.0 * len(full.contacts) * len(full.points_m)
        self._most = min(int((np.sqrt(1 + 8 * _BYTES / by_pair) - 1) / 2), _MOST)
        self._bases: list[ReducedModel] = []  # the last one that served is last
        self._nearest: tuple[float, ReducedModel] | None = None

    def evaluate(self, modulus_pa: np.ndarray, tolerance: float) -> ReducedResponse | None:
        """Return the compliances for a modulus (p,) at `points_m`, Pa; None if none is certain.

        Parameters
        ----------
        tolerance : of the bound of their relative error
        """
        self._nearest = None
        for basis in reversed(self._bases):
            response = basis.evaluate(modulus_pa)
            if response is None:
                return None
            if response.error <= tolerance:
                self._bases.remove(basis)
                self._bases.append(basis)
                basis.served = True
                return response
            if self._nearest is None or response.error < self._nearest[0]:
                self._nearest = response.error, basis
        return None

    def add(self, response: Response) -> None:
        """Take the full solution for the modulus that was evaluated last."""
        if self._most < 2 or _samples(response._material) is None:
            return
        if self._nearest is not None and self._nearest[0] <= FAR:
            self._nearest[1].add(response)
            return
        if len(self._bases) == _BASES:
            idle = [basis for basis in self._bases if not basis.served]
            self._bases.remove((idle or self._bases)[0])
        basis = ReducedModel(self._full, self._most)
        basis.add(response)
        self._bases.append(basis)


def _samples(material: Material) -> np.ndarray | None:
    """Modulus samples (p,); None where those of a steep cell are not as they are asked for."""
    if material.close.steep:
        return None
    return np.concatenate([material.modulus, material.close.asked.ravel()])


def _solved(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solutions (j, m) of positive definite matrices (j, m, m), scaled to a diagonal of one.

    Not a number where they are not positive definite: far from all snapshots.
    """
    diagonal = np.einsum("jaa->ja", matrix)
    if not (np.isfinite(matrix).all() and diagonal.min() > 0):
        return np.full(right.shape, np.nan)
    scale = 1 / np.sqrt(diagonal)
    scaled = matrix * scale[:, :, None] * scale[:, None, :]
    try:
        return scale * np.linalg.solve(scaled, (right * scale)[..., None])[..., 0]
    except np.linalg.LinAlgError:
        return np.full(right.shape, np.nan)
