"""A run folder with a fit becomes figures, a report that stands alone, and a summary."""

import io
import json
import re
from contextlib import redirect_stdout
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.contour import ContourSet
from matplotlib.figure import Figure
from rich.console import Console

from identify.fit.files import write_fit
from identify.fit.result import Estimate, FitResult
from identify.fit.search import FitIteration
from identify.map.gaussian_map import GaussianMap, Inclusion
from identify.measurement.errors_in_variables import whitening
from identify.measurement.noise import Noise
from models.errors import InputError
from models.scan import Scan
from models.scan_file import write_scan
from palpmap.api import read_run
from palpmap.commands.compare import run_compare
from palpmap.console import Output
from palpmap.figures.curves import draw_convergence, draw_curves
from palpmap.figures.cuts import cuts, sample
from palpmap.figures.forms import draw_forms
from palpmap.figures.map import _decorate, draw_map, draw_uncertainty
from palpmap.figures.residual import draw_tests
from palpmap.figures.style import png, settle
from palpmap.report.fit_console import summary
from palpmap.report.fit_report import _outcome_table, write_report
from palpmap.result.finding import Finding
from palpmap.result.next_step import after_fit
from palpmap.result.outline import Outline, study_outline
from palpmap.result.press_outcomes import PressesRecord, press_record
from palpmap.result.records import FormCurveRecord
from palpmap.result.tables import parameter_table
from palpmap.result.truth import TrueBodyRecord, TruthRecord, matched, read_truth
from palpmap.run_files.fit_run import with_making
from palpmap.run_folder import RunFolder
from palpmap.study.study import load_study
from sim.scan.outcome import Judgement, PressOutcome
from tests.palpmap.report.page import Page

SIGNATURE = b"\x89PNG\r\n\x1a\n"
NASTY = "<script>alert('x')</script> & [bold]\"phantom\""
TRUE = GaussianMap(5000.0, (Inclusion(12000.0, 0.03, 0.04, 0.02, 0.01),))
FOUND = GaussianMap(5020.0, (Inclusion(11500.0, 0.0301, 0.0399, 0.0195, 0.0102),))
NOISE = Noise(2e-5, 5e-3)


def small_scan(origin=(0.0, 0.0, 0.0), offset_n=0.0):
    """25 presses of 8 readings on a block; compliance 0.01 m/N, two phases."""
    rng = np.random.default_rng(0)
    axis = np.linspace(0.01, 0.05, 5)
    x, y = (g.ravel() for g in np.meshgrid(axis, axis))
    points = np.column_stack([x, y, np.full(25, 0.03)]) + origin
    force = np.r_[np.linspace(0.05, 0.3, 5), 0.2, 0.12, 0.05]
    n, m = len(force), 25 * len(force)
    return Scan(
        press=np.repeat(np.arange(25), n),
        time_s=0.1 * np.arange(m),
        phase=np.tile(np.r_[["load"] * 5, ["unload"] * 3], 25),
        point_m=np.repeat(points, n, axis=0),
        direction=np.tile([0, 0, -1.0], (m, 1)),
        force_n=np.tile(force, 25) + rng.normal(0, NOISE.force_n, m),
        displacement_m=0.01 * (np.tile(force, 25) - offset_n)
        + rng.normal(0, NOISE.displacement_m, m),
        probe_radius_m=np.full(m, 0.004),
    )


def small_fit(scan):
    """The record of a fit whose compliance is the scan's, with one common parameter free."""
    e, s, latent = whitening(scan.displacement_m, scan.force_n, np.array(0.01), NOISE)
    std = dict(zip(FOUND.names, (30.0, 900.0, 1e-4, 1e-4, 8e-4, 3e-4), strict=True))
    estimates = {
        name: Estimate(v, std[name], "Pa" if name.endswith("_pa") else "m",
                       v - 2 * std[name], v + 2 * std[name], name != "inclusion_1.radius_m")
        for name, v in zip(FOUND.names, FOUND.values.tolist(), strict=True)
    }  # fmt: skip
    free = [n for n in FOUND.names if estimates[n].free]
    history = tuple(
        FitIteration(i, {n: e.value * (1 + 0.5**i) for n, e in estimates.items()}, 300.0, 1.5, 1e-4)
        for i in range(4)
    )
    jacobian = np.zeros((25, len(free)))
    jacobian[:, 0] = -0.01 / 5020
    return FitResult(
        map=FOUND, estimates=estimates, covariance_names=tuple(free),
        covariance=np.diag([std[n] ** 2 for n in free]), noise=NOISE,
        press_index=scan.press_index, force_n=scan.force_n, displacement_m=scan.displacement_m,
        latent_force_n=latent, predicted_m=0.01 * scan.force_n, sigma_m=s, residual_m=e,
        compliance_m_per_n=np.full(25, 0.01), compliance_jacobian=jacobian,
        discretization_error=np.full(25, 0.03), history=history, chi2=200.0, chi2_per_dof=1.0,
        rms_m=5e-5, success=True, message="converged <quickly>", nfev=7,
    )  # fmt: skip


def make_run(folder, *, truth=True, origin=(0.0, 0.0, 0.0), **scan_options):
    with RunFolder("fit", folder, seed=7, settings={"optimizer": "gauss-newton"}) as run:
        scan = small_scan(origin, **scan_options)
        write_scan(scan, run / "scan.csv")
        (run / "study.toml").write_text(
            f"[study]\nname = '''{NASTY}'''\nscan = 'scan.csv'\n[body]\nshape = 'block'\n"
            "size_m = [0.06, 0.06, 0.03]\npoisson_ratio = 0.45\n"
            f"origin_m = {list(origin)}\n[probe]\ntip = 'flat'\nradius_m = 0.004\n"
            "[noise]\ndisplacement_m = 2e-5\nforce_n = 5e-3\n",
            encoding="utf-8",
        )
        write_fit(small_fit(scan), run / "fit.json")
        if truth:
            body = TrueBodyRecord(background_pa=5000.0, inclusions=TRUE.inclusions[:1])
            TruthRecord(body=body).write(run / "truth.json")
    return folder


def load_finding(run: Path) -> Finding:
    """Return the finding of a run folder."""
    return with_making(read_run(run).fit.finding, run)


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    run = make_run(tmp_path_factory.mktemp("with space") / "a run")
    out = io.StringIO()
    with redirect_stdout(out):
        passed = run_compare(source=run, out=None, output=Output(json=True))
    return run, passed, json.loads(out.getvalue())


@pytest.mark.slow
def test_noise_passes_and_is_said_in_json(done):
    run, passed, record = done
    assert passed is True
    assert record["is_noise"] is True
    assert record["statement"].startswith("The residual is noise")
    assert json.loads((run / "comparison.json").read_text())["statement"] == record["statement"]
    commands = [r["command"] for r in json.loads((run / "run.json").read_text())["runs"]]
    assert commands == ["fit", "compare"]


def test_the_report_is_well_formed_and_needs_nothing_from_elsewhere(done):
    page = Page((done[0] / "report.html").read_text(encoding="utf-8"))
    assert "script" not in page.tags
    assert page.tags.count("img") == 8
    assert all(link.startswith("data:image/png;base64,") for link in page.links)


def test_on_a_telephone_tables_scroll_in_their_own_box_and_nothing_asks_for_more_width(done):
    raw = (done[0] / "report.html").read_text(encoding="utf-8")
    assert raw.count("<table") == raw.count('<div class="wide"><table') > 3
    style = raw[raw.index("<style>") : raw.index("</style>")]
    assert ".wide { overflow-x: auto; }" in style
    assert "img { display: block; width: 100%; height: auto;" in style
    own = re.sub(r"min\([^)]*100%\)|max-width: \d+px", "", style)
    assert max(float(px) for px in re.findall(r"([\d.]+)px", own)) < 100


def test_the_report_shows_hostile_names_as_text(done):
    raw = (done[0] / "report.html").read_text(encoding="utf-8")
    assert "<script" not in raw
    assert NASTY in Page(raw).text
    assert "converged <quickly>" in Page(raw).text


def test_the_report_says_what_was_found_and_how(done):
    text = Page((done[0] / "report.html").read_text(encoding="utf-8")).text
    for words in (
        "5.020 kPa", "4.960 to 5.080 kPa", "held", "seed 7", "optimizer = gauss-newton",
        "Poisson's ratio 0.45 was given", "off the finer model by up to 3 %", "SHA-256",
    ):  # fmt: skip
        assert words in text


def test_every_picture_is_a_png_that_is_not_blank(done):
    from matplotlib.image import imread

    paths = sorted((done[0] / "figures").glob("*.png"))
    assert len(paths) == 8
    for path in paths:
        assert path.read_bytes().startswith(SIGNATURE)
        picture = imread(path)[..., :3]
        assert picture.shape[1] > 500
        assert picture.std() > 0.02, path.name


def test_every_question_that_can_be_tested_has_a_dot_at_its_chance(tmp_path):
    finding = load_finding(make_run(tmp_path / "run"))
    answers = draw_tests(finding).axes[1]
    dots = {y: x for line in answers.lines[:-1] for x, y in np.asarray(line.get_xydata()).tolist()}
    tests = finding.comparison.tests[::-1]
    chances = {row: t.p_adjusted for row, t in enumerate(tests) if not t.untestable}
    assert 1.0 in chances.values()  # its bar has no length
    assert dots == pytest.approx({row: -np.log10(max(p, 1e-12)) for row, p in chances.items()})


@pytest.mark.parametrize("draw", [draw_convergence, draw_curves])
def test_no_legend_lies_on_a_panel(tmp_path, draw):
    figure = draw(load_finding(make_run(tmp_path / "run")))
    settle(figure)
    legends = [axes.get_legend() for axes in figure.axes if axes.get_legend()] + figure.legends
    assert legends
    panels = [axes.get_window_extent() for axes in figure.axes]
    boxes = [legend.get_window_extent() for legend in legends]
    assert not any(box.overlaps(panel) for box in boxes for panel in panels)
    assert all(figure.bbox.padded(1).containsy(y) for box in boxes for y in (box.y0, box.y1))


def test_structure_fails_the_criterion_and_the_screen_holds_the_summary(tmp_path, capsys):
    run = make_run(tmp_path / "run", offset_n=0.02)
    out = tmp_path / "elsewhere"
    assert run_compare(source=run, out=out, output=Output(quiet=True)) is False
    assert capsys.readouterr().out == ""
    assert not (run / "report.html").exists()
    assert (out / "report.html").exists()
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(*summary(load_finding(run)), sep="\n")
    lines = console.export_text().splitlines()
    assert len(lines) <= 40
    assert lines[0].startswith("The residual is not noise")
    assert any(NASTY[:20] in line for line in lines)
    assert "it varies most with the force" in " ".join(" ".join(lines).split())


def test_an_inclusion_whose_weight_may_be_zero_may_not_be_there(tmp_path):
    run, fit = make_run(tmp_path / "run"), small_fit(small_scan())
    assert not any("may not be there" in doubt for doubt in load_finding(run).doubts)
    name = "inclusion_1.weight_pa"
    wide = replace(fit.parameters[name], lower95=-1.0)
    lost = replace(fit, estimates={**fit.parameters, name: wide}, at_bound=("inclusion_1.z_m",))
    write_fit(lost, run / "fit.json")
    (doubt,) = load_finding(run).doubts
    assert doubt.startswith("Inclusion 1 may not be there: its weight may be zero")
    assert doubt.endswith("Set inclusions = 0 under [map], or scan closer.")


def test_how_sure_a_map_is_leaves_out_an_inclusion_that_may_not_be_there(tmp_path):
    finding, name = load_finding(make_run(tmp_path / "run", truth=False)), "inclusion_1.weight_pa"
    fit = finding.fit
    wide = replace(fit.parameters[name], lower95=-1.0)
    lost = replace(fit, estimates={**fit.parameters, name: wide})
    for one, even in ((fit, False), (lost, True)):
        figure = draw_map(replace(finding, fit=one))
        sure = next(a for a in figure.axes if a.get_title().startswith("How sure"))
        shown = sure.images[0].get_array()
        assert (np.ptp(shown.compressed()) < 1e-9) == even
        assert sure.get_title() == "How sure" + even * ", the dotted one left out"


def test_an_inclusion_that_was_not_found_is_said_beside_the_verdict(tmp_path):
    run = make_run(tmp_path / "run")
    lost = replace(small_fit(small_scan()), at_bound=("inclusion_1.y_m",), success=False)
    write_fit(lost, run / "fit.json")
    finding = load_finding(run)
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(*summary(finding), sep="\n")
    lines = console.export_text().splitlines()
    write_report(finding, {}, tmp_path / "report.html")
    text = Page((tmp_path / "report.html").read_text(encoding="utf-8")).text
    for sentence in (
        "Not found: inclusion 1 y stands at the bound of the search.",
        "The search did not converge.",
    ):
        assert sentence in lines[:4]
        assert sentence in text
    assert "in doubt" in text
    assert "The model explains the scan" not in text
    assert sum("at its bound" in line for line in lines) == 1


def test_the_step_after_a_bad_reading_leaves_it_out(tmp_path):
    run = make_run(tmp_path / "run")
    good = load_finding(run)
    study, force = run / "study.toml", good.scan.force_n.copy()
    row = len(force) // 2
    force[row] = 30.0
    bad = replace(good, scan=good.scan.replace(force_n=force))
    for is_noise, finding, command in (
        (False, good, "diagnose"), (True, bad, "limits"), (False, bad, "--without-outliers"),
    ):  # fmt: skip
        judged = replace(finding, comparison=replace(finding.comparison, is_noise=is_noise))
        (step,) = after_fit(judged, study)
        assert command in step
    assert f"press {good.scan.press[row]};" in step


@pytest.mark.parametrize(
    ("is_noise", "ended", "step"),
    [(True, True, "map.vti"), (False, True, "explain"), (False, False, "state the noise")],
)
def test_the_step_after_a_free_map_is_to_look_at_it_only_if_it_explains_the_scan(
    is_noise, ended, step, tmp_path
):
    good = load_finding(make_run(tmp_path / "run"))
    fit: Any = SimpleNamespace(field=object(), success=ended)
    comparison = replace(good.comparison, is_noise=is_noise)
    (said,) = after_fit(replace(good, fit=fit, comparison=comparison), tmp_path / "study.toml")
    assert step in said


def test_without_a_truth_the_report_stands_and_names_none(tmp_path):
    finding = load_finding(make_run(tmp_path / "run", truth=False))
    picture = png(draw_map(finding))
    assert picture.startswith(SIGNATURE)
    assert draw_uncertainty(finding) is None  # It stands beside the found map already.
    write_report(finding, {"map": picture}, tmp_path / "report.html")
    text = Page((tmp_path / "report.html").read_text(encoding="utf-8")).text
    assert "Found map beside" not in text
    assert "s.e." not in text
    headings = [c.heading for c in parameter_table(finding.parameters, true=finding.true).columns]
    assert headings == ["Parameter", "Found", "95 % interval"]


def test_the_colours_of_a_map_of_hard_and_soft_have_plain_numbers(tmp_path):
    finding = load_finding(make_run(tmp_path / "run", truth=False))
    hole = finding.fit.map.changed({"inclusion_1.weight_pa": -0.95 * finding.fit.map.background_pa})
    figure = draw_map(replace(finding, fit=replace(finding.fit, map=hole)))
    settle(figure)
    (bar,) = (axes for axes in figure.axes if "modulus" in axes.get_xlabel())
    texts = [label.get_text() for label in bar.get_xticklabels(which="both")]
    numbers = [float(text) for text in texts if text]
    assert len(numbers) >= 3
    assert max(numbers) > 8 * min(numbers)


def test_an_effect_that_was_fitted_too_is_told_and_leaves_the_maps_picture_alone(tmp_path):
    finding = load_finding(make_run(tmp_path / "run", truth=False))
    fit = finding.fit
    names, estimates = fit.covariance_names, fit.parameters
    free, share = len(names), Estimate(0.67, 0.1, "1", 0.5, 0.8, True)
    covariance = np.zeros((free + 1, free + 1))
    covariance[0, 0], covariance[1:, 1:] = 0.01, fit.covariance  # in another order, too
    more = replace(
        fit,
        covariance_names=("rigid_tip.share", *names),
        covariance=covariance,
        estimates={**estimates, "rigid_tip.share": share},
    )
    with_effect = replace(finding, fit=more)
    assert png(draw_map(with_effect)) == png(draw_map(finding))
    table = parameter_table(with_effect.parameters)
    cells = [tuple(cell.text for cell in row) for row in table.rows]
    assert ("rigid_tip.share", "0.67", "0.50 to 0.80") in cells


def test_positions_are_told_in_the_scans_own_frame(tmp_path):
    finding = load_finding(make_run(tmp_path / "run", origin=(-0.1, 0.2, 0.5)))
    table = parameter_table(finding.parameters, true=finding.true)
    cells = {row[0].text: row for row in table.rows}
    assert [c.text for c in cells["inclusion 1 x"][1::2]] == ["-69.90 mm", "-70.00 mm"]
    assert cells["inclusion 1 x"][4].tone == "good"
    assert [c.text for c in cells["inclusion 1 z"][1::2]] == ["519.5 mm", "520.00 mm"]
    assert cells["inclusion 1 z"][4].tone == "good"
    assert cells["inclusion 1 radius"][4].text == ""


def test_the_cuts_go_through_the_strongest_inclusion_and_towards_the_other(tmp_path):
    finding = load_finding(make_run(tmp_path / "run"))
    horizontal, vertical = cuts(finding)
    assert (horizontal.normal, horizontal.at_m) == (2, pytest.approx(0.030 - 0.0195))
    assert (vertical.normal, vertical.at_m) == (1, 0.0399)
    values = sample(finding, vertical, finding.fit.map.modulus)
    row, column = np.unravel_index(np.argmax(values), values.shape)
    # Rows go up z from 0 to 30 mm, columns along x from 0 to 60 mm.
    assert row / values.shape[0] * 30 == pytest.approx(19.5, abs=0.4)
    assert column / values.shape[1] * 60 == pytest.approx(30.1, abs=0.4)


def test_a_cut_between_two_rows_of_presses_has_the_nearer_one_on_it(tmp_path):
    finding = load_finding(make_run(tmp_path / "run"))
    _, vertical = cuts(finding)
    rows = np.unique(finding.scan.contact_points[:, 1])
    for place in (rows[0], 0.6 * rows[0] + 0.4 * rows[1]):
        figure = Figure()
        axes = figure.add_subplot()
        _decorate(axes, finding, replace(vertical, at_m=place), is_truth=True)
        drawn = next(line for line in axes.lines if line.get_marker() == "v")
        assert len(drawn.get_xdata()) == np.sum(finding.scan.contact_points[:, 1] == rows[0])


def test_true_inclusions_are_matched_to_the_nearest_found_ones():
    far, near = Inclusion(1.0, 0.0, 0.0, 0.0, 1.0), Inclusion(2.0, 1.0, 1.0, 1.0, 1.0)
    found, true = GaussianMap(9.0, (near, far)), GaussianMap(8.0, (far, near))
    values = matched(found, true)
    assert values["inclusion_1.weight_pa"] == 2.0
    assert values["inclusion_2.weight_pa"] == 1.0
    assert len(matched(GaussianMap(9.0, (near,)), true)) == 6


def test_the_outline_of_a_surface_knows_its_inside(tmp_path):
    import pyvista

    pyvista.Sphere(radius=0.05, theta_resolution=40, phi_resolution=40).save(tmp_path / "ball.stl")
    (tmp_path / "study.toml").write_text(
        "[study]\nname = 'ball'\nscan = 'scan.csv'\n[body]\nshape = 'surface'\n"
        "file = 'ball.stl'\npoisson_ratio = 0.45\n[probe]\ntip = 'flat'\nradius_m = 0.004\n"
    )
    outline = study_outline(load_study(tmp_path / "study.toml"))
    np.testing.assert_allclose(outline.upper_m, 0.05, rtol=0.01)
    points = np.array([[0, 0, 0], [0.04, 0.04, 0.04], [0, 0, 0.045]])
    assert outline.inside(points).tolist() == [True, False, True]
    heights = outline.top(np.array([[0, 0], [0.03, 0], [0.04, 0.04]]))
    np.testing.assert_allclose(heights, [0.05, 0.04, np.nan], rtol=0.01)


def test_what_cannot_be_compared_is_said(tmp_path):
    with RunFolder("scan", tmp_path / "empty"):
        pass
    with pytest.raises(InputError, match=r"found no fit.json.*palpmap fit STUDY"):
        run_compare(source=tmp_path / "empty", out=None, output=Output(quiet=True))
    run = make_run(tmp_path / "run")
    write_scan(small_scan(offset_n=0.01), run / "scan.csv")
    with pytest.raises(InputError, match="the fit was made on another scan"):
        run_compare(source=run, out=None, output=Output(quiet=True))
    broken = {"schema": 1, "body": {"background_pa": 1.0}}
    (tmp_path / "truth.json").write_text(json.dumps(broken))
    with pytest.raises(InputError, match="key body"):
        read_truth(tmp_path / "truth.json")


def test_what_no_press_shows_is_hatched_and_outside_the_colours(tmp_path):
    finding = load_finding(make_run(tmp_path / "run", truth=False))
    assert finding.probed_m is None  # presses are all over this body
    low, high = finding.outline.lower_m, finding.outline.upper_m
    beside = np.array([[high[0] - 0.012, low[1], low[2]], high])  # beside the inclusion
    for probed, hatched in ((None, 0), (beside, 4)):
        figure = draw_map(replace(finding, probed_m=probed))
        drawn = [c for axes in figure.axes for c in axes.collections if isinstance(c, ContourSet)]
        assert sum(any(c.hatches) for c in drawn) == hatched
    sure = next(a for a in figure.axes if a.get_title().startswith("How sure"))
    whole = next(a for a in draw_map(finding).axes if a.get_title().startswith("How sure"))
    assert sure.images[0].norm.vmax < 0.5 * whole.images[0].norm.vmax


def test_the_map_that_is_shown_has_in_it_what_the_fitted_effects_change():
    plain = GaussianMap(5000.0, ())
    values = {"weight_pa": 8000.0, "x_m": 0.02, "y_m": 0.03, "z_m": 0.02, "radius_m": 0.01}
    effects = {f"extra_inclusion.{name}": value for name, value in values.items()}
    effects |= {"side_gradient.g_x": 0.4, "side_gradient.g_y": 0.0, "contact_offset.offset_m": 1e-4}
    fit: Any = SimpleNamespace(
        map=plain, parameters={name: SimpleNamespace(value=v) for name, v in effects.items()}
    )
    nothing: Any = None
    outline = Outline(
        np.zeros(3),
        np.array([0.08, 0.08, 0.04]),
        lambda p: np.ones(len(p), bool),
        lambda p: np.full(len(p), 0.04),
    )
    shown = Finding("a study", fit, nothing, nothing, outline).map
    at = np.array([[0.02, 0.03, 0.02], [0.08, 0.08, 0.0]])
    np.testing.assert_allclose(shown.modulus(at), [13000 * 0.9, 5000 * 1.2], rtol=1e-6)
    assert len(shown.inclusions) == 1


def test_the_presses_that_were_not_simply_made_are_listed_with_the_reason(tmp_path):
    path = tmp_path / "presses.json"
    assert _outcome_table(path) is None
    given = [
        PressOutcome(0, "made", 0.3, judged=Judgement(0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.3)),
        PressOutcome(1, "skipped", 0.3, reason="tare (transit): the force reads 7 N at rest"),
        PressOutcome(2, "made", 0.3, judged=Judgement(0.31, 0.03, 0.0, 0.0, 0.0, 0.0, 0.3),
                     reason="the held force is off by 3.0 %"),
    ]  # fmt: skip
    PressesRecord(on_fault="skip", presses=tuple(map(press_record, given))).write(path)
    rows = [[cell.text for cell in row] for row in _outcome_table(path).rows]
    assert rows == [
        ["press 1", "skipped", "0.3 N", "tare (transit): the force reads 7 N at rest"],
        ["press 2", "made", "0.3 N", "the held force is off by 3.0 %"],
        ["the other 1", "made", "", "with force and place as set"],
    ]


def test_an_uneven_surface_is_drawn_over_the_contact_points_and_its_band_beside_it():
    places = ((0.01, 0.02, 0.048), (0.03, 0.02, 0.048), (0.03, 0.05, 0.048))
    surface = FormCurveRecord(
        effect="uneven_surface", along="press", at_unit="", of="added to the displacement",
        unit="m", at=(1, 2, 3), value=(1e-5, -4e-5, 2e-5), lower95=(0.0, -7e-5, 1e-5),
        upper95=(2e-5, -1e-5, 3e-5), places_m=places,
    )  # fmt: skip
    drift = surface.model_copy(update={"effect": "force_drift", "unit": "N", "places_m": ()})
    figure = draw_forms((surface, drift), np.array([0.1, 0.0, 0.0]))
    height, band, along, *_ = figure.axes
    (dots,), (widths,) = height.collections, band.collections
    np.testing.assert_allclose(dots.get_offsets(), [(110, 20), (130, 20), (130, 50)])
    np.testing.assert_allclose(dots.get_array(), [10, -40, 20])
    np.testing.assert_allclose(widths.get_array(), [10, 30, 10])
    assert (height.get_xlabel(), height.get_ylabel()) == ("x, mm", "y, mm")
    assert along.get_ylabel() == "added to the displacement, mN"
