"""The report of a run: one HTML file with its pictures inside, for any browser, offline.

Pictures come first: the found map beside the true one; then the numbers, then what the model does
not explain, then how all this was made.  Every text from a file is escaped.
"""

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from pathlib import Path

import numpy as np

from identify.fit.result import Estimate
from identify.residual.statement import length, sigmas
from palpmap.figures.curves import plain_name
from palpmap.report.html import listing, picture, section, table, write_page
from palpmap.result.finding import Finding, matched
from palpmap.study.frame import frame_shift_m

CAPTIONS = {
    "map": (
        "Young's modulus. White circle: an inclusion of the found map, one radius around its "
        "centre; dashed: of the true map, where that is known. Dots and triangles: places that "
        "were pressed."
    ),
    "uncertainty": "How surely the modulus is known at each place, if the model is right.",
    "residual_place": "Residual = measured less modelled displacement, over the surface.",
    "residual_along": "Mean residual with one standard error; grey: where 95 % of pure noise lies.",
    "residual_tests": "Left: residuals in units of the noise. Right: the questions asked of them.",
    "measured_modelled": "Each press near its largest force: mean displacement and model.",
    "presses": "Single presses: all readings that the fit used, and the fitted model.",
    "convergence": "How the fit got there, iteration by iteration.",
}


def write_report(finding: Finding, pictures: Mapping[str, bytes], path: Path) -> None:
    """Write the report of a run.

    Parameters
    ----------
    finding : Finding
        What was found.
    pictures : mapping
        PNG by name, as `palpmap.figures.fit.draw_figures` gives them; missing ones are left out.
    path : Path
        The HTML file, replaced in one step.
    """
    write_page(path, finding.name, _lead(finding), _sections(finding, pictures))


def _lead(f: Finding) -> str:
    presses, inclusions = len(f.scan.press_ids), len(f.fit.map.inclusions)
    word = "inclusion" if inclusions == 1 else "inclusions"
    return (
        f"Stiffness map from {presses} presses ({len(f.scan)} readings): a background and "
        f"{inclusions} {word}, found in {f.fit.nfev} evaluations of the model."
    )


def _sections(f: Finding, pictures: Mapping[str, bytes]) -> Iterable[str]:
    def shown_picture(name: str) -> str:
        return picture(CAPTIONS[name], pictures[name]) if name in pictures else ""

    beside = "Found map beside the true map" if f.truth is not None else "Found map"
    yield section(beside, shown_picture("map"))
    yield section("What was found", parameter_table(f) + _fit_line(f))
    yield _verdict(f)
    yield section(
        "What the model leaves over",
        "".join(shown_picture(n) for n in ("residual_place", "residual_along", "residual_tests"))
        + _question_table(f),
    )
    yield section("Largest misfits", _misfit_tables(f))
    yield section(
        "Measured and modelled", shown_picture("measured_modelled") + shown_picture("presses")
    )
    yield section(
        "How the fit got there", shown_picture("convergence") + shown_picture("uncertainty")
    )
    yield section("The scan and the time it took", _scan_tables(f))
    yield section("How far to trust this", listing(f.limits))
    yield section("How this was made", table(("", ""), f.how.items(), numeric=False))


def shown(value: float, unit: str) -> str:
    """Return a parameter's value in the unit that the report uses (kPa, mm).

    Examples
    --------
    >>> shown(6012.3, "Pa"), shown(0.0123, "m")
    ('6.012 kPa', '12.30 mm')
    """
    if unit == "Pa":
        return f"{value / 1e3:.4g} kPa"
    if unit == "m":
        return f"{value * 1e3:.2f} mm"
    return f"{value:.4g}" if unit == "1" else f"{value:.4g} {unit}".strip()


def parameter_rows(f: Finding) -> list[tuple[str, str, str, str, bool | None]]:
    """Return name, found, 95 % interval, true value, and whether it lies inside, per parameter.

    Positions are in the scan's own frame.
    """
    true = {} if f.truth is None else matched(f.fit.map, f.truth)
    rows = []
    for name, estimate in f.fit.parameters.items():
        shift = frame_shift_m(name, f.origin_m)
        found = shown(estimate.value + shift, estimate.unit)
        interval = _interval(estimate, shift) if estimate.free else "held fixed"
        if name not in true:
            rows.append((plain_name(name), found, interval, "", None))
            continue
        inside = estimate.lower95 <= true[name] <= estimate.upper95 if estimate.free else None
        rows.append(
            (plain_name(name), found, interval, shown(true[name] + shift, estimate.unit), inside)
        )
    return rows


def parameter_table(f: Finding) -> str:
    """Return the table of parameters as HTML."""
    head = ["Parameter", "Found", "95 % interval"] + ["True", ""] * (f.truth is not None)
    rows = []
    for name, found, interval, true, inside in parameter_rows(f):
        row = [escape(name), escape(found), escape(interval)]
        if f.truth is not None:
            mark = {True: '<span class="yes">inside</span>', None: ""}.get(
                inside, '<span class="no">outside</span>'
            )
            row += [escape(true), mark]
        rows.append(row)
    return table(head, rows, raw=True)


def _interval(e: Estimate, shift: float) -> str:
    low, high = shown(e.lower95 + shift, e.unit), shown(e.upper95 + shift, e.unit)
    return f"{low.split()[0]} to {high}"


def _fit_line(f: Finding) -> str:
    c = f.comparison
    text = (
        f"Error of the displacement {length(c.rms_m, signed=False)} rms, of which noise explains "
        f"{length(c.expected_rms_m, signed=False)}; chi-square per degree of freedom "
        f"{c.chi2_per_dof:.3f}."
    )
    return f"<p>{escape(text)}</p><p>The fit says: {escape(f.fit.message)}.</p>"


def _verdict(f: Finding) -> str:
    c = f.comparison
    kind = "verdict" if c.is_noise else "verdict not"
    head = "The model explains the scan" if c.is_noise else "The model does not explain all"
    return (
        f'<section class="{kind}">\n<h2>{head}</h2>\n<p class="say">{escape(c.statement)}</p>\n'
        f"{listing(c.notes)}</section>"
    )


def _question_table(f: Finding) -> str:
    rows = []
    for t in f.comparison.tests:
        if t.untestable:
            answer, chance = "cannot be tested", ""
        else:
            answer = '<span class="no">yes</span>' if t.fires else "no"
            chance = "&lt; 1e-12" if t.p_adjusted < 1e-12 else f"{t.p_adjusted:.2g}"
        size = f"{t.times_noise:.2g}" if t.times_noise else ""
        rows.append([escape(t.question), answer, size, chance])
    head = ("Question", "Answer", "Size, noise = 1", "Chance under noise")
    return table(head, rows, raw=True)


def _misfit_tables(f: Finding) -> str:
    def place(point: Sequence[float]) -> str:
        return ", ".join(f"{1e3 * v:.1f}" for v in np.array(point) + f.origin_m)

    presses = [
        (
            f"press {p.press}" + (" (stands out)" if p.bad else ""),
            place(p.point_m),
            length(p.mean_m),
            sigmas(p, ".1f"),
            f"{100 * p.softer:+.1f} %",
            f"{p.influence:.2f}",
        )
        for p in f.comparison.worst_presses[:8]
    ]
    readings = [
        (
            f"press {r.press}, {r.phase}",
            place(r.point_m),
            "" if r.time_s is None else f"{r.time_s:.2f} s",
            f"{r.force_n:.3g} N",
            length(r.residual_m),
            f"{r.sigmas:+.1f}",
        )
        for r in f.comparison.largest
    ]
    return (
        table(
            ("Press", "x, y, z in mm", "Mean residual", "Sigmas", "Softer than modelled",
             "Pull on the map, sigmas"),
            presses,
        )
        + "<p></p>"
        + table(("Reading", "x, y, z in mm", "Time", "Force", "Residual", "Sigmas"), readings)
    )  # fmt: skip


def _scan_tables(f: Finding) -> str:
    scan, noise = f.scan, f.fit.noise
    phases = ", ".join(f"{np.sum(scan.phase == p)} {p}" for p in np.unique(scan.phase))
    given = "estimated from the scan" if noise.estimated else "as given"
    radii = ", ".join(f"{1e3 * r:.4g}" for r in np.unique(scan.contact_radii))
    rows = [
        ("Presses", str(len(scan.press_ids))),
        ("Readings", f"{len(scan)} ({phases})"),
        ("Force", f"{scan.force_n.min():.3g} to {scan.force_n.max():.3g} N"),
        ("Displacement", f"up to {1e3 * scan.displacement_m.max():.3g} mm"),
        ("Tip radius", f"{radii} mm"),
        (
            "Noise (1 sd)",
            f"{length(noise.displacement_m, signed=False)} and {1e3 * noise.force_n:.3g} mN, "
            f"{given}",
        ),
    ]
    if scan.has_time:
        rows.insert(2, ("Duration", f"{np.ptp(scan.time_s):.1f} s"))
    times = [(name, f"{seconds:.1f} s") for name, seconds in f.stage_s.items()]
    return (
        '<div class="pair">'
        + table(("", ""), rows, numeric=False)
        + table(("Stage", "Time"), times)
        + "</div>"
    )
