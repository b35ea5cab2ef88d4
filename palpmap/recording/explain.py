"""Recording of an explanation: residual on the body, error and candidates, step by step.

The timeline `iteration` counts the steps of the ladder: 0 is the first model, each further one has
one effect more. `sim_time` plays the scan, then the steps, one second each.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr
from matplotlib import colormaps
from numpy.typing import NDArray

from identify.fit import FitIteration, FitResult
from identify.select import Explanation, Step
from palpmap.figures.ladder import press_rms
from palpmap.recording import entities as parts
from palpmap.recording import style as style
from palpmap.recording.explain_layout import (
    BEFORE,
    CANDIDATES,
    ERROR,
    MISFIT_BEFORE,
    MISFIT_MAP,
    explain_layout,
)
from palpmap.recording.explain_text import about_text, candidates_text
from palpmap.recording.fit import (
    dot_radius_m,
    log_iteration,
    log_residuals,
    send_presses,
    style_parameters,
)
from palpmap.recording.layout import Stage
from palpmap.recording.maps import (
    Field,
    MapViews,
    cut_views,
    log_map,
    log_outlines,
    map_views,
    modulus_colors,
    residual_colors,
)
from palpmap.recording.scene import lifted, vertex_normals
from palpmap.recording.stream import Log, RecordingFile
from palpmap.result.explain_words import headline, step_evidence, step_labels, verdict_detail
from palpmap.result.finding import Finding
from palpmap.result.records import ExplainRecord, OtherMapRecord
from palpmap.result.truth import matched
from palpmap.study.open_study import Problem
from palpmap.units import rms
from palpmap.version import __version__

RECORDED_PARTS = ("body", "presses", "fit", "comparison", "events", "about")
_LIFT_M = 0.004


@dataclass(frozen=True)
class _Painted:
    """Dots on the body: points (j, 3) m, and by step mean residual (µm) and rms."""

    ids: NDArray[np.int64]
    points_m: NDArray[np.float64]
    mean_um: list[NDArray[np.float64]]
    rms: list[NDArray[np.float64]]

    @property
    def limit_um(self) -> float:
        """Mean residual at the ends of the colour scale, the same for all steps."""
        return float(max(np.abs(values).max() for values in self.mean_um))

    @property
    def largest_rms(self) -> float:
        """Rms at the end of the colour scale, in units of the noise."""
        return max(2.0, float(max(values.max() for values in self.rms)))


def record_explanation(
    path: Path,
    finding: Finding,
    explained: Explanation,
    record: ExplainRecord,
    problem: Problem,
    figures: Mapping[str, Path],
    following: Sequence[str] = (),
) -> None:
    """Write the recording of an explanation.

    Parameters
    ----------
    path : .rrd file, replaced
    finding : the last step
    record : result.json
    figures : PNG files by name, each shown in a tab
    following : the next steps
    """
    file = RecordingFile(path, finding.name)
    shown = (*RECORDED_PARTS, *(["truth"] if finding.truth is not None else []))
    planned = len(finding.scan.press_ids)
    file.static(
        parts.RUN,
        rr.AnyValues(
            name=finding.name, palpmap=__version__, planned_presses=planned, parts=list(shown)
        ),
    )
    style.style_plots(file)
    _style_errors(file)
    stage, surface = _log_scene(file, finding, problem)
    painted = _painted(explained, surface)
    now = _log_scan(file, finding, surface.dot_m)
    views = _views(finding, explained)
    # Colours of the last map: the error of the first may dwarf it
    span = _span([views[-1], *_true_views(finding)])
    true = {} if finding.truth is None else matched(finding.fit.map, finding.truth)
    names = list(explained.final.fit.values)
    style_parameters(file, names, list(true))
    for view in _true_views(finding):
        log_map(file.static, parts.TRUE_MAP, view, span)
        log_outlines(file.static, parts.TRUE_MAP, true, view, style.TRUE)
    _paint_before(file, painted)
    last = int(finding.scan.press_ids[-1])
    absent = _absent(explained)
    for number, step in enumerate(explained.ladder):
        log = file.at(sim_time=now + 1 + number, press=last, iteration=number)
        fit = step.fit
        values = {**absent, **fit.values}
        point = FitIteration(number, values, fit.chi2, fit.chi2_per_dof, fit.rms_m)
        log_iteration(log, point, true)
        _log_step(log, step, number, painted)
        log_map(log, parts.FOUND_MAP, views[number], span)
        log_outlines(log, parts.FOUND_MAP, _map_parameters(step), views[number], style.FOUND)
        modulus = step.fit.changed_map.modulus(surface.vertices_m)
        colors = modulus_colors(modulus, span)
        log(parts.SURFACE, rr.Mesh3D.from_fields(vertex_colors=colors))
        _log_events(log, explained, problem, number, record.other_map)
    _log_comparison(file, finding, explained)
    for name, picture in figures.items():
        file.static(f"{parts.FIGURES}/{name}", rr.EncodedImage(path=picture))
    text = about_text(finding.name, explained, record, following)
    file.static(parts.ABOUT, rr.TextDocument(text, media_type="text/markdown"))
    known = finding.truth is not None
    ends = painted.limit_um, painted.largest_rms
    steps = len(explained.ladder)
    file.show(explain_layout(stage, *ends, list(figures), file.curves, steps, known))
    file.close()


@dataclass(frozen=True)
class _Surface:
    """The body's surface: vertices (n, 3) m with normals (n, 3); `dot_m`, size of a press's dot."""

    vertices_m: NDArray[np.float64]
    normals: NDArray[np.float32]
    dot_m: float


def _log_scene(file: RecordingFile, finding: Finding, problem: Problem) -> tuple[Stage, _Surface]:
    mesh = problem.body.coarse.mesh
    used, local = np.unique(mesh.boundary[:, :3], return_inverse=True)
    vertices, triangles = mesh.nodes[used], local.reshape(-1, 3).astype(np.int32)
    normals = vertex_normals(vertices, triangles)
    lower, upper = vertices.min(axis=0), vertices.max(axis=0)
    file.static(
        parts.SURFACE,
        rr.Mesh3D(
            vertex_positions=vertices, triangle_indices=triangles, vertex_normals=normals
        ),
    )  # fmt: skip
    for entity in (parts.RESIDUAL_MAP, BEFORE, MISFIT_MAP, MISFIT_BEFORE):
        file.static(
            f"{entity}/body",
            rr.Mesh3D(
                vertex_positions=vertices,
                triangle_indices=triangles,
                vertex_normals=normals,
                albedo_factor=style.DARK_GREY,
            ),
        )
    dot = 0.1 * float((upper - lower).max()) / np.sqrt(len(finding.scan.press_ids))
    return Stage(lower, upper, np.zeros(3)), _Surface(vertices, normals, dot)


def _log_scan(file: RecordingFile, finding: Finding, dot_m: float) -> float:
    """Log the presses as measured; return the time at which the last was read, s."""
    scan = finding.scan
    times = _press_times(finding)
    _send(file, parts.MEASURED, finding, 1e3 * scan.at_largest_force(scan.displacement_m))
    points = rr.Points3D(scan.contact_points, radii=dot_m, colors=style.TRUE)
    file.static(parts.PRESSES_MADE, points)
    return float(times.max())


def _press_times(finding: Finding) -> NDArray[np.float64]:
    scan = finding.scan
    if not scan.has_time:
        return np.arange(len(scan.press_ids), dtype=float)
    times = scan.time_s[scan.deepest_rows]
    return times - float(scan.time_s.min())


def _send(
    file: RecordingFile, entity: str, finding: Finding, values: NDArray[np.float64]
) -> None:  # fmt: skip
    ids = finding.scan.press_ids.astype(np.int64)
    send_presses(file, entity, ids, _press_times(finding), values)


def _views(finding: Finding, explained: Explanation) -> list[MapViews]:
    return [_view(finding, step.fit, step.fit.changed_map.modulus) for step in explained.ladder]


def _true_views(finding: Finding) -> list[MapViews]:
    truth = finding.truth
    return [] if truth is None else [_view(finding, finding.fit, truth.modulus)]


def _view(finding: Finding, fit: FitResult, modulus: Field) -> MapViews:
    if fit.field is not None:
        return cut_views(finding, fit, modulus)
    return map_views(modulus, finding.outline.lower_m, finding.outline.upper_m)


def _span(views: list[MapViews]) -> tuple[float, float]:
    return min(v.range_pa[0] for v in views), max(v.range_pa[1] for v in views)


def _map_parameters(step: Step) -> dict[str, float]:
    stiffness = step.fit.map
    return dict(zip(stiffness.names, stiffness.values.tolist(), strict=True))


def _painted(explained: Explanation, surface: _Surface) -> _Painted:
    presses = explained.final.comparison.presses
    points = np.array([p.point_m for p in presses])
    return _Painted(
        np.array([p.press for p in presses], np.int64),
        lifted(points, surface.vertices_m, surface.normals, _LIFT_M),
        [
            1e6 * np.array([p.mean_m for p in step.comparison.presses])
            for step in explained.ladder
        ],
        [press_rms(step) for step in explained.ladder],
    )  # fmt: skip


def _paint_before(file: RecordingFile, painted: _Painted) -> None:
    colors = residual_colors(painted.mean_um[0], painted.limit_um)
    file.static(f"{BEFORE}/points", _dots(painted, colors))
    file.static(f"{MISFIT_BEFORE}/points", _dots(painted, _rms_colors(painted, 0)))


def _dots(painted: _Painted, colors: NDArray[np.uint8]) -> rr.Points3D:
    return rr.Points3D(painted.points_m, radii=dot_radius_m(painted.points_m), colors=colors)


def _rms_colors(painted: _Painted, number: int) -> NDArray[np.uint8]:
    """Colours (j, 3): dark is noise or less, bright is the largest of all steps."""
    share = (painted.rms[number] - 1) / (painted.largest_rms - 1)
    return colormaps["magma"](np.clip(0.15 + 0.85 * share, 0.15, 1), bytes=True)[..., :3]


def _style_errors(file: RecordingFile) -> None:
    for name, color, label in (
        ("rms_um", style.MEASURED, "error of the fit"),
        ("held_out_um", style.FOUND, "error in cross-validation"),
        ("noise_um", style.GREY, "noise alone"),
        ("chi2_per_dof", style.MODELLED, "chi2/dof"),
    ):
        file.static(f"{ERROR}/{name}", rr.SeriesLines(colors=color, names=label, widths=2.5))


def _absent(explained: Explanation) -> dict[str, float]:
    """Amplitudes of the effects before they were added: without them a plot would be one point."""
    return {
        f"{part.effect.name}.{name}": null
        for part in explained.final.fit.model.effects
        for name, null in part.effect.null.items()
    }


def _log_step(log: Log, step: Step, number: int, painted: _Painted) -> None:
    for name, value in (
        ("rms_um", 1e6 * step.fit.rms_m),
        ("held_out_um", 1e6 * step.cross_validation.rms_m),
        ("noise_um", 1e6 * step.comparison.expected_rms_m),
        ("chi2_per_dof", step.fit.chi2_per_dof),
    ):
        log(f"{ERROR}/{name}", rr.Scalars(value))
    log_residuals(log, painted.ids, painted.points_m, painted.mean_um[number], painted.limit_um)
    log(f"{MISFIT_MAP}/points", _dots(painted, _rms_colors(painted, number)))
    log(CANDIDATES, rr.TextDocument(candidates_text(step), media_type="text/markdown"))


def _log_events(
    log: Log, explained: Explanation, problem: Problem, number: int, other: OtherMapRecord | None
) -> None:
    step = explained.ladder[number]
    label = step_labels([s.fit.effect_names for s in explained.ladder])[number]
    text = (
        f"{label}: error {rms(step.fit.rms_m)}, in cross-validation "
        f"{rms(step.cross_validation.rms_m)}, chi2/dof {step.fit.chi2_per_dof:.3g}"
    )
    log(parts.EVENTS, rr.TextLog(text, level="INFO"))
    if number:
        log(parts.EVENTS, rr.TextLog(step_evidence(explained, problem, number), level="INFO"))
    level = "INFO" if step.comparison.is_noise else "WARN"
    log(parts.EVENTS, rr.TextLog(step.comparison.statement, level=level))
    if step is explained.final:
        sure = explained.verdict in ("nothing_missing", "explained")
        text = f"{headline(explained)} {verdict_detail(explained, other)}"
        log(parts.EVENTS, rr.TextLog(text, level="INFO" if sure else "WARN"))


def _log_comparison(file: RecordingFile, finding: Finding, explained: Explanation) -> None:
    """Log the last model's displacement and residual of each press near its largest force."""
    fit, mean = explained.final.fit, finding.scan.at_largest_force
    _send(file, parts.MODELLED, finding, 1e3 * mean(fit.at.predicted_m))
    _send(file, parts.RESIDUAL, finding, 1e6 * mean(fit.residual_m))
