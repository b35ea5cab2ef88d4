"""Span of modulus fields, in which an evaluation needs no pass over the energies of a mesh."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fem.reduced.energies import summed
from fem.reduced.snapshot import Snapshot

Pairs = dict[tuple[int, int], tuple[Snapshot, Snapshot, np.ndarray]]
"""Energies (j, p) of each pair of snapshots, by their numbers."""


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

    def __len__(self) -> int:
        return len(self._modes)

    def coefficients(self, fields: np.ndarray, tolerance: np.ndarray, pairs: Pairs) -> np.ndarray:
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

    def add(self, key: tuple[int, int], first: Snapshot, second: Snapshot, exact) -> None:
        """Sum the energies (j, p) of a new pair over the modes."""
        self.sums[key] = exact @ (self._modes / self._root * self._factor(first, second)).T
