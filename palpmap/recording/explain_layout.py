"""The layout of an explanation's recording: residual before and now, error, maps, words."""

from collections.abc import Sequence

import rerun.blueprint as rrb

from palpmap.recording import entities as parts
from palpmap.recording.layout import (
    Curves,
    Stage,
    blueprint,
    body_view,
    events_view,
    figure_views,
    from_above,
    map_view,
    plot_view,
)

BEFORE = "before"  # the first step's residual, always there
MISFIT_MAP = "misfits"  # rms of each press in units of the noise
MISFIT_BEFORE = "misfits_before"
ERROR = "error"
CANDIDATES = "candidates"
PRESSES = "Each press, mm"  # a tab, as there is nothing in it on the timeline that it opens with


def explain_layout(
    stage: Stage,
    limit_um: float,
    largest_rms: float,
    figures: Sequence[str],
    curves: Curves,
    steps: int,
    known: bool,
) -> rrb.Blueprint:
    """Lay out the residual before and now, the error, the maps, and the words.

    Parameters
    ----------
    limit_um : mean residual at the ends of its colour scale
    largest_rms : rms at the bright end of its colour scale, in units of the noise
    figures : names of the figures, each shown in a tab
    curves : least and largest value of each curve
    steps : of the ladder; of a single one nothing was before, and no curve is drawn
    known : there is a true map
    """
    left = _pictures(stage, limit_um, largest_rms, steps, known)
    right = _curves_and_words(figures, curves, steps)
    return blueprint(rrb.Horizontal(left, right, column_shares=[1, 1.25]), parts.ITERATION)


def _pictures(
    stage: Stage, limit_um: float, largest_rms: float, steps: int, known: bool
) -> rrb.Vertical:
    """Lay out the residual before and now, its size, the maps and the body."""
    limit, most = f"{limit_um:.3g}", f"{largest_rms:.2g}"
    residual, size = f"residual ±{limit} µm", f"size, 1 to {most} x noise"
    body = body_view("Body, found modulus", stage)
    maps = [map_view(parts.FOUND_MAP, "Found: Young's modulus", stage)]
    if known:
        maps.append(map_view(parts.TRUE_MAP, "Truth: Young's modulus", stage))
    if steps == 1:
        now = (
            from_above(parts.RESIDUAL_MAP, residual.capitalize(), stage),
            from_above(MISFIT_MAP, f"Its {size}", stage),
        )
        return rrb.Vertical(rrb.Horizontal(*now), rrb.Horizontal(*maps, body))
    return rrb.Vertical(
        rrb.Horizontal(
            from_above(BEFORE, f"Before: {residual}", stage),
            from_above(parts.RESIDUAL_MAP, f"Now: {residual}", stage),
        ),
        rrb.Horizontal(
            from_above(MISFIT_BEFORE, f"Before: {size}", stage),
            from_above(MISFIT_MAP, f"Now: {size}", stage),
        ),
        rrb.Horizontal(*maps, body),
    )


def _curves_and_words(figures: Sequence[str], curves: Curves, steps: int) -> rrb.Vertical:
    """Lay out figures, error and parameters by step, candidates and text."""
    tabs, events = figure_views(figures), events_view()
    plots = [(parts.MODULI, "kPa by step #"), (parts.LENGTHS, "mm by step #")]
    if any(entity.startswith(parts.OTHERS) for entity in curves):
        plots.append((parts.OTHERS, "Effects by step #"))
    error = ("rms_um", "held_out_um", "noise_um")
    pictures = rrb.Tabs(*tabs, active_tab=0) if tabs else events
    drawn = rrb.Horizontal(
        plot_view(ERROR, "Error, µm, by step #", error, curves, whole=False),
        *(plot_view(origin, name, (), curves, whole=False) for origin, name in plots),
    )
    words = rrb.Horizontal(
        rrb.TextDocumentView(origin=CANDIDATES, name="Candidates"),
        rrb.Tabs(
            rrb.TextDocumentView(origin=parts.ABOUT, name="Result"),
            events,
            plot_view("presses", PRESSES, ("measured_mm", "modelled_mm"), curves),
            active_tab=0,
        ),
    )
    if steps == 1:
        return rrb.Vertical(pictures, words, row_shares=[2.0, 1.5])
    return rrb.Vertical(pictures, drawn, words, row_shares=[2.0, 1.1, 1.5])
