"""What a person sees of an explanation is what the loop found, and no more."""

import json
import re
from dataclasses import dataclass, replace
from io import StringIO
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from rich.console import Console
from typer.testing import CliRunner

from identify.catalogue.catalogue import CATALOGUE
from identify.design.assessment import assess
from identify.design.detection_limits import Limit
from identify.design.geometry_confounders import GeometryConfounder
from identify.design.next_presses import Proposal
from identify.design.scan_variants import Design, Presses
from identify.design.settings import DETECTION
from identify.design.undetected_bias import UndetectedBias
from identify.residual import sentence
from identify.select.accepted_effect import AcceptedEffect
from identify.select.candidates import Candidate
from identify.select.explanation import Explanation
from identify.select.model_error import confounded
from identify.select.verdicts import effect_verdict
from models.errors import InputError
from models.scan_file import write_scan
from palpmap.__main__ import app
from palpmap.figures.map_change import draw_maps, draw_parameters, draw_presses
from palpmap.figures.style import settle
from palpmap.report.explain_console import explain_summary
from palpmap.report.explain_report import write_explain_report
from palpmap.result.doubts import stated_lengths, unseen_effects, unseen_inclusions
from palpmap.result.evidence import Axis, bins_of, evidence_of, shown_share
from palpmap.result.explain_record import limit_record
from palpmap.result.explain_words import CANDIDATES, UNRELIABLE, _name_notes, verdict_detail
from palpmap.result.finding import Finding, step_finding
from palpmap.result.next_scan import finer_cells, next_presses_records
from palpmap.result.next_step import next_steps
from palpmap.result.presses_words import presses_record, presses_sentences
from palpmap.result.records import (
    ExplainRecord,
    NextPressesRecord,
    OtherMapRecord,
    PressesAloneRecord,
    PressesFitRecord,
    WithoutSuspectsRecord,
)
from palpmap.result.tables import candidate_table, explained_table, limit_table
from palpmap.result.truth import read_truth
from palpmap.run_files.explain_run import explain_pictures
from palpmap.study.cell_size import smallest_cell_m
from palpmap.study.open_study import Problem
from palpmap.study.study import load_study
from tests.palpmap.report.page import Page

NASTY = "<script>alert('x')</script> & [bold]\"phantom\""
PIXEL = b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR\x00\x00\x00\x01\x00\x00\x00\x01\x08\x06\x00\x00\x00"


@dataclass(frozen=True)
class Told:
    """What a report tells of."""

    finding: Finding
    explained: Explanation
    record: ExplainRecord
    problem: Problem


@pytest.fixture(scope="module")
def page(explained_case):
    return Page((explained_case.folder / "report.html").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def told(explained_case):
    c = explained_case
    finding = step_finding(c.folder, c.problem, c.explained.final)
    return Told(finding, c.explained, c.record, c.problem)


def written(told, path):
    pictures = {name: PIXEL for name in ("ladder", "residuals", "maps", "evidence_1")}
    write_explain_report(path / "report.html", *vars(told).values(), pictures)
    return Page((path / "report.html").read_text(encoding="utf-8"))


def grouped(explained, *others):
    """The explanation as if other effects had explained the scan as well."""
    best = explained.accepted[0].candidates[0]
    candidates = (
        best,
        *(Candidate(name, best.chi2, best.criterion + 1, best.fit) for name in others),
    )
    return replace(
        explained, verdict="ambiguous", accepted=(AcceptedEffect(best.name, candidates),)
    )


def test_an_effect_that_the_map_imitates_is_not_told_from_the_error_of_the_model(told):
    rung = told.explained.ladder[0]

    def seen(**visible):
        scores = tuple(replace(s, visible=visible.get(s.name, 0.5)) for s in rung.diagnosis.scores)
        return replace(rung, diagnosis=replace(rung.diagnosis, scores=scores))

    low = seen(hysteresis=0.03, contact_offset=0.04)
    assert confounded(low, "hysteresis") == ("mesh_error",)
    assert set(confounded(low, "mesh_error")) == {"hysteresis", "contact_offset"}
    assert confounded(low, "viscoelasticity") == ()
    best = told.explained.accepted[0].candidates[0]
    alone = AcceptedEffect("tool_compliance", (replace(best, name="tool_compliance"),), False,
                     {"tool_compliance": ("mesh_error",)})  # fmt: skip
    assert alone.equivalents == ("tool_compliance",)
    assert alone.group == ("tool_compliance", "mesh_error")
    explained = replace(told.explained, accepted=(alone,))
    assert explained.added == ()
    assert explained.ambiguous == (("tool_compliance", "mesh_error"),)
    assessment = assess(explained, told.problem.catalogue)
    assert assessment.next_presses == ()
    assert assessment.finer_mesh
    assert not assess(told.explained, told.problem.catalogue).finer_mesh
    text = " ".join(_name_notes(explained, "tool_compliance"))
    assert "tool_compliance and mesh_error are indistinguishable here" in text
    assert "looks like tool_compliance" in text
    assert "scan with tips of two radii" in text
    body = told.problem.study.body
    assert "cell_size_m = 0.008 under [body] (now 0.012)" in str(finer_cells(body))
    finest = body.model_copy(update={"cell_size_m": smallest_cell_m(body)})
    assert finer_cells(finest) is None


def test_no_limits_are_stated_beside_a_residual_of_many_times_the_noise(told):
    """They are told by the noise; beside less than twice the noise they hold roughly."""
    step = told.explained.ladder[0]
    alone = replace(told.explained, ladder=(step,), accepted=(), verdict="unexplained")
    ratio = float(np.sqrt(step.fit.chi2_per_dof))
    for largest, stated in ((0.9 * ratio, False), (1.1 * ratio, True)):
        settings = replace(DETECTION, largest_misfit=largest)
        assessment = assess(alone, told.problem.catalogue, settings=settings)
        assert bool(assessment.limits) == stated


def test_the_loop_explains_the_case(explained_case):
    assert explained_case.record.verdict == "explained"
    assert explained_case.record.added == ("viscoelasticity",)


def test_the_verdict_stands_on_top_and_the_ladder_is_the_first_picture(explained_case, page):
    assert page.headings[:2] == ["Explained.", "The error, step by step"]
    assert page.tags.count("img") >= 8
    assert all(link.startswith("data:image/png;base64,") for link in page.links)
    assert "script" not in page.tags
    html = (explained_case.folder / "report.html").read_text(encoding="utf-8")
    assert not re.search(r'(src|href)="(?!data:)', html)


def test_the_report_says_what_the_record_says(explained_case, page):
    for step in explained_case.record.ladder:
        assert f"{1e6 * step.rms_m:.0f} µm" in page.text
        assert f"{step.chi2_per_dof:.3g}" in page.text
    for candidate in explained_case.record.candidates:
        assert candidate.name in page.text
    creep = next(c for c in explained_case.record.candidates if c.name == "viscoelasticity")
    assert creep.evidence in page.text
    assert "do not cover the truth" in page.text


def test_effects_that_are_not_seen_are_folded_away(explained_case):
    html = (explained_case.folder / "report.html").read_text(encoding="utf-8")
    verdicts = html.split("<h2>Verdict on each effect</h2>")[1].split("</section>")[0]
    shown, folded = verdicts.split("<details>")
    for candidate in explained_case.record.candidates:
        is_folded = candidate.verdict == "not_seen"
        assert (f">{candidate.name}</td>" in shown) == (not is_folded)
        assert (f">{candidate.name}</td>" in folded) == is_folded


def test_limits_have_a_column_for_each_parameter_of_the_map_and_none_for_effects(told):
    (limit, *_) = told.record.limits
    shift = {"background_pa": 12.0, "several_plays.share_2": 1e-5}
    table = limit_table([limit.changed(map_bias=shift)])
    assert [c.heading for c in table.columns][:3] == ["Effect", "Seen from", "background, kPa"]
    assert not any("several_plays" in column.heading for column in table.columns)


def test_a_shift_beyond_the_body_is_no_number_in_the_report_either(told, tmp_path):
    limits = [one.changed(map_bias={"inclusion_1.z_m": 25.6}) for one in told.record.limits]
    page = written(replace(told, record=told.record.changed(limits=tuple(limits))), tmp_path)
    assert "25600" not in page.text
    assert "-: not determined (a shift beyond the body" in page.text


def test_texts_from_files_are_escaped(told, tmp_path):
    candidates = tuple(
        c.changed(evidence=NASTY, verdict="supported") for c in told.record.candidates
    )
    record = told.record.changed(candidates=candidates, residual=NASTY)
    page = written(
        replace(told, finding=replace(told.finding, name=NASTY), record=record), tmp_path
    )
    assert "script" not in page.tags
    assert page.text.count(NASTY) >= 3


def test_the_evidence_of_creep_is_the_time_within_the_press(explained_case):
    before, after = explained_case.explained.ladder
    evidence = evidence_of("viscoelasticity", before, after, np.zeros(3))
    axis, (curve,) = evidence.shown[0]
    assert axis.name == "time"
    assert evidence.share > 0.5
    # A bin by hand: all readings of one sampling time (the presses are sampled alike)
    first = before.fit.model.readings.first
    weight = before.fit.at.sigma_m[first] ** -2.0
    by_hand = np.sum(weight * before.fit.residual_m[first]) / weight.sum()
    assert_allclose(curve.before_m[0], by_hand, rtol=1e-12)
    assert_allclose(curve.error_m[0], weight.sum() ** -0.5, rtol=1e-12)
    assert_allclose(curve.before_m, curve.change_m + curve.after_m, rtol=0, atol=1e-15)
    # The effect follows the residual, and what is left is noise: the mean of its squares is 1
    assert np.corrcoef(curve.before_m, curve.change_m)[0, 1] > 0.95
    assert 0.4 < np.mean((curve.after_m / curve.error_m) ** 2) < 1.9  # 99 % for 22 bins


def test_an_axis_shows_what_varies_along_it_and_nothing_of_noise():
    rng = np.random.default_rng(3)
    at, noise = rng.uniform(size=2000), rng.normal(size=2000)
    axis = Axis("order", "", at, np.zeros(2000, int))
    index = bins_of(axis, np.zeros(2000, int))
    assert sorted(set(index)) == list(range(12))
    assert np.ptp(np.bincount(index)) <= 2
    assert shown_share(index, np.where(at > np.median(at), 1.0, -1.0), np.ones(2000)) > 0.99
    assert abs(shown_share(index, noise, np.ones(2000))) < 0.02  # four standard deviations
    assert shown_share(index, np.ones(2000), np.ones(2000)) == 0.0


def test_an_ambiguous_addition_is_not_said_to_be_found(told, tmp_path):
    explained = grouped(told.explained, "hysteresis")
    record = told.record.changed(verdict="ambiguous", added=(), ambiguous=explained.ambiguous)
    page = written(replace(told, explained=explained, record=record), tmp_path)
    assert "viscoelasticity or hysteresis" in page.text
    assert "Take neither its name nor its numbers" in page.text
    assert "If it were viscoelasticity: The tip keeps sinking" in page.text
    assert "another effect of the group would give another map" in page.text
    assert "the residual is noise" not in page.text.split("Residual of the last model")[0]


def test_a_helper_that_leaves_structure_is_not_said_to_be_supported(explained_case):
    case = explained_case
    ladder = (case.explained.ladder[0], case.explained.ladder[0])
    unexplained = replace(case.explained, verdict="unexplained", ladder=ladder)
    assert unexplained.added == ()
    assert "a help, not the answer" in verdict_detail(unexplained)
    for explained, verdict in ((case.explained, "supported"), (unexplained, "helps")):
        creep = effect_verdict(CATALOGUE["viscoelasticity"], explained)
        assert creep.verdict == verdict


def test_a_map_beside_structure_is_not_to_be_relied_on_on_every_face(told, tmp_path):
    """Where its numbers stand: on the page, in the terminal, in result.json."""
    ladder = (told.explained.ladder[0], told.explained.ladder[0])
    explained = replace(told.explained, verdict="unexplained", ladder=ladder)
    assert not explained.told_apart
    record = told.record.changed(verdict="unexplained", added=(), reliable=explained.told_apart)
    assert explained_table(record).title == UNRELIABLE
    assert explained_table(told.record).title == "found"
    page = written(replace(told, explained=explained, record=record), tmp_path)
    assert UNRELIABLE in page.text
    assert UNRELIABLE not in written(told, tmp_path).text
    assert '"reliable": false' in record.model_dump_json(indent=1)


def test_the_page_says_of_every_effect_what_result_json_says(told):
    """Also of effects that only help or cannot be tested, which this scan has none of."""
    candidates = told.record.candidates
    changed = (
        candidates[0].changed(verdict="helps"),
        candidates[1].changed(verdict="untestable", untestable="the scan has no time stamps"),
        *candidates[2:],
    )
    for shown in (candidates, changed):
        rows = candidate_table(shown).rows
        words = {row[0].text: row[1].text for row in rows}
        assert words == {c.name: CANDIDATES[c.verdict] for c in shown}


def test_nothing_missing_is_no_proof(told, tmp_path):
    explained = replace(
        told.explained,
        verdict="nothing_missing",
        ladder=told.explained.ladder[1:],
        accepted=(),
    )
    record = told.record.changed(verdict="nothing_missing")
    page = written(replace(told, explained=explained, record=record), tmp_path)
    assert "no proof" in page.text
    assert not any(heading.startswith("Step") for heading in page.headings)


def test_next_presses_and_what_could_hide_are_told_where_the_record_has_them(told, tmp_path):
    program = NextPressesRecord(
        change="tips of 3 and 10 mm", why=NASTY, discrimination=321.0, presses=30,
        duration_s=90.0, program="next_scan_1.csv",
    )  # fmt: skip
    skin = Limit("skin_layer", 0.013, {}, 0.5, ("mesh_error",),
                 {"background_pa": -240.0, "inclusion_1.z_m": 8e-3})  # fmt: skip
    gain = Limit("force_gain", None, {}, 0.0, (), {})
    limits = (limit_record(skin), limit_record(gain))
    record = told.record.changed(next_presses=(program,), limits=limits)
    page = written(replace(told, record=record), tmp_path)
    assert "next_scan_1.csv" in page.text
    assert NASTY in page.text
    assert "1.3 %" in page.text
    assert "background, kPa" in page.text
    row = "skin_layer1.3 %-0.24+8mesh_error"  # the cells one after the other
    assert row in page.text
    assert "force_gainnever" in page.text
    plain = written(told, tmp_path)
    assert "Which presses to make next" not in plain.headings


def test_presses_that_change_nothing_are_not_asked_for_first(told, tmp_path):
    repeat = NextPressesRecord(
        change="Repeat presses 3", why="they are outliers", discrimination=None, presses=1,
        duration_s=4.0, program="repeat_presses.csv",
    )  # fmt: skip
    wrong = OtherMapRecord(answer="another_map", chi2_per_dof=1.0, left=0.0, map_error=0.0,
                           more_evidence=90.0, effects=())  # fmt: skip
    explained = replace(told.explained, verdict="unexplained")

    def steps(other, without):
        rest = WithoutSuspectsRecord(
            verdict=without, added=(), ambiguous=(), chi2_per_dof=9.0, parameters={}, residual=""
        )
        record = told.record.changed(next_presses=(repeat,), other_map=other, without_suspects=rest)
        return " | ".join(next_steps(record, explained, told.problem, tmp_path))

    assert steps(None, "explained").startswith("Next: Repeat presses 3")
    assert "Repeat" not in steps(None, "unexplained")
    assert steps(wrong, "explained").startswith("Next: Set kind")


@pytest.mark.parametrize(
    ("verdict", "separates", "first"),
    [
        ("ambiguous", True, "Make the scan once more"),
        ("ambiguous", False, "No scan of these places separates"),
        ("unexplained", False, "If you have a cause in mind"),
    ],
)
def test_presses_that_separate_nothing_stand_behind_what_does(
    told, tmp_path, verdict, separates, first
):
    program = NextPressesRecord(
        change="Make the scan once more", why="a reason", discrimination=3.0, presses=30,
        duration_s=90.0, program="next_scan_1.csv", separates=separates,
    )  # fmt: skip
    record = told.record.changed(next_presses=(program,), ambiguous=(("force_bias", "play"),))
    explained = replace(told.explained, verdict=verdict)
    steps = next_steps(record, explained, told.problem, tmp_path)
    assert first in steps[0]
    assert sum("next_scan_1.csv" in step for step in steps) == 1
    assert sum("both.csv" in step for step in steps) == 1


def test_a_block_that_stands_in_for_a_curved_body_gives_way_to_its_contacts(told, tmp_path):
    study, no_fit = told.problem.study, told.record.presses_alone
    fit = PressesFitRecord(
        rms_n=0.02, typical_n=0.01, share_of_largest_force=0.03, chi2_per_dof=9.0, noise_share=0.1
    )
    assert no_fit is None
    alone = PressesAloneRecord(
        effects=(), values={}, as_good={}, largest_force_n=0.8, before=fit, after=fit,
        share_taken=0.0, map_error=0.5,
    )  # fmt: skip
    explained = replace(told.explained, verdict="unexplained")
    noise = study.noise.model_copy(update={"touch_m": 4e-5})

    def first(map_error, **body):
        changed = study.model_copy(
            update={"body": study.body.model_copy(update=body), "noise": noise}
        )
        record = told.record.changed(presses_alone=alone.changed(map_error=map_error))
        return next_steps(record, explained, replace(told.problem, study=changed), tmp_path)[0]

    told_by_places = alone.changed(
        effects=("play",), again=9, refuted=(("time_lag", "hysteresis"),)
    )
    said = " ".join(presses_sentences(told.record.changed(presses_alone=told_by_places)))
    assert "time_lag with hysteresis meets the curves as well, but not the places" in said
    says = first(0.5, project_points=True, thickness_assumed=True)
    assert says.startswith("Next: Let the body go through the contact points")
    command = re.findall("`(.*?)`", says)[0].split()
    write_scan(told.problem.scan, tmp_path / "scan.csv")
    done = CliRunner().invoke(app, [*command[1:-1], str(tmp_path / "made")])
    assert done.exit_code == 0, done.output
    made = load_study(tmp_path / "made" / "study.toml")
    assert made.body.shape == "from-contacts"
    assert made.body.thickness_m == study.body.size_m[2]
    assert made.body.thickness_assumed
    assert made.noise == noise
    assert made.map.kind == "free"
    assert "Let the body" not in first(0.0, project_points=True)
    assert "Let the body" not in first(0.5, project_points=False)


def test_a_pattern_that_chance_may_have_left_is_told_and_looked_for_again(told, tmp_path):
    last = told.explained.final
    firing = replace(last.comparison.tests[0], p_adjusted=0.004, fires=True)
    comparison = replace(
        last.comparison, is_noise=True, varies_with=None, tests=(firing,), alpha=0.01
    )
    comparison = replace(comparison, statement=sentence(comparison))
    rare = replace(
        told.explained, verdict="nothing_missing", accepted=(),
        ladder=(replace(last, comparison=comparison),),
    )  # fmt: skip
    record = told.record.changed(next_presses=())
    assert "in one of 250 scans" in verdict_detail(rare)
    assert "Make the scan once more" in next_steps(record, rare, told.problem, tmp_path)[0]
    usual = replace(comparison, tests=(replace(firing, p_adjusted=0.4, fires=False),))
    rare = replace(rare, ladder=(replace(last, comparison=usual),))
    assert "in one of" not in verdict_detail(rare)
    assert "once more" not in " ".join(next_steps(record, rare, told.problem, tmp_path))


def test_beside_nothing_missing_stand_the_large_effects_that_the_scan_would_not_show(
    told, tmp_path
):
    nothing = replace(told.explained, verdict="nothing_missing", accepted=())
    limit = told.record.limits[0].changed(untestable=None, largest_share=None)

    def last(*shares) -> str:
        names = ("skin_layer", "sensitivity_drift", "rigid_tip")
        limits = tuple(
            limit.changed(name=name, smallest_share=smallest, largest_share=largest)
            for name, (smallest, largest) in zip(names, shares, strict=False)
        )
        record = told.record.changed(limits=limits, next_presses=())
        return next_steps(record, nothing, told.problem, tmp_path)[-1]

    assert "would not show: skin_layer, sensitivity_drift. `" in last(
        (0.3, None), (None, 0.2), (None, 0.007)
    )
    assert "how large an effect must be" in last((0.05, None), (None, None), (None, 0.007))


def test_what_no_presses_separate_is_ruled_out_by_the_cure_of_each_cause(told, tmp_path):
    explained = replace(told.explained, verdict="ambiguous")
    group = (("contact_offset", "surface_tilt", "suspect presses"),)
    record = told.record.changed(next_presses=(), ambiguous=group)

    def steps(problem):
        return " | ".join(next_steps(record, explained, problem, tmp_path))

    assert "rule them out one by one. " in steps(told.problem)
    assert "Find first touch from the force's rise" in steps(told.problem)
    scan = told.problem.scan
    travel = scan.displacement_m + 0.01
    force = np.array(scan.force_n)
    for press in scan.press_ids:
        free = np.flatnonzero(scan.press == press)[:4]
        force[free], travel[free] = [1e-3, -2e-3, 0.0, 1e-3], [1e-3, 4e-3, 7e-3, 9.8e-3]
    above = scan.replace(force_n=force, displacement_m=travel)
    above = replace(told.problem, experiment=replace(told.problem.experiment, scan=above))
    assert steps(above).startswith("Next: Press ")
    assert "(25 of 25): the tip travels without force" in steps(above)


def test_the_run_holds_the_comparison_of_the_last_rung_and_all_figures(explained_case):
    found = json.loads((explained_case.folder / "comparison.json").read_text())
    assert found["is_noise"]
    assert_allclose(found["rms_m"], explained_case.record.ladder[-1].rms_m, rtol=1e-12)
    names = {path.stem for path in (explained_case.folder / "figures").iterdir()}
    assert {"ladder", "residuals", "evidence_1", "maps", "confusion", "parameters"} <= names


def test_intervals_of_the_map_hold_the_estimate_and_fixed_values_have_none(explained_case):
    fit = explained_case.explained.final.fit
    found = fit.parameters
    background = found["background_pa"]
    assert background.lower95 < background.value < background.upper95
    assert_allclose(background.upper95 - background.lower95, 2 * 1.96 * background.std, rtol=0.01)
    assert not found["inclusion_1.x_m"].free
    assert found["inclusion_1.x_m"].std == 0


def test_a_foreign_truth_file_is_no_truth(explained_case, tmp_path):
    problem = explained_case.problem
    truth = read_truth(problem.study.scan.with_name("truth.json"), foreign=True)
    assert truth is not None
    assert truth.background_pa == 5000
    there = tmp_path / "truth.json"
    assert read_truth(there, foreign=True) is None
    there.write_text(json.dumps({"answer": 42}))
    assert read_truth(there, foreign=True) is None
    with pytest.raises(InputError, match="key schema"):
        read_truth(there)


@pytest.mark.slow
def test_figures_of_a_ladder_of_one_rung_can_be_drawn(told):
    explained = replace(told.explained, ladder=told.explained.ladder[1:], accepted=())
    record = told.record.changed(unseen_shifts={})
    pictures = explain_pictures(told.finding, explained, record)
    assert all(data.startswith(b"\x89PNG") for data in pictures.values())
    assert "parameters" not in pictures  # one interval each: the table says as much


def test_the_last_bars_are_the_intervals_of_the_table_and_those_before_standard_errors(told):
    parameters = told.record.parameters
    weight = parameters["inclusion_1.weight_pa"]
    bent = weight.changed(lower95=weight.value - 2000, upper95=weight.value + 9000)
    shown = told.record.changed(parameters={**parameters, "inclusion_1.weight_pa": bent})
    figure = draw_parameters(told.finding, told.explained, shown)
    assert figure is not None
    axes = next(a for a in figure.axes if "weight" in a.get_title())
    before, after = (np.asarray(bar.get_paths()[0].vertices)[:, 1] for bar in axes.collections)
    assert_allclose(after, [1e-3 * bent.lower95, 1e-3 * bent.upper95])
    fit = told.explained.ladder[0].fit
    name = "inclusion_1.weight_pa"
    assert_allclose(np.mean(before), 1e-3 * fit.values[name])
    assert_allclose(np.ptp(before), 2 * 1.96e-3 * fit.std[name])


def with_unseen_effects(told):
    p = told.record.parameters["inclusion_1.weight_pa"]
    shifts = {
        "background_pa": UndetectedBias(0.0, "breathing", 0.001),
        "inclusion_1.weight_pa": UndetectedBias(4 * p.std, "rigid_tip", 0.014),
    }
    return told.record.changed(unseen_shifts=shifts)


def without_unseen_effects(told):
    return told.record.changed(unseen_shifts={})


def test_one_tip_is_said_not_to_tell_layers_from_another_background(told, tmp_path):
    assert (
        "as in layers, passes for another background under one tip" in written(told, tmp_path).text
    )
    own = told.explained.final.fit.model.readings
    readings = replace(own, radius_m=np.where(own.press % 2, 0.003, own.radius_m))
    fit = SimpleNamespace(field=None, model=SimpleNamespace(readings=readings))
    two_tips = SimpleNamespace(final=SimpleNamespace(fit=fit))
    assert "as in layers" not in unseen_effects(told.record, two_tips)


def test_what_an_unseen_effect_may_have_done_stands_beside_the_intervals(told, tmp_path):
    record = with_unseen_effects(told)
    std = record.parameters["inclusion_1.weight_pa"].std
    page = written(replace(told, record=record), tmp_path)
    assert f"± {4e-3 * std:.2g} kPa (rigid_tip)" in page.text
    assert "No interval counts undetected effects" in page.text
    assert (
        "No interval counts"
        not in written(replace(told, record=without_unseen_effects(told)), tmp_path).text
    )
    console = Console(width=80, file=StringIO())
    for line in explain_summary(record, told.explained, told.problem):
        console.print(line)
    screen = console.file.getvalue()  # type: ignore[attr-defined]
    assert f"± {4e-3 * std:.2g} kPa" in screen
    assert "(most: rigid_tip and breathing)" in " ".join(screen.split())
    (row,) = (line for line in screen.splitlines() if "inclusion 1 weight" in line)
    assert len(row) <= 80


def test_the_pale_bar_is_the_interval_and_what_an_unseen_effect_may_add(told):
    record = with_unseen_effects(told)
    figure = draw_parameters(told.finding, told.explained, record)
    assert figure is not None
    axes = next(a for a in figure.axes if "weight" in a.get_title())
    (pale,) = (line for line in axes.lines if line.get_alpha())
    p = record.parameters["inclusion_1.weight_pa"]
    ends = [p.lower95 - 4 * p.std, p.upper95 + 4 * p.std]
    assert_allclose(pale.get_ydata(), 1e-3 * np.array(ends))
    one = replace(told.explained, ladder=told.explained.ladder[1:], accepted=())
    assert draw_parameters(told.finding, one, without_unseen_effects(told)) is None
    assert draw_parameters(told.finding, one, record) is not None


def test_the_legend_of_the_presses_lies_below_them_and_names_each_mark_once(told):
    figure = draw_presses(told.explained)
    settle(figure)
    (legend,) = figure.legends
    names = [text.get_text() for text in legend.get_texts()]
    assert len(set(names)) == len(names)
    assert {"measured, load", "model before", "model after"} <= set(names)
    panels = [axes.get_window_extent() for axes in figure.axes]
    assert not any(legend.get_window_extent().overlaps(panel) for panel in panels)


def test_the_nearest_effect_is_said_only_where_it_takes_next_to_nothing(explained_case):
    first = explained_case.explained.ladder[0]
    much = replace(explained_case.explained, verdict="unexplained", ladder=(first,), accepted=())
    assert "nearest" not in verdict_detail(much)
    beside = replace(first, diagnosis=replace(first.diagnosis, excess=1e9))
    little = replace(much, ladder=(beside,))
    assert "The nearest of the catalogue, viscoelasticity, would take" in verdict_detail(little)


def test_the_maps_colours_are_those_of_the_last_one(told):
    first = told.explained.ladder[0]
    wild = {name: 1e3 * value for name, value in first.fit.values.items() if "weight" in name}
    other = first.fit.map.changed(wild)
    before = replace(first, fit=replace(first.fit, map=other))
    explained = replace(told.explained, ladder=(before, *told.explained.ladder[1:]))
    figure = draw_maps(told.finding, explained)
    images = [axes.images[0] for axes in figure.axes if axes.images]
    columns = [images[column :: len(images) // 2] for column in range(len(images) // 2)]
    assert max(image.get_array().max() for image in columns[0]) > 2 * images[0].norm.vmax
    judged = max(image.get_array().max() for column in columns[1:] for image in column)
    assert [image.norm.vmax for image in images] == pytest.approx([judged] * len(images))


def test_unseen_inclusions_are_counted_without_those_of_effects(told):
    p = told.record.parameters["inclusion_1.weight_pa"]
    parameters = {"inclusion_1.radius_m": p, "extra_inclusion.radius_m": p}
    one = told.record.changed(unseen_inclusions=(1,), parameters=parameters)
    assert "Inclusion 1 is not seen" in unseen_inclusions(one)
    assert "Set inclusions = 0 under" in unseen_inclusions(one)
    more = {**parameters, "inclusion_2.radius_m": p}
    two = told.record.changed(unseen_inclusions=(1, 2), parameters=more)
    assert "Inclusions 1 and 2 are not seen" in unseen_inclusions(two)
    assert "Set inclusions = 0 under" in unseen_inclusions(two)
    assert unseen_inclusions(told.record) == ""


def test_lengths_that_would_look_like_an_effect_are_said_with_their_side(told):
    tip = GeometryConfounder("stiffness_gradient", "tip_radius", 3.8e-4)
    body = GeometryConfounder("stiffness_gradient", "body_height", -4.9e-3)
    other = replace(tip, effect="skin_layer")
    assert stated_lengths(told.record.changed(stated_lengths=(tip, body, other))) == [
        "The readings would look nearly the same as with stiffness_gradient if the tip's radius "
        "were 0.38 mm larger than stated, or the body's height were 4.9 mm smaller than stated. "
        "Measure that first.",
        "The readings would look nearly the same as with skin_layer if the tip's radius were "
        "0.38 mm larger than stated. Measure that first.",
    ]
    assert stated_lengths(told.record.changed(stated_lengths=())) == []


def test_a_course_that_leaves_noise_is_not_doubted_by_a_search_that_did_not_end():
    course: Any = SimpleNamespace(name="c", evidence=lambda values, readings: "It goes with time.")
    fit = SimpleNamespace(
        at=SimpleNamespace(values={"c": {}}),
        model=SimpleNamespace(readings=None, effects=[SimpleNamespace(effect=course)]),
    )
    found: Any = SimpleNamespace(
        verdict="unexplained", added=(), unknown=("c",), in_few_presses=(), told_apart=True,
        parts_of_unknown=(), apart=None,
        explained_share=0.9,
        final=SimpleNamespace(fit=fit, comparison=SimpleNamespace(statement="")),
    )  # fmt: skip
    open_question = OtherMapRecord(
        answer="undecided",
        chi2_per_dof=1.0,
        left=0.0,
        map_error=0.0,
        more_evidence=None,
        effects=(),
    )
    said = verdict_detail(found, open_question)
    assert said == (
        "It goes with time. With it in the model, the residual is noise; the map counts it."
    )
    found.told_apart = False
    assert "not decided" in verdict_detail(found, open_question)


def test_an_effect_of_the_group_is_no_trace_beside_it(told):
    first, *rest = told.explained.accepted
    other = replace(first.candidates[0], name="uneven_surface")
    grouped = replace(first, candidates=(*first.candidates, other))
    final = told.explained.final
    found = frozenset({"uneven_surface", "play"})
    step = replace(final, diagnosis=replace(final.diagnosis, significant=found))
    explained = replace(
        told.explained,
        verdict="ambiguous",
        ladder=(*told.explained.ladder[:-1], step),
        accepted=(grouped, *rest),
    )
    assert "uneven_surface" in grouped.group
    assert explained.traces == ("play",)


@pytest.mark.parametrize("separated", [(), (("force_bias", "play"),)])
def test_a_proposal_says_if_it_separates_anything(separated):
    each = np.ones(3)
    presses = Presses(np.zeros((3, 3)), np.zeros((3, 3)), each, each, each, each, each, each, each)
    pair = ("force_bias", "play")
    proposal = Proposal(Design("same", "once more as it is", presses), 3.0, pair, separated, ())
    planned: Any = SimpleNamespace(next_presses=[proposal], outlying=())
    (record,) = next_presses_records(planned, 9)
    assert record.separates == bool(separated)


@dataclass(frozen=True)
class _Law:
    """Of presses that call for play; places refute a loop."""

    found: Any
    plain: Any
    names = ("play",)
    refuted = (("hysteresis", "time_lag"),)
    share = 0.9

    def candidates(self, name: str) -> list:
        return []


def test_the_record_names_the_laws_that_places_refute():
    fit = SimpleNamespace(rms_n=0.01, typical_n=0.01, chi2_per_dof=1.0, noise_share=0.9, again=7,
                          values={"play": {"share": 0.1}})  # fmt: skip
    model = SimpleNamespace(readings=SimpleNamespace(largest_force_n=0.3), press_error=0.0)
    problem: Any = SimpleNamespace(law=_Law(fit, fit), model=model, fit=SimpleNamespace(field=None))
    record = presses_record(problem, ())
    assert record is not None
    assert (record.again, record.refuted) == (7, (("hysteresis", "time_lag"),))
