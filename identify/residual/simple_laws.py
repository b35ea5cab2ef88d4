"""Simple laws that a residual may follow: the tip's speed, its direction, the session's clock.

They are no effects of the catalogue and name no cause. Beside an unexplained residual, a law that
alone takes nearly all of it is the lead to its cause.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from identify.effects.units import digits, percent
from identify.residual.hypothesis_tests import project_out, score_test
from identify.residual.projected import ResidualView
from identify.residual.whitened import Whitened


@dataclass(frozen=True)
class LawMatch:
    """A law for nearly all of the excess chi-square: `value` +- `error` times its pattern.

    `share` is its part of the excess chi-square, `words` its sentence for an experimenter.
    """

    name: str
    value: float
    error: float
    unit: str
    share: float
    words: str


@dataclass(frozen=True)
class Law:
    """A pattern (m,) in m per `unit`, None without its readings, and the words of its size."""

    name: str
    unit: str
    pattern: Callable[[Whitened], np.ndarray | None]
    words: Callable[[float], str]


def matching_law(view: ResidualView) -> LawMatch | None:
    """Return the law with the largest share of the excess chi-square, if it takes nearly all."""
    excess = (view.chi2 - view.dof) / view.scale**2
    at_most = excess + 2 * np.sqrt(2 * view.dof)  # chance may have made it look smaller
    best, surely = None, view.settings.law_share
    for law in LAWS:
        pattern = law.pattern(view.w)
        if pattern is None or excess <= 0:
            continue
        column = view.w.apart(pattern / view.w.sigma_m)
        score = score_test(view.residual, column[:, None], view.absorbed)
        taken = score.statistic - score.dof
        if score.dof and taken >= surely * at_most:
            beyond = project_out(view.absorbed, column)
            length = float(beyond @ beyond)
            value = view.scale * float(beyond @ view.residual) / length
            error = float(view.scale / np.sqrt(length))
            share = min(taken / excess, 1.0)
            best = LawMatch(law.name, value, error, law.unit, share, law.words(value))
            surely = taken / at_most
    return best


def travel(w: Whitened) -> np.ndarray:
    """Travel (m,) of each reading by its press's mean compliance, m: free of the force's noise."""
    modelled = w.scan.displacement_m - w.residual_m  # at the measured force
    along = np.bincount(w.press_index, modelled * w.scan.force_n, w.presses)
    square = np.bincount(w.press_index, w.scan.force_n**2, w.presses)
    return (along / np.maximum(square, 1e-300))[w.press_index] * w.force_n


def speed(w: Whitened) -> np.ndarray | None:
    """Speed of the tip (m,), m/s; None without time stamps."""
    if not w.scan.has_time:
        return None
    way, result = travel(w), np.zeros(len(w.force_n))
    for press in range(w.presses):
        rows = np.flatnonzero(w.press_index == press)
        rows = rows[np.argsort(w.scan.time_s[rows], kind="stable")]
        times = w.scan.time_s[rows]
        if len(rows) > 2 and np.diff(times).min() > 0:
            result[rows] = np.gradient(way[rows], times)
    return result


def direction(w: Whitened) -> np.ndarray | None:
    """+1 on the way down, -1 on the way up, 0 between, (m,); None where only one is there."""
    down, up = w.scan.phase == "load", w.scan.phase == "unload"
    return 1.0 * down - up if down.any() and up.any() else None


def share_of_travel(w: Whitened) -> np.ndarray | None:
    """Travel with the sign of the direction (m,), m."""
    sign = direction(w)
    return None if sign is None else sign * travel(w)


def session(w: Whitened) -> np.ndarray | None:
    """Travel times the elapsed part of the session, -1/2 to 1/2, (m,), m."""
    clock = w.scan.time_s if w.scan.has_time else w.press_index.astype(float)
    length = np.ptp(clock)
    return travel(w) * ((clock - clock.min()) / length - 0.5) if length > 0 else None


def _late(seconds: float) -> str:
    late, early = ("force", "displacement") if seconds > 0 else ("displacement", "force")
    by = digits(1e3 * abs(seconds))
    return f"the speed of the tip, as if the {late} lagged the {early} by {by} ms"


def _friction(metres: float) -> str:
    down, up = f"{1e6 * metres:+.2g} µm", f"{-1e6 * metres:+.2g} µm"
    return f"the direction of the tip, {down} on the way down and {up} on the way up"


def _share(share: float) -> str:
    down, up = f"{100 * share:+.2g} %", f"{-100 * share:+.2g} %"
    return f"the direction of the tip, {down} of the travel on the way down and {up} on the way up"


def _ageing(share: float) -> str:
    grows = "softer" if share > 0 else "stiffer"
    return f"the time of the session, as if all grew {grows} by {percent(abs(share))} within it"


LAWS = (
    Law("speed", "s", speed, _late),
    Law("direction", "m", direction, _friction),
    Law("share_of_travel", "1", share_of_travel, _share),
    Law("session", "1", session, _ageing),
)
