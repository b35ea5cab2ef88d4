"""Which presses to make next to tell effects apart that the present scan cannot.

Every rival has been fitted to the present scan. A planned scan is predicted with each of them; how
far apart two predictions are, once the second rival's own parameters and the map have been
refitted to present and planned readings together, is what the planned scan adds:

    D = |P (r_A - r_B)|^2,   P projecting out rival B's derivatives on both scans,

in units of chi-square. A design is worth the smallest D over all ordered pairs of rivals, from
which the present scan's own part is taken away.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np

from identify.joint_fit import JointFit
from identify.limits import planned
from identify.optimize_result import InadmissibleError
from identify.scan_design import Design

NEEDED = 25.0  # chi-square that tells two effects apart beyond doubt


@dataclass(frozen=True)
class Proposal:
    """A scan that would tell rivals apart.

    `discrimination` is the least difference in chi-square between two of them, `pair` these two.
    """

    design: Design
    discrimination: float
    pair: tuple[str, str]

    @property
    def enough(self) -> bool:
        """Whether one such scan decides."""
        return self.discrimination >= NEEDED


def next_presses(
    rivals: Sequence[tuple[str, JointFit]],
    designs: Sequence[Design],
    progress: Callable[[str], None] | None = None,
) -> tuple[Proposal, ...]:
    """Rank planned scans by how well they tell rivals apart, best first.

    Parameters
    ----------
    rivals : effects by name with their joint fits to the present scan
    designs : planned scans
    """
    found = []
    for design in designs:
        if progress:
            progress(f"planning a scan {design.change}")
        try:
            proposal = _proposal(rivals, design)
        except InadmissibleError:
            continue
        found.append(proposal)
    return tuple(sorted(found, key=lambda p: -p.discrimination))


def _proposal(rivals: Sequence[tuple[str, JointFit]], design: Design) -> Proposal:
    views = {}
    for name, fit in rivals:
        _, at = planned(fit, design)
        views[name] = at
    fits = dict(rivals)
    worst = (np.inf, ("", ""))
    for truth, model in permutations(views, 2):
        at, now = views[model], fits[model].at
        sigma = np.concatenate([now.sigma_m, at.sigma_m])
        apart = np.concatenate(
            [
                fits[truth].at.predicted_m - now.predicted_m,
                views[truth].predicted_m - at.predicted_m,
            ]
        )
        g = np.vstack([now.jacobian, at.jacobian])
        both = _left(g, apart / sigma)
        present = len(now.sigma_m)
        before = _left(now.jacobian, (apart / sigma)[:present])
        worst = min(worst, (max(both - before, 0.0), (truth, model)))
    return Proposal(design, *worst)


def _left(g: np.ndarray, r: np.ndarray) -> float:
    """Squared length of r (m,) beyond the columns of g (m, k)."""
    scale = np.linalg.norm(g, axis=0)
    g = g / np.where(scale > 0, scale, 1.0)
    step = np.linalg.lstsq(g, r, rcond=1e-10)[0]
    return float(np.sum((r - g @ step) ** 2))
