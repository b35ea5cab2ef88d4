"""Integrals of near fields over cells, each computed once however many presses it serves.

Presses on a grid meet the cells of a regular mesh in few ways: of 81 presses 9 mm apart on cells of
12 mm, 16 are different. A cell's integrals depend on its nodes in the press's frame, on the tip's
radius and on the surface's shape under it: equal ones have equal integrals.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import NamedTuple

import numpy as np

_ALIKE = 1e-8  # of the tip's radius: nodes closer than this are at the same place


class Shared(NamedTuple):
    """Arrays (n, ...) over the different cells, and each press's rows (c,) in them."""

    arrays: tuple[np.ndarray, ...]
    rows: list[np.ndarray]


def shared(
    local: Sequence[np.ndarray],
    alike: Sequence[bytes],
    radius_m: np.ndarray,
    compute: Callable[[int, np.ndarray], tuple[np.ndarray, ...]],
    most_different: float = 0.7,
) -> Shared:
    """Return arrays over the cells of all presses, those that lie alike computed and kept once.

    Parameters
    ----------
    local : for each press (c, nodes, 3) m, the nodes of its cells in its frame
    alike : for each press a key of all else that its integrals depend on
    radius_m : (j,) of the tips
    compute : arrays (c, ...) of press j for some of its cells (indices); called by several threads
    most_different : share of the cells; if more are different, each press has its own
    """
    kinds = {kind: number for number, kind in enumerate(dict.fromkeys(alike))}
    keys = np.concatenate(
        [
            _hashes(np.rint(nodes / (_ALIKE * radius)), kinds[kind])
            for nodes, kind, radius in zip(local, alike, radius_m, strict=True)
        ]
    )
    _, first, back = np.unique(keys, return_index=True, return_inverse=True)
    if len(first) > most_different * len(keys):
        first = back = np.arange(len(keys))
    begin = np.cumsum([0, *(len(nodes) for nodes in local)])
    # The first cell of each kind is computed, by the press that it belongs to
    order = np.argsort(first)
    press = np.searchsorted(begin, first[order], "right") - 1
    busy = np.unique(press) if len(press) else np.zeros(1, int)
    own = [first[order][press == j] - begin[j] for j in busy]
    with ThreadPoolExecutor() as pool:  # the quadrature runs outside the interpreter lock
        parts = list(pool.map(compute, busy, own))
    every = tuple(np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    place = np.empty(len(first), np.int64)
    place[order] = np.arange(len(first))
    rows = place[back.ravel()]
    return Shared(every, [rows[b:e] for b, e in pairwise(begin)])


def _hashes(rows: np.ndarray, kind: int) -> np.ndarray:
    """Hash whole numbers (c, nodes, 3), cells of one kind, to 64 bits each, (c,)."""
    rows = rows.reshape(len(rows), rows.shape[1] * rows.shape[2])
    odd = np.random.default_rng(0).integers(1 << 62, size=rows.shape[1] + 1, dtype=np.uint64)
    odd = 2 * odd + np.uint64(1)
    with np.errstate(over="ignore"):
        mixed = rows.astype(np.int64).view(np.uint64) @ odd[1:] + np.uint64(kind) * odd[0]
        return mixed ^ (mixed >> np.uint64(29))
