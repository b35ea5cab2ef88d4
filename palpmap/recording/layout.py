"""The layout in which a recording opens: the scene and the maps first, then their evidence."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from palpmap.recording import entities as parts
from palpmap.recording.maps import picture_bounds

Curves = Mapping[str, tuple[float, float]]
"""Least and largest value of each curve, by its entity."""

_DARK = (24, 26, 30)
_LEGEND_MARGIN, _LEGEND_ROW = 0.06, 0.13  # of a small plot's height
_LARGEST_LEGEND = 0.65
_SINGLE = (parts.FORCE, parts.TRAVEL)  # plots of one curve, which their title names
_WHOLE = rr.TimeRange(start=rr.TimeRangeBoundary.infinite(), end=rr.TimeRangeBoundary.infinite())


@dataclass(frozen=True)
class Stage:
    """Where things are in the scene, for the eyes of the 3-D views.

    Attributes
    ----------
    lower_m, upper_m : (3,) m, box around the body, body frame
    position_m : (3,) m, origin of the body frame in the world
    """

    lower_m: NDArray[np.float64]
    upper_m: NDArray[np.float64]
    position_m: NDArray[np.float64]

    @property
    def size_m(self) -> NDArray[np.float64]:
        """(3,) m, edges of the box around the body."""
        return self.upper_m - self.lower_m

    @property
    def center_m(self) -> NDArray[np.float64]:
        """(3,) m, centre of the body in its own frame."""
        return 0.5 * (self.lower_m + self.upper_m)


def layout(
    present: Collection[str],
    stage: Stage,
    residual_limit_um: float,
    figures: Sequence[str] = (),
    curves: Curves = MappingProxyType({}),
) -> rrb.Blueprint:
    """Blueprint with the views for which there is something to see.

    Parameters
    ----------
    present : names of parts (see `entities.PARTS`)
    stage : Stage
    residual_limit_um : residual at the ends of the colour scale, in um
    figures : names of the figures, each shown in a tab of its own
    curves : least and largest value of each curve that is complete
    """
    whole = _scan_side(present, stage, figures)
    right = _result_side(present, stage, residual_limit_um, curves)
    if right is not None:
        whole = rrb.Horizontal(whole, right, column_shares=[1.25, 1])
    return blueprint(whole, parts.SIM_TIME)


def blueprint(content: rrb.Container, timeline: str) -> rrb.Blueprint:
    """Return a layout that opens on a timeline, its panels folded away."""
    return rrb.Blueprint(
        content,
        rrb.TimePanel(timeline=timeline, state="collapsed", play_state="following"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        auto_views=False,
        auto_layout=False,
    )


def _scan_side(present: Collection[str], stage: Stage, figures: Sequence[str]) -> rrb.Container:
    """Lay out the scenes, force and travel, the text, figures and events."""
    rows = [_scenes("robot" in present, stage)]
    if "robot" in present:
        rows.append(
            rrb.Horizontal(
                plot_view(parts.FORCE, "Contact force, N"),
                plot_view(parts.TRAVEL, "Travel of the tip since touch, mm"),
            )
        )
    about = rrb.TextDocumentView(origin=parts.ABOUT, name="About")
    words = rrb.Tabs(*figure_views(figures), events_view(), active_tab=0)
    rows.append(rrb.Horizontal(about, words if figures else events_view(), column_shares=[1, 1.6]))
    return rrb.Vertical(*rows, row_shares=[3.0, 1.0, 1.5] if len(rows) == 3 else [3, 1.2])


def _result_side(
    present: Collection[str], stage: Stage, residual_limit_um: float, curves: Curves
) -> rrb.Container | None:
    """Lay out the maps, the presses and the fit; None where there is nothing of them."""
    rows, shares = [], []
    maps = [
        map_view(entity, name, stage)
        for part, entity, name in (
            ("truth", parts.TRUE_MAP, "Truth: Young's modulus"),
            ("fit", parts.FOUND_MAP, "Found: Young's modulus"),
        )
        if part in present
    ]
    if maps:
        rows.append(rrb.Horizontal(*maps))
        shares.append(2.3)
    presses = []
    if "presses" in present or "comparison" in present:
        presses.append(
            plot_view(
                "presses",
                "Each press: measured and modelled, mm",
                ["measured_mm", "modelled_mm"],
                curves,
            )
        )
    if "comparison" in present:
        limit = f"{residual_limit_um:.3g}"
        name = f"Residual: red +{limit}, blue -{limit} µm"
        presses.append(from_above(parts.RESIDUAL_MAP, name, stage))
    if presses:
        rows.append(rrb.Horizontal(*presses))
        shares.append(1.3)
    if "fit" in present:
        rows.append(
            rrb.Horizontal(
                plot_view(parts.MODULI, "Parameters: kPa", (), curves, whole=False),
                plot_view(parts.LENGTHS, "Parameters: mm", (), curves, whole=False),
                plot_view(parts.MISFIT, "Misfit: log10", (), curves, whole=False),
            )
        )
        shares.append(1.1)
    return rrb.Vertical(*rows, row_shares=shares) if rows else None


def _scenes(robot: bool, stage: Stage) -> rrb.Container | rrb.View:
    """Show the arm as a whole beside the body from near, or the body alone."""
    near = body_view("The body, coloured by Young's modulus", stage)
    if not robot:
        return near
    center = stage.position_m + stage.center_m
    reach = max(float(np.linalg.norm(center[:2])), 0.3)
    target = np.array([0.5 * center[0], 0.5 * center[1], 0.65 * reach])
    whole = rrb.Spatial3DView(
        origin="world",
        contents=["$origin/**", f"- /{parts.FORCE_ARROW}", f"- /{parts.PRESSES_MADE}"],
        name="The arm presses on the body",
        background=_DARK,
        eye_controls=eye_at(target, target + reach * np.array([0.9, -2.6, 0.9])),
    )
    return rrb.Horizontal(whole, near)


def body_view(name: str, stage: Stage) -> rrb.View:
    """Look at the body from near."""
    center, size = stage.position_m + stage.center_m, np.linalg.norm(stage.size_m)
    return rrb.Spatial3DView(
        origin="world",
        name=name,
        background=_DARK,
        line_grid=False,
        eye_controls=eye_at(center, center + size * np.array([-0.55, -1.05, 0.75])),
    )


def figure_views(figures: Sequence[str]) -> list[rrb.View]:
    """Show each figure under its name."""
    return [
        rrb.Spatial2DView(origin=f"{parts.FIGURES}/{name}", name=name.replace("_", " "))
        for name in figures
    ]


def events_view() -> rrb.View:
    """Show the event log."""
    return rrb.TextLogView(
        origin=parts.EVENTS,
        name="Events",
        columns=rrb.TextLogColumns(text_log_columns=["LogLevel", "Body"]),
    )


def eye_at(target: NDArray[np.float64], position: NDArray[np.float64]) -> rrb.EyeControls3D:
    """Put the eye of a 3-D view at a position, (3,) m, looking at a target."""
    return rrb.EyeControls3D(position=position, look_target=target, eye_up=(0, 0, 1))


def from_above(entity: str, name: str, stage: Stage) -> rrb.View:
    """Look from above at the painted body, in its frame: x to the right, y up."""
    size = stage.size_m
    # Nearer to the vertical the viewer turns the picture half around
    above = np.array([0.0, -0.08 * size.max(), 1.3 * size[:2].max() + 0.5 * size[2]])
    return rrb.Spatial3DView(
        origin=entity,
        name=name,
        background=_DARK,
        line_grid=False,
        eye_controls=eye_at(stage.center_m, stage.center_m + above),
    )


def map_view(entity: str, name: str, stage: Stage) -> rrb.View:
    """Show both pictures of a map."""
    x_range, y_range = picture_bounds(stage.size_m)
    return rrb.Spatial2DView(
        origin=entity,
        name=name,
        background=_DARK,
        visual_bounds=rrb.VisualBounds2D(x_range=x_range, y_range=y_range),
    )


def plot_view(
    entity: str,
    name: str,
    under: Collection[str] = (),
    curves: Curves = MappingProxyType({}),
    whole: bool = True,
) -> rrb.View:
    """Plot against the timeline, from its start on or only where there are values.

    Above curves that are known there is room for the legend.
    """
    return rrb.TimeSeriesView(
        origin=entity,
        contents=[f"$origin/{u}" for u in under] or "$origin/**",
        name=name,
        plot_legend=rrb.PlotLegend(corner="RightTop", visible=entity not in _SINGLE),
        axis_x=rrb.TimeAxis(view_range=_WHOLE) if whole else None,
        axis_y=_with_room(entity, under, curves),
    )


def _with_room(entity: str, under: Collection[str], curves: Curves) -> rrb.ScalarAxis | None:
    """Return the axis on which a plot's legend stands above its curves, None where unknown."""
    shown = {name.removeprefix(f"{entity}/"): span for name, span in curves.items()
             if name.startswith(f"{entity}/")}  # fmt: skip
    shown = {name: span for name, span in shown.items() if not under or name in under}
    if not shown:
        return None
    rows = len({"true" if name.endswith(".true") else name for name in shown})
    low, high = min(a for a, _ in shown.values()), max(b for _, b in shown.values())
    size = (high - low) or abs(high) or 1.0
    legend = min(_LEGEND_MARGIN + _LEGEND_ROW * rows, _LARGEST_LEGEND)
    return rrb.ScalarAxis(range=(low - 0.05 * size, high + size * legend / (1 - legend)))
