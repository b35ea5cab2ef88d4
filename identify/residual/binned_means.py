"""Mean residual by force, time in the press, phase and order of pressing."""

import numpy as np

from identify.residual.comparison import Level
from identify.residual.directions import PHASES, bins, force_bins, since_touch, time_bins
from identify.residual.settings import RESIDUAL, ResidualSettings
from identify.residual.whitened import Whitened


def residual_levels(
    w: Whitened, settings: ResidualSettings = RESIDUAL
) -> dict[str, tuple[Level, ...]]:
    """Return the weighted mean residual in the bins of each dimension of the scan."""
    levels = {}
    by_force = force_bins(w, settings)
    if not isinstance(by_force, str):
        levels["force"] = _levels(w, by_force, w.force_n, "{:.3g} N")
    by_time = time_bins(w, settings)
    if not isinstance(by_time, str):
        levels["time"] = _levels(w, by_time, since_touch(w), "{:.3g} s")
    present = [p for p in PHASES if np.any(w.scan.phase == p)]
    if len(present) > 1:
        index = np.array([present.index(p) if p in present else -1 for p in w.scan.phase])
        levels["phase"] = tuple(_level(w, index == i, name, i, i) for i, name in enumerate(present))
    if w.presses >= settings.least_trend_presses:
        numbers = w.scan.press_ids[w.press_index].astype(float)
        index = bins(w.press_index.astype(float), settings.bins)
        levels["order"] = _levels(w, index, numbers, "press {:.0f}")
    return levels


def _levels(w: Whitened, index: np.ndarray, values: np.ndarray, label: str) -> tuple[Level, ...]:
    out = []
    for b in range(int(index.max()) + 1):
        inside = index == b
        at = values[inside]
        text = label.format(float(np.median(at)))
        out.append(_level(w, inside, text, float(at.min()), float(at.max())))
    return tuple(out)


def _level(w: Whitened, inside: np.ndarray, label: str, low: float, high: float) -> Level:
    weight = 1 / w.sigma_m[inside] ** 2
    mean = float(np.sum(weight * w.residual_m[inside]) / np.sum(weight))
    return Level(label, low, high, mean, float(1 / np.sqrt(np.sum(weight))), int(inside.sum()))
