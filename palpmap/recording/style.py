"""Colours, and the style of the curves."""

import rerun as rr

from palpmap.recording import entities as parts
from palpmap.recording.stream import RecordingFile

TRUE = (245, 245, 245)
FOUND = (255, 140, 60)
MEASURED = (255, 200, 60)
MODELLED = (80, 190, 255)
FORCE = (255, 235, 90)
GREY = (150, 155, 160)
DARK_GREY = (90, 94, 100)


def style_plots(file: RecordingFile) -> None:
    """Give the curves and the force arrow their colours and names, once for all."""
    for entity, color, label in (
        (parts.FORCE, FORCE, "contact force"),
        (parts.TRAVEL, MEASURED, "travel"),
        (f"{parts.MISFIT}/rms_um", MEASURED, "log10 rms, µm"),
        (f"{parts.MISFIT}/chi2_per_dof", MODELLED, "log10 chi2/dof"),
    ):
        file.static(
            entity,
            rr.SeriesLines(colors=color, names=label, widths=1.5, aggregation_policy="MinMax"),
        )
    for entity, color, label, marker, size in (
        (parts.MEASURED, MEASURED, "measured", rr.components.MarkerShape.Circle, 2.5),
        (parts.MODELLED, MODELLED, "modelled", rr.components.MarkerShape.Cross, 3.5),
    ):
        dots = rr.SeriesPoints(colors=color, names=label, markers=marker, marker_sizes=size)
        file.static(entity, dots)
    file.static(
        parts.FORCE_ARROW,
        rr.Arrows3D.from_fields(colors=[FORCE], radii=[0.0015], show_labels=True),
    )
