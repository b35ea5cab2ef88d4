"""The course of a residual: a smooth function of one argument, in one quantity, named in words.

A residual that no effect explains is described for whoever has to write the effect: along what it
goes (the session's clock, the time within a press, the force, the phase, the place, or the single
press) and as what (a length, a force, or a share of the travel). Each pair is a family of patterns,
quantity times smooth functions of the argument, with a score; the pair with the most chi-square
after a price of ln m a column (BIC) is the course, if it surely takes most of the excess. Pairs
within the margin of it are named beside it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline

from identify.effects.units import force, length, percent
from identify.residual.directions import PHASES, since_touch
from identify.residual.hypothesis_tests import project_out
from identify.residual.projected import ResidualView
from identify.residual.simple_laws import travel
from identify.residual.whitened import Whitened

_SHARE = 0.7  # of the excess chi-square: required of a course
_MARGIN = 10.0  # of the criterion, within which another pair is as good
_COLUMNS = 6  # of a smooth function of one argument
_VISIBLE = 0.05  # share of a pattern beyond the fitted parameters below which it is their error


@dataclass(frozen=True)
class Course:
    """A smooth course of the residual.

    Attributes
    ----------
    along : argument: session, within, force, phase, place, press
    quantity : travel (m), force (N) or share (of the travel)
    size : range of the fitted course over the readings, in the unit of the quantity
    share : part of the excess chi-square
    as_good : further quantities with the same argument that do as well
    words : for a sentence
    """

    along: str
    quantity: str
    size: float
    share: float
    as_good: tuple[str, ...]
    words: str


_ALONG = {
    "session": "the time of the session, smoothly, the same at all places",
    "within": "the time within a press, alike in all presses",
    "force": "the force, alike in all presses",
    "phase": "the phase of the press (in, hold, out), alike in all presses",
    "place": "the place on the surface, smoothly, whenever it is pressed",
    "press": "the single press, without a course in time or place",
}
_QUANTITIES = {
    "travel": ("a length", length),
    "force": ("a force", force),
    "share": ("a share of the travel", lambda size: percent(size)),
}


def smooth_course(view: ResidualView) -> Course | None:
    """Return the course that surely takes most of the excess chi-square, or None."""
    w = view.w
    excess = (view.chi2 - view.dof) / view.scale**2
    at_most = excess + 2 * np.sqrt(2 * view.dof)  # chance may have made it look smaller
    if excess <= 0:
        return None
    carriers = _carriers(w)
    found = []
    for along, argument in _ARGUMENTS.items():
        columns = argument(w)
        if columns is None:
            continue
        for quantity, carrier in carriers.items():
            pattern = columns * (carrier / w.sigma_m)[:, None]
            basis = _beyond(view, w.apart(pattern))
            if basis.shape[1] == 0:
                continue
            taken = float(np.sum((basis.T @ view.residual) ** 2))
            price = basis.shape[1] * np.log(len(view.residual))
            found.append((taken - price, taken - basis.shape[1], along, quantity, pattern))
    if not found:
        return None
    best, taken, along, quantity, pattern = max(found, key=lambda one: one[0])
    if taken < _SHARE * at_most:
        return None
    as_good = tuple(
        q for gain, _, a, q, _ in found if a == along and q != quantity and gain > best - _MARGIN
    )
    size = _range(view, pattern, carriers[quantity])
    what, said = _QUANTITIES[quantity]
    either = "".join(f" or {_QUANTITIES[q][0]}" for q in as_good)
    words = f"{_ALONG[along]}, as {what}{either}, up to {said(size)}"
    return Course(along, quantity, size, min(taken / excess, 1.0), as_good, words)


def _beyond(view: ResidualView, pattern: np.ndarray) -> np.ndarray:
    """Orthonormal basis (m, q) of a pattern beyond the fitted parameters, without its rest."""
    length = np.maximum(np.linalg.norm(pattern, axis=0), 1e-300)
    basis, share, _ = np.linalg.svd(project_out(view.absorbed, pattern / length), False)
    return basis[:, share > _VISIBLE]


def _range(view: ResidualView, pattern: np.ndarray, carrier: np.ndarray) -> float:
    """Range of the fitted course over the readings, in the unit of its quantity."""
    both = np.hstack([view.absorbed, view.w.apart(pattern)])
    fitted, *_ = np.linalg.lstsq(both, view.residual * view.scale, rcond=1e-8)
    course = (pattern @ fitted[view.absorbed.shape[1] :]) * view.w.sigma_m
    carried = np.abs(carrier) > 0.1 * np.abs(carrier).max()
    return float(np.ptp(course[carried] / carrier[carried]))


def _carriers(w: Whitened) -> dict[str, np.ndarray]:
    """Travel (m,) for one unit of each quantity."""
    way = travel(w)
    force = np.where(np.abs(w.force_n) > 0, w.force_n, np.inf)
    softness = np.bincount(w.press_index, way / force, w.presses)
    softness /= np.maximum(np.bincount(w.press_index, np.isfinite(force), w.presses), 1)
    return {"travel": np.ones_like(way), "force": softness[w.press_index], "share": way}


def _smooth(at: np.ndarray) -> np.ndarray | None:
    """Cubic B-splines (m, q) of an argument, None where it does not vary."""
    low, high = float(at.min()), float(at.max())
    if high - low <= 1e-9 * max(abs(low), abs(high)):
        return None
    inner = np.linspace(0, 1, _COLUMNS - 2)
    knots = np.r_[[0.0] * 3, inner, [1.0] * 3]
    return BSpline.design_matrix(np.clip((at - low) / (high - low), 0, 1), knots, 3).toarray()


def _session(w: Whitened) -> np.ndarray | None:
    return _smooth(w.scan.time_s if w.scan.has_time else w.press_index.astype(float))


def _within(w: Whitened) -> np.ndarray | None:
    return _smooth(since_touch(w)) if w.scan.has_time else None


def _phase(w: Whitened) -> np.ndarray | None:
    present = [w.scan.phase == name for name in PHASES if np.any(w.scan.phase == name)]
    return np.column_stack(present).astype(float) if len(present) > 1 else None


def _place(w: Whitened) -> np.ndarray | None:
    """Quadratic functions over the surface's two longest directions."""
    if w.presses < 2 * _COLUMNS:
        return None
    points = w.scan.contact_points - w.scan.contact_points.mean(axis=0)
    _, _, axes = np.linalg.svd(points, full_matrices=False)
    x, y = (points @ axes[:2].T / max(float(np.abs(points).max()), 1e-12)).T
    surface = np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y])
    return surface[w.press_index]


def _press(w: Whitened) -> np.ndarray | None:
    return (w.press_index[:, None] == np.arange(w.presses)).astype(float)


_ARGUMENTS: dict[str, Callable[[Whitened], np.ndarray | None]] = {
    "session": _session,
    "within": _within,
    "force": lambda w: _smooth(w.force_n),
    "phase": _phase,
    "place": _place,
    "press": _press,
}
