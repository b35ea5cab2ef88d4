"""Parameters and misfit against iteration, residuals on the body."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from palpmap.recording import entities as parts
from palpmap.recording.maps import residual_colors
from palpmap.recording.stream import Log, RecordingFile

if TYPE_CHECKING:
    from identify.fit import FitIteration

_PALETTE = (
    (255, 140, 60),
    (80, 190, 255),
    (120, 220, 120),
    (240, 110, 160),
    (200, 160, 255),
    (240, 220, 90),
    (90, 220, 210),
    (210, 150, 110),
    (170, 180, 190),
)
_LABELLED = 3  # largest residuals that are named on the map
_APART = 0.4  # of the scan's width: names closer to each other overlap


def style_parameters(file: RecordingFile, names: list[str], true_names: list[str]) -> None:
    """Give each parameter a colour; its true value is a pale line of the same colour."""
    shown: dict[str, int] = {}  # plot -> curves in it
    for name in names:
        entity, _ = parts.parameter_entity(name)
        plot, label = entity.rsplit("/", 1)
        color = _PALETTE[shown.setdefault(plot, 0) % len(_PALETTE)]
        shown[plot] += 1
        file.static(entity, rr.SeriesLines(colors=color, widths=2.5, names=label))
        if name in true_names:
            true_entity, _ = parts.parameter_entity(name, true=True)
            pale = tuple(c // 2 for c in color)
            file.static(true_entity, rr.SeriesLines(colors=pale, widths=1, names="true (thin)"))


def log_iteration(log: Log, step: "FitIteration", true_parameters: Mapping[str, float]) -> None:
    """Log the numbers of one step; the misfit also as log10, as it falls over decades."""
    for name, value in step.parameters.items():
        entity, factor = parts.parameter_entity(name)
        log(entity, rr.Scalars(factor * value))
        if name in true_parameters:
            entity, factor = parts.parameter_entity(name, true=True)
            log(entity, rr.Scalars(factor * true_parameters[name]))
    for entity, value in ((parts.RMS, 1e6 * step.rms_m), (parts.CHI2, step.chi2_per_dof)):
        log(entity, rr.Scalars(value))
        log(f"{parts.MISFIT}/{entity.split('/')[-1]}", rr.Scalars(np.log10(max(value, 1e-30))))


def log_residuals(
    log: Log,
    press_ids: NDArray[np.int64],
    points_m: NDArray[np.float64],
    residual_um: NDArray[np.float64],
    limit_um: float,
) -> None:
    """Paint each press's residual at its contact point, and name the largest that lie apart.

    Parameters
    ----------
    log : log at the end of the run
    press_ids, points_m, residual_um : (j,), (j, 3) in m, body frame, and (j,)
    limit_um : residual at the ends of the colour scale
    """
    log(
        f"{parts.RESIDUAL_MAP}/points",
        rr.Points3D(
            points_m,
            radii=dot_radius_m(points_m),
            colors=residual_colors(residual_um, limit_um),
        ),
    )
    apart = _APART * float(np.ptp(points_m, axis=0).max())
    named: list[int] = []
    for i in np.argsort(-np.abs(residual_um)).tolist():
        if len(named) < _LABELLED and all(
            np.linalg.norm(points_m[i] - points_m[j]) > apart for j in named
        ):
            named.append(i)
    log(
        f"{parts.RESIDUAL_MAP}/largest",
        rr.Points3D(
            points_m[named],
            radii=0.0,
            labels=[f"press {press_ids[i]}: {residual_um[i]:+.3g} µm" for i in named],
            colors=(255, 255, 255),
            show_labels=True,
        ),
    )


def dot_radius_m(points: NDArray[np.float64]) -> float:
    """Return the radius of dots at points (j, 3) m that nearly touch; 2 mm of a single one."""
    extent = float(np.ptp(points, axis=0).max())
    return 0.45 * (extent / np.sqrt(len(points)) if extent > 0 else 0.005)


def send_presses(
    file: RecordingFile,
    entity: str,
    press_ids: NDArray[np.int64],
    times_s: Sequence[float] | NDArray[np.float64],
    values: NDArray[np.float64],
) -> None:
    """Write one value (j,) a press, on the timelines of simulation and presses."""
    when = [
        rr.TimeColumn(parts.SIM_TIME, duration=times_s),
        rr.TimeColumn(parts.PRESS, sequence=press_ids),
    ]
    file.stream.send_columns(entity, when, rr.Scalars.columns(scalars=values))
    file.count(entity, values)
