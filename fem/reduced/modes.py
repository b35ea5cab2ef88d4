"""Span of modulus fields, in which an evaluation needs no pass over the energies of a mesh."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from fem.reduced.energies import summed
from fem.reduced.plane_energies import PlaneEnergies
from fem.reduced.snapshot import Snapshot

MOST = 32  # modes of a span: more cost more with each new solution than they save


class Pair(NamedTuple):
    """Two snapshots, their energies (j, p) in each other, and those in the plane of fibres."""

    first: Snapshot
    second: Snapshot
    energies: np.ndarray
    in_plane: PlaneEnergies | None


Pairs = dict[tuple[int, int], Pair]
"""The pairs of a basis by the numbers of their snapshots."""


class Modes:
    """Span of the fields asked for so far, with the sums of each pair's energies over its modes.

    Parameters
    ----------
    root : (p,) root of each sample's weight
    factor : of two snapshots, on the fields (p,)
    """

    def __init__(
        self, root: np.ndarray, factor: Callable[[Snapshot, Snapshot], np.ndarray | float]
    ) -> None:
        self._root, self._factor = root, factor
        self._modes = np.zeros((0, len(root)))  # (q, p), orthonormal, of fields times root
        self.sums: dict[tuple[int, int], np.ndarray] = {}  # (j, q) of each pair of snapshots
        self.in_plane: dict[tuple[int, int], np.ndarray] = {}  # (j, 9, q), of a basis with fibres

    def __len__(self) -> int:
        return len(self._modes)

    def coefficients(self, fields: np.ndarray, tolerance: np.ndarray, pairs: Pairs) -> np.ndarray:
        """Coefficients (k, q) of fields (k, p); those beyond the span by more than (k,) join it.

        A span that has become large begins anew with these fields.
        """
        scaled = fields * self._root
        joined = self._beyond(scaled, tolerance)
        if not len(joined):
            return scaled @ self._modes.T
        if len(self._modes) + len(joined) > MOST:
            self._clear()
            joined = self._beyond(scaled, tolerance)
        self._modes = np.vstack([self._modes, joined])
        for key, pair in pairs.items():
            columns = joined / self._root * self._factor(pair.first, pair.second)
            self.sums[key] = np.hstack([self.sums[key], summed(pair.energies, columns)])
            if pair.in_plane is not None:
                more = pair.in_plane.summed(columns)
                self.in_plane[key] = np.concatenate([self.in_plane[key], more], axis=2)
        return scaled @ self._modes.T

    def _beyond(self, scaled: np.ndarray, tolerance: np.ndarray) -> np.ndarray:
        """Orthonormal modes (n, p) of the parts of fields (k, p) beyond the span."""
        left = np.sum(scaled**2, axis=1) - np.sum((scaled @ self._modes.T) ** 2, axis=1)
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
        return np.array(new)

    def _clear(self) -> None:
        """Forget all modes."""
        self._modes = self._modes[:0]
        self.sums = {key: sums[:, :0] for key, sums in self.sums.items()}
        self.in_plane = {key: sums[:, :, :0] for key, sums in self.in_plane.items()}

    def add(self, key: tuple[int, int], pair: Pair, exact: np.ndarray) -> None:
        """Sum the energies (j, p) of a new pair over the modes."""
        columns = self._modes / self._root * self._factor(pair.first, pair.second)
        self.sums[key] = exact @ columns.T
        if pair.in_plane is not None:
            self.in_plane[key] = pair.in_plane.summed(columns)

    def drop(self, key: tuple[int, int]) -> None:
        """Forget a pair."""
        del self.sums[key]
        self.in_plane.pop(key, None)
