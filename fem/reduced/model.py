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

Springs under the base and a skin join both sides: with the base displacements v_a, the tractions
t_a, springs of compliance s, and a membrane of stretch r over the surface strains e_a,

    G_ab += int v_a v_b / s + r int E e_a e_b,    H_ab += s int t_a t_b + int (r_a E_a)(r_b E_b)
                                                          e_a e_b / (r E).

A bonded base takes fields of bonded bodies alone, a body without a skin stresses of such bodies.
Fibres of one share of the modulus everywhere join both sides, too: `fem.reduced.plane_energies`.

Both matrices are linear in a field, E or 1/E. A new field joins the span of those asked for before
(`fem.reduced.modes`), at the cost of one pass over the energies; in the span, an evaluation takes
about a millisecond.

Sources: Rozza, Huynh, Patera, Arch. Comput. Methods Eng. 15 (2008) 229 (reduced basis); Ladeveze,
Leguillon, SIAM J. Numer. Anal. 20 (1983) 485 (error in constitutive relation).
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Collection
from typing import NamedTuple

import numpy as np

from fem.linear.support import first_order_rest
from fem.palpation.fibres import Fibres
from fem.palpation.model import PalpationModel, Response
from fem.palpation.skin import Skin
from fem.reduced.energies import Strains, mixed_energies
from fem.reduced.modes import Modes, Pair, Pairs
from fem.reduced.plane_energies import FibreWeights, PlaneEnergies
from fem.reduced.response import ReducedResponse
from fem.reduced.snapshot import Law, Snapshot, law_of, modulus_samples

MOST = 10  # snapshots of a basis: more are not worth their growth
SPANNED = 1e-6  # of a compliance: first-order error by the part of a field beyond the span
MOST_OF_FIBRES = 3  # ... of bodies with fibres, whose strains are kept, and summed nine times
_RIDGE = 1e-9  # of a matrix's diagonal: keeps both bounds on their side, and the solves stable


class Body(NamedTuple):
    """Arguments of `PalpationModel.evaluate`."""

    modulus_pa: np.ndarray
    support_compliance: tuple[float, float] | None = None
    fibres: Fibres | tuple | None = None
    skin: Skin | tuple | None = None


class ReducedModel:
    """A palpation model in a basis for each press, from full solutions as they come.

    Parameters
    ----------
    full : the model
    fibres : true if bodies may have fibres in the horizontal plane, of one share of the modulus
    most : largest number of snapshots; the one that has gone unused for longest makes place
    """

    def __init__(self, full: PalpationModel, most: int = MOST, *, fibres: bool = False) -> None:
        self.full, self.fibres, self._most = full, fibres, most
        self._snapshots: dict[int, Snapshot] = {}  # by number
        self._loads: dict[int, np.ndarray] = {}  # (j,) work of the load on each
        self._used: dict[int, int] = {}  # evaluation in which each one last counted
        self._pairs: Pairs = {}
        self._surface: dict[tuple[int, int, str], np.ndarray] = {}
        self._next = self._evaluations = 0
        self.served = False  # any search

    def __len__(self) -> int:
        return len(self._snapshots)

    @property
    def numbers(self) -> set[int]:
        """Numbers of the snapshots."""
        return set(self._snapshots)

    def add(self, response: Response, number: int | None = None) -> int | None:
        """Add a full solution to every basis; return its number, the next one if none is given.

        None where it is of no use: steep in a cell around a tip, or without a least energy.
        """
        modulus = modulus_samples(response._material)
        if modulus is None:
            return None
        if not self._snapshots:
            self._unit = modulus
        new = Snapshot(response, modulus / self._unit)
        if not new.law.is_reducible or (new.law.share and not self.fibres):
            return None
        inside = self._strains(new)
        if new.law.stretch_m:
            alone = mixed_energies(self.full, inside, inside)
        else:
            alone = -response.sensitivity[:, : len(modulus)]
        energy = alone @ modulus
        if not np.all(energy > 0):
            return None  # no least energy, so no bounds
        if not self._snapshots:
            weight = (alone / energy[:, None]).sum(axis=0) * modulus
            root = np.sqrt(np.maximum(weight, 1e-6 * weight.mean()))
            self._primal = Modes(root, lambda a, b: modulus)
            self._dual = Modes(root, lambda a, b: modulus * a.modulus * b.modulus)
        while len(self._snapshots) >= self._most:
            self.drop(min(self._used, key=lambda number: self._used[number]))
        number = self._next if number is None else number
        self._next = number + 1
        self._snapshots[number] = new
        self._used[number] = self._evaluations
        for other, known in self._snapshots.items():
            first, mixed = inside, alone
            if other != number:
                first = self._strains(known)
                mixed = mixed_energies(self.full, first, inside)
            in_plane = PlaneEnergies(self.full, first, inside) if self.fibres else None
            pair = Pair(known, new, np.ascontiguousarray(mixed, np.float32), in_plane)
            self._pairs[other, number] = pair
            for modes in (self._primal, self._dual):
                modes.add((other, number), pair, mixed)
        self._loads[number] = np.array(response.compliance)
        if any(new.law.kind) or new.has_skin:  # beyond what the matrix holds, too
            self._loads[number] = alone @ modulus + self._of_law(new.law, number, number, modulus)
            in_plane = self._pairs[number, number].in_plane
            if in_plane is not None:
                weights = FibreWeights(new.law, self._nu).of_energy
                self._loads[number] += weights @ in_plane.summed(modulus[None])[..., 0].T
        return number

    def _strains(self, snapshot: Snapshot) -> Strains:
        """Strains of a snapshot, kept where those of pairs are summed ever again."""
        return snapshot.inside if self.fibres else snapshot.strains_inside()

    def drop(self, number: int) -> None:
        """Forget a snapshot."""
        del self._snapshots[number], self._used[number], self._loads[number]
        for key in [key for key in self._pairs if number in key]:
            del self._pairs[key]
            self._primal.drop(key)
            self._dual.drop(key)
        for key in [key for key in self._surface if number in key[:2]]:
            del self._surface[key]

    def evaluate(
        self,
        body: Body,
        *,
        among: Collection[int] | None = None,
        rests: bool = False,
    ) -> ReducedResponse | None:
        """Solve for all presses, as `PalpationModel.evaluate` does.

        None before the first snapshot that the body admits, where the modulus is too steep for a
        cell around a tip, where the body slides freely, and for fibres that the basis does not
        know.

        Parameters
        ----------
        among : numbers of the snapshots, or all
        rests : a body that slides freely is known to rest under every press
        """
        if not self._snapshots:
            return None
        material = self.full.material(body.modulus_pa, body.fibres, body.skin)
        asked, springs = self.full.held(material, body.support_compliance)
        modulus = modulus_samples(material)
        if modulus is None or (np.isinf(asked[1]) and not rests):  # the full model knows
            return None
        law = law_of(material, springs)
        if not law.is_reducible or (law.share and not self.fibres):
            return None
        own = {n: s for n, s in self._snapshots.items() if among is None or n in among}
        fields = [n for n, s in own.items() if springs or not s.law.springs]
        stresses = [n for n, s in own.items() if law.stretch_m or not s.law.stretch_m]
        if not fields or not stresses:
            return None
        stiffness, flexibility = self._matrices(law, modulus, fields, stresses)
        load = np.array([self._loads[n] for n in fields]).T
        weights = _solved(stiffness, load)
        low = np.einsum("ja,ja->j", weights, load)
        high = 1 / _solved(flexibility, np.ones(flexibility.shape[:2])).sum(axis=1)
        self._evaluations += 1
        nearest = max(zip(np.abs(weights).max(axis=0), fields, strict=True))[1]
        self._used[nearest] = self._evaluations
        response = ReducedResponse(
            low, high, weights, weakref.ref(self), tuple(fields), law, material
        )
        more = np.zeros(len(low))
        if springs is not None and not np.array_equal(asked, springs):
            more += first_order_rest(asked, springs, response.support_sensitivity)
        if material.skin is not None:
            more += self.full.floating.near_skin(material.skin).value / material.local
        low += more
        high += more
        low.setflags(write=False)
        return response

    def _matrices(
        self, law: Law, modulus: np.ndarray, fields: list[int], stresses: list[int]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Matrices G (j, m, m) for the fields of some snapshots, and H (j, n, n) for stresses."""
        relative, spanned = modulus / self._unit, np.array([SPANNED])
        primal = self._primal.coefficients(relative[None], spanned, self._pairs)[0]
        dual = self._dual.coefficients(1 / relative[None], spanned, self._pairs)[0]
        by_fibres = FibreWeights(law, self._nu)
        stiffness = self._matrix(
            self._primal,
            primal,
            fields,
            lambda a, b: self._of_law(law, a, b, modulus),
            lambda a, b: by_fibres.of_energy,
        )
        flexibility = self._matrix(
            self._dual,
            dual,
            stresses,
            lambda a, b: self._of_stress(law, a, b, modulus),
            lambda a, b: by_fibres.of_stress(self._snapshots[a].law, self._snapshots[b].law),
        )
        return stiffness, flexibility

    def _matrix(
        self,
        modes: Modes,
        coefficients: np.ndarray,
        numbers: list[int],
        more: Callable[[int, int], np.ndarray | float],
        in_plane: Callable[[int, int], np.ndarray],
    ) -> np.ndarray:
        """Matrix (j, m, m) of some snapshots for coefficients (q,) of the field.

        `more` (j,) and the weights `in_plane` (9,) are those of a pair's law.
        """
        size = len(numbers)
        result = np.empty((len(self.full.contacts), size, size))
        for column, b in enumerate(numbers):
            for row, a in enumerate(numbers[: column + 1]):
                both = modes.sums[a, b] @ coefficients + more(a, b)
                if self.fibres:
                    both += in_plane(a, b) @ modes.in_plane[a, b] @ coefficients
                result[:, row, column] = result[:, column, row] = both
        diagonal = np.arange(size)
        result[:, diagonal, diagonal] *= 1 + _RIDGE
        return result

    def _of_law(self, law: Law, a: int, b: int, modulus: np.ndarray) -> np.ndarray | float:
        """Part (j,) of G by springs and skin."""
        both: np.ndarray | float = 0.0
        if law.springs:
            both = both + self._at_surface(a, b, "base") @ (1 / np.array(law.springs))
        if law.stretch_m:
            both = both + law.stretch_m * (
                self._at_surface(a, b, "strains") @ modulus[self._beside]
            )
        return both

    def _of_stress(self, law: Law, a: int, b: int, modulus: np.ndarray) -> np.ndarray | float:
        """Part (j,) of H by springs and skin."""
        both: np.ndarray | float = 0.0
        if law.springs:
            both = both + self._at_surface(a, b, "traction") @ np.array(law.springs)
        stretches = [self._snapshots[n].law.stretch_m for n in (a, b)]
        if all(stretches):
            own = [self._snapshots[n].modulus[self._beside] for n in (a, b)]
            unit = self._unit[self._beside]
            ratio = unit**2 * own[0] * own[1] / modulus[self._beside]
            both = both + np.prod(stretches) / law.stretch_m * (
                self._at_surface(a, b, "strains") @ ratio
            )
        return both

    @property
    def _nu(self) -> float:
        return self.full.stiffness.poisson_ratio

    @property
    def _beside(self) -> np.ndarray:
        """Modulus samples beside the surface that may bear a skin."""
        return self.full.floating.membrane.samples

    def _at_surface(self, a: int, b: int, what: str) -> np.ndarray:
        """Products of two snapshots at the body's surface, by the name of their attribute.

        Integrals (j, 2) of displacements or tractions over the base, energies (j, s) of strains.
        """
        if (a, b, what) not in self._surface:
            body = self.full.floating
            product = body.membrane.energies if what == "strains" else body.foundation.products
            first, second = (getattr(self._snapshots[n], what) for n in (a, b))
            self._surface[a, b, what] = product(first, second)
        return self._surface[a, b, what]


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
