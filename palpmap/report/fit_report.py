"""The report of a fit: one HTML file with its pictures inside, for any browser, offline."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from identify.effects import digits
from identify.residual import Comparison, length, sigmas
from palpmap import units
from palpmap.report.draw import write_page
from palpmap.result.field_tables import field_tables
from palpmap.result.finding import Finding
from palpmap.result.next_step import after_fit
from palpmap.result.posterior_tables import posterior_table, posterior_words
from palpmap.result.press_outcomes import FILE, PressesRecord
from palpmap.result.tables import Cell, Table, number, parameter_table


def write_report(finding: Finding, pictures: Mapping[str, bytes], path: Path) -> None:
    """Write the report of a fit.

    Parameters
    ----------
    pictures : PNG by name, as `palpmap.figures.fit.draw_figures` gives them; a missing one is
        left out
    path : the HTML file, replaced in one step
    """
    study = path.with_name("study.toml")
    write_page(
        path,
        "fit.html",
        name=finding.name,
        f=finding,
        pictures=pictures,
        parameters=parameter_table(finding.parameters, true=finding.true),
        following=after_fit(finding, study) if study.is_file() else (),
        sampled=posterior_table(finding),
        samples=posterior_words(finding),
        field_tables=field_tables(finding.fit, finding.origin_m, finding.scan),
        tests=_test_table(finding.comparison),
        presses=_press_table(finding),
        readings=_reading_table(finding),
        scan=_scan_table(finding),
        outcomes=_outcome_table(path.with_name(FILE)),
        stages=Table.of(
            ("Stage", number("Time")), ((name, f"{s:.1f} s") for name, s in finding.stage_s.items())
        ),
        how=Table.of(("", ""), finding.how.items()),
    )


def _outcome_table(path: Path) -> Table | None:
    """Return a robot's presses that were not simply made, and why; None without presses.json."""
    if not path.is_file():
        return None
    presses = PressesRecord.read(path).presses
    rows = [
        (
            f"press {p.press}",
            Cell(p.outcome, "" if p.outcome in ("made", "retried") else "bad"),
            f"{p.set_force_n:.3g} N",
            p.reason,
        )
        for p in presses
        if p.outcome != "made" or not p.kept or p.reason
    ]
    made = len(presses) - len(rows)
    rows.append((f"the other {made}", Cell("made"), "", "with force and place as set"))
    return Table.of(("Press", "Outcome", number("Set force"), "Reason"), rows)


def _test_table(c: Comparison) -> Table:
    """Return the tests of the residual with their p-values."""
    rows = (
        (
            t.question,
            "cannot be tested" if t.untestable else Cell("yes", "bad") if t.fires else "no",
            digits(t.times_noise) if t.times_noise else "",
            "" if t.untestable else units.p_value(t.p_adjusted),
        )
        for t in c.tests
    )
    return Table.of(("Question", "Answer", number("Size, noise = 1"), number("p-value")), rows)


def _press_table(f: Finding) -> Table:
    """Return the presses with the largest misfits."""
    rows = (
        (
            f"press {p.press}" + (" (outlier)" if p.bad else ""),
            _place(f, p.point_m),
            length(p.mean_m),
            sigmas(p, ".1f"),
            f"{100 * p.softer:+.1f} %",
            f"{p.influence:.2f}",
        )
        for p in f.comparison.worst_presses[:8]
    )
    head = ("Press", *map(number, ("x, y, z in mm", "Mean residual", "Sigmas",
            "Softer than modelled", "Pull on the map, sigmas")))  # fmt: skip
    return Table.of(head, rows)


def _reading_table(f: Finding) -> Table:
    rows = (
        (
            f"press {r.press}, {r.phase}",
            _place(f, r.point_m),
            "" if r.time_s is None else f"{r.time_s:.2f} s",
            f"{r.force_n:.3g} N",
            length(r.residual_m),
            f"{r.sigmas:+.1f}",
        )
        for r in f.comparison.largest
    )
    head = ("x, y, z in mm", "Time", "Force", "Residual", "Sigmas")
    return Table.of(("Reading", *map(number, head)), rows)


def _place(f: Finding, point_m: Sequence[float]) -> str:
    return ", ".join(f"{1e3 * v:.1f}" for v in np.array(point_m) + f.origin_m)


def _scan_table(f: Finding) -> Table:
    scan, noise = f.scan, f.fit.noise
    phases = ", ".join(f"{np.sum(scan.phase == p)} {p}" for p in np.unique(scan.phase))
    given = "estimated from the scan" if noise.estimated else "as given"
    radii = ", ".join(f"{1e3 * r:.4g}" for r in np.unique(scan.contact_radii))
    sizes = f"{units.rms(noise.displacement_m)} and {units.quantity(noise.force_n, 'N')}"
    rows = [
        ("Presses", str(len(scan.press_ids))),
        ("Readings", f"{len(scan)} ({phases})"),
        *([("Duration", f"{np.ptp(scan.time_s):.1f} s")] if scan.has_time else []),
        ("Force", f"{scan.force_n.min():.3g} to {scan.force_n.max():.3g} N"),
        ("Displacement", f"up to {1e3 * scan.displacement_m.max():.3g} mm"),
        ("Tip radius", f"{radii} mm"),
        ("Noise (1 sd)", f"{sizes}, {given}{units.shared_errors(noise.touch_m, noise.lag_s)}"),
    ]
    return Table.of(("", ""), rows)
