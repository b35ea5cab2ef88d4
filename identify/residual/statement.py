"""The result of a comparison in one sentence for an experimenter."""

import numpy as np

from identify.effects.units import digits
from identify.residual.comparison import Comparison, Level
from identify.residual.per_press import LARGEST_SIGMAS, PressResidual
from identify.residual.settings import RESIDUAL, ResidualSettings

LABELS = {
    "place": "the place on the surface",
    "force": "the force",
    "time": "the time within a press",
    "phase": "the phase of the press",
    "order": "the order of pressing",
    "press": "the single press",
    "reading": "the single reading",
}


def length(metres: float, *, signed: bool = True) -> str:
    """Length in µm or mm.

    Examples
    --------
    >>> length(3.82e-5), length(-4.1e-6), length(1.23e-3, signed=False)
    ('+38 µm', '-4.1 µm', '1.23 mm')
    """
    sign = "+" if signed else ""
    micro = 1e6 * metres
    if abs(micro) >= 1000:
        return f"{micro / 1000:{sign}.2f} mm"
    return f"{micro:{sign}.0f} µm" if abs(micro) >= 9.95 else f"{micro:{sign}.1f} µm"


def sigmas(press: PressResidual, form: str = ".2g") -> str:
    """Say a press's misfit in standard deviations; beyond 37 its chance is below any number."""
    return "> 37" if press.sigmas >= LARGEST_SIGMAS else f"{press.sigmas:{form}}"


def sentence(c: Comparison, settings: ResidualSettings = RESIDUAL) -> str:
    """Return the decision, noise or structure, with the main direction of a structure."""
    size = (
        f"rms {length(c.rms_m, signed=False)}, noise alone {length(c.expected_rms_m, signed=False)}"
    )
    if c.is_noise and c.p_value >= c.alpha:
        return f"The residual is noise: {size}, and no pattern along anything that was tested."
    if c.is_noise:
        look = f": {_finding(c, settings)}" if c.varies_with else ""
        return (
            f"The residual may be noise ({size}), which alone leaves as much structure in one of "
            f"{round(1 / c.p_value)} scans{look}."
        )
    if c.varies_with is None:
        times = c.test("size").times_noise
        text = (
            f"The residual has no main pattern but is {digits(times)} times the noise given "
            f"({size}): either the noise is larger than stated, or something varies from "
            "reading to reading"
        )
    else:
        text = f"The residual is not noise ({size}): {_finding(c, settings)}"
    if c.confused_with:
        text += f"; this scan does not separate it from {_listed(c.confused_with)}"
    if c.also_along:
        text += f"; beside that it varies with {_listed(c.also_along)}"
    return f"{text}. {law_sentence(c, 'it')}".strip()


def law_sentence(c: Comparison, what: str = "the residual") -> str:
    """Return the simple law, or else the course, of most of the residual; empty without one."""
    found = c.law or c.course
    return f"{100 * found.share:.0f} % of {what} goes with {found.words}." if found else ""


def _listed(names: tuple[str, ...]) -> str:
    labels = [LABELS[n] for n in names]
    return labels[0] if len(labels) == 1 else f"{', '.join(labels[:-1])} and {labels[-1]}"


def _finding(c: Comparison, settings: ResidualSettings) -> str:
    name = c.varies_with or ""
    if name == "press":
        return _presses(c, settings)
    if name == "reading":
        return _readings(c)
    if name == "place":
        return f"it varies most with {LABELS[name]}, {_places(c)}{_times(c, 'place')}"
    return f"it varies most with {LABELS[name]}, {_span(c.levels[name], name)}{_times(c, name)}"


def _times(c: Comparison, name: str) -> str:
    test = c.test(name)
    return f", {digits(test.times_noise)} times that of noise" if test.fires else ""


def _span(levels: tuple[Level, ...], name: str) -> str:
    """Return the two extreme levels in their order along the dimension, or all phases."""
    if name == "phase":
        return ", ".join(f"{length(v.mean_m)} in {v.label}" for v in levels)
    ends = {min(levels, key=lambda v: v.mean_m), max(levels, key=lambda v: v.mean_m)}
    first, last = sorted(ends, key=lambda v: v.low)
    if name == "order":
        return (
            f"from {length(first.mean_m)} in presses {first.low:.0f}-{first.high:.0f} "
            f"to {length(last.mean_m)} in presses {last.low:.0f}-{last.high:.0f}"
        )
    return f"from {length(first.mean_m)} at {first.label} to {length(last.mean_m)} at {last.label}"


def _places(c: Comparison) -> str:
    """Return the places of the largest positive and negative residual."""
    points = np.array([p.point_m for p in c.presses])
    means = np.array([p.mean_m for p in c.presses])
    # Averaged over near neighbours: the pattern, not the worst single press.
    distance = np.linalg.norm(points[:, None] - points[None], axis=2)
    near = np.sort(distance, axis=1)[:, : min(5, len(points))].max(axis=1)
    smooth = np.array([means[d <= r].mean() for d, r in zip(distance, near, strict=True)])
    softest, hardest = int(np.argmax(smooth)), int(np.argmin(smooth))
    return (
        f"{_at(c, c.presses[softest], smooth[softest])} and "
        f"{_at(c, c.presses[hardest], smooth[hardest])}"
    )


def _at(c: Comparison, press: PressResidual, mean: float) -> str:
    x, y, z = (1e3 * (v + origin) for v, origin in zip(press.point_m, c.frame_m, strict=True))
    return f"{length(mean)} around ({x:.0f}, {y:.0f}, {z:.0f}) mm (press {press.press})"


def _presses(c: Comparison, settings: ResidualSettings) -> str:
    bad = [p for p in c.worst_presses if p.bad]
    if not bad or len(bad) >= settings.most_outlying_presses:
        worst = c.worst_presses[0]
        return (
            "it differs from press to press without a pattern over the surface, most at press "
            f"{worst.press} ({length(worst.mean_m)}, {sigmas(worst)} sigma)"
        )
    named = ", ".join(f"{p.press} ({length(p.mean_m)}, {sigmas(p)} sigma)" for p in bad[:4])
    rest = f" and {len(bad) - 4} more" if len(bad) > 4 else ""
    if len(bad) == 1:
        return f"press {named} is an outlier"
    return f"presses {named}{rest} are outliers"


def _readings(c: Comparison) -> str:
    if c.test("lag").fires:
        return (
            f"consecutive readings are correlated ({c.lag1:.2f}), without a pattern along anything "
            "else, so that the errors of the map are larger than stated"
        )
    r = c.largest[0]
    return (
        f"one reading is an outlier, press {r.press} in {r.phase} at {r.force_n:.3g} N with "
        f"{length(r.residual_m)} ({abs(r.sigmas):.2g} sigma)"
    )
