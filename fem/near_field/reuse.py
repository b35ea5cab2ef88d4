"""Integrals of near fields over cells, each computed once however many presses it serves.

Presses on a grid meet the cells of a regular mesh in few ways: of 81 presses 9 mm apart on cells of
12 mm, 16 are different. A cell's integrals depend on its nodes in the press's frame, on the tip's
radius and on the surface's shape under it: equal ones have equal integrals.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from hashlib import blake2b
from itertools import pairwise
from typing import NamedTuple

import numpy as np

_ALIKE = 1e-8  # of the tip's radius: nodes closer than this are at the same place


class Shared(NamedTuple):
    """Arrays (n, ...) over the different cells, and each press's rows (c,) in them.

    `keys` (n,) tell the cells apart; sorted.
    """

    arrays: tuple[np.ndarray, ...]
    rows: list[np.ndarray]
    keys: np.ndarray


def shared(
    local: Sequence[np.ndarray],
    alike: Sequence[bytes],
    radius_m: np.ndarray,
    compute: Callable[[int, np.ndarray], tuple[np.ndarray, ...]],
    known: Shared | None = None,
) -> Shared:
    """Return arrays over the cells of all presses, those that lie alike computed and kept once.

    Parameters
    ----------
    local : for each press (c, nodes, 3) m, the nodes of its cells in its frame
    alike : for each press a key of all else that its integrals depend on
    radius_m : (j,) of the tips
    compute : arrays (c, ...) of press j for some of its cells (indices); called by several threads
    known : arrays of other presses or of another mesh, computed alike; taken where cells lie alike
    """
    keys = np.concatenate(
        [
            _hashes(np.rint(nodes / (_ALIKE * radius)), kind)
            for nodes, kind, radius in zip(local, alike, radius_m, strict=True)
        ]
    )
    different, first, back = np.unique(keys, return_index=True, return_inverse=True)
    begin = np.cumsum([0, *(len(nodes) for nodes in local)])
    # The first cell of each kind is computed, by the press that it belongs to
    new = np.ones(len(first), bool) if known is None else ~np.isin(different, known.keys)
    order = np.flatnonzero(new)[np.argsort(first[new])]
    press = np.searchsorted(begin, first[order], "right") - 1
    busy = np.unique(press) if len(press) else np.zeros(1, int)
    own = [first[order][press == j] - begin[j] for j in busy]
    every: tuple[np.ndarray, ...] = ()  # by key, as they are looked up
    with ThreadPoolExecutor() as pool:  # the quadrature runs outside the interpreter lock
        # Each press's part is put in its place and freed: all of them take as much memory again
        for j, part in zip(busy, pool.map(compute, busy, own), strict=True):
            every = every or tuple(np.empty((len(first), *a.shape[1:]), a.dtype) for a in part)
            for array, values in zip(every, part, strict=True):
                array[order[press == j]] = values
    if known is not None:
        taken = np.searchsorted(known.keys, different[~new])
        for array, values in zip(every, known.arrays, strict=True):
            array[~new] = values[taken]
    return Shared(every, [back.ravel()[b:e] for b, e in pairwise(begin)], different)


def _hashes(rows: np.ndarray, kind: bytes) -> np.ndarray:
    """Hash whole numbers (c, nodes, 3), cells of one kind, to 64 bits each, (c,)."""
    own = int.from_bytes(blake2b(kind, digest_size=8).digest(), "little")
    rows = rows.reshape(len(rows), rows.shape[1] * rows.shape[2])
    odd = np.random.default_rng(0).integers(1 << 62, size=rows.shape[1] + 1, dtype=np.uint64)
    odd = 2 * odd + np.uint64(1)
    with np.errstate(over="ignore"):
        mixed = rows.astype(np.int64).view(np.uint64) @ odd[1:] + np.uint64(own) * odd[0]
        return mixed ^ (mixed >> np.uint64(29))
