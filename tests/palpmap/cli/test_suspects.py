"""Presses that went wrong by themselves: the loop is run with and without them."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from identify.select.explanation import SUSPECT_PRESSES
from identify.select.outlying_presses import (
    WithoutSuspects,
    suspects_left,
    weighed,
    without_suspects,
)
from palpmap.__main__ import app
from palpmap.result.doubts import doubts
from palpmap.result.explain_record import explain_record
from palpmap.result.explain_words import verdict_detail
from tests.identify.select.loop_problem import TRUE, scan, timing, true_compliance
from tests.palpmap.report.loop_study import put, shifted

SLIPPED = (6, 17)


def slipped(seed: int):
    """A scan of 25 presses, of which two travel further at the same force."""
    press, _, _, force = timing(seed)
    factor = np.where(np.isin(press, SLIPPED), 1.3, 1.0)
    return scan(factor * true_compliance()[press] * force, force, seed)


def explain(folder, table) -> dict:
    study = put(folder, table)
    result = CliRunner().invoke(
        app, ["explain", str(study), "--out", str(folder / "run"), "--json"], env={"COLUMNS": "80"}
    )
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return json.loads(result.stdout)


@pytest.fixture(scope="module")
def record(tmp_path_factory) -> dict:
    return explain(tmp_path_factory.mktemp("suspects") / "slipped", slipped(3))


@pytest.mark.slow
def test_slipped_presses_are_named_and_left_out_of_all_else(record):
    assert record["verdict"] == "unexplained"
    assert record["suspect_presses"] == record["suspects_left"] == list(SLIPPED)
    softer = {int(press): value for press, value in record["presses_apart"].items()}
    assert softer == {press: pytest.approx(0.3, abs=0.03) for press in SLIPPED}
    (step,) = record["ladder"]
    assert step["is_noise"]
    assert step["chi2_per_dof"] == pytest.approx(1, abs=0.15)
    assert record["presses_used"] == 23
    report = (Path(record["run"]) / "report.html").read_text(encoding="utf-8")
    assert "Unexplained in 2 of 25 presses, which stand apart from all others." in report
    assert "Crosses: presses that stand apart, left out." in report


@pytest.mark.slow
def test_the_map_beside_slipped_presses_holds(record):
    found = record["parameters"]
    assert record["reliable"]
    assert (
        found["background_pa"]["lower95"] < TRUE.background_pa < found["background_pa"]["upper95"]
    )


@pytest.mark.slow
def test_no_effect_is_offered_that_only_slipped_presses_call_for(record):
    assert record["added"] == record["ambiguous"] == []


@pytest.mark.slow
def test_slipped_presses_are_to_be_repeated(record):
    repeat = record["next_presses"][-1]
    program = np.genfromtxt(Path(record["run"]) / repeat["program"], delimiter=",", names=True)
    assert repeat["change"] == "Repeat presses 6, 17"
    assert program["x_m"].tolist() == [0.02, 0.03]
    assert program["y_m"].tolist() == [0.02, 0.04]
    assert program["force_n"] == pytest.approx(0.3, abs=0.02)


@pytest.mark.slow
def test_an_effect_of_all_others_is_found_beside_slipped_presses(tmp_path):
    """The slips hide it, and it hides them: two of 25 presses slip, and all are declared early."""
    table = slipped(5)
    early = replace(table, displacement_m=table.displacement_m + 1.5e-4)
    record = explain(tmp_path / "both", early)
    assert record["verdict"] == "unexplained"
    assert [int(press) for press in record["presses_apart"]] == list(SLIPPED)
    assert record["added"] == ["contact_offset"]
    assert record["reliable"]
    offset, modulus = (
        record["parameters"][name] for name in ("contact_offset.offset_m", "background_pa")
    )
    assert offset["lower95"] < 1.5e-4 < offset["upper95"]
    assert modulus["lower95"] < TRUE.background_pa < modulus["upper95"]
    report = (Path(record["run"]) / "report.html").read_text(encoding="utf-8")
    assert "With contact_offset in the model, the residual is noise." in report


@pytest.mark.slow
def test_a_scan_without_slipped_presses_is_judged_once(tmp_path):
    record = explain(tmp_path / "offset", shifted(4))
    assert record["suspect_presses"] == []
    assert record["without_suspects"] is None
    assert record["added"] == ["contact_offset"]


def test_an_effect_that_rests_on_suspect_presses_is_not_offered_by_name(explained_case):
    explained = explained_case.explained
    (name,) = explained.added
    nothing = replace(explained, accepted=(), verdict="nothing_missing")
    weighed_down = weighed(explained, WithoutSuspects.of((3, 8), nothing))
    assert weighed_down.verdict == "ambiguous"
    assert weighed_down.added == ()
    assert weighed_down.ambiguous == ((name, SUSPECT_PRESSES),)
    record = explain_record(
        weighed_down,
        explained_case.problem,
        replace(explained_case.assessment, without=WithoutSuspects.of((3, 8), nothing)),
    )
    assert record.without_suspects.verdict == "nothing_missing"
    assert f"{name} or suspect_presses" in verdict_detail(weighed_down)


def test_an_effect_that_is_found_without_them_too_keeps_its_place(explained_case):
    explained = explained_case.explained
    assert weighed(explained, WithoutSuspects.of((3, 8), explained)) is explained
    assert weighed(explained, None) is explained


def test_an_answer_that_holds_without_suspect_presses_is_not_searched_again(explained_case):
    explained, said = explained_case.explained, []
    first = explained.ladder[0]
    two = tuple(p.press for p in first.comparison.presses)[2:4]
    presses = tuple(replace(p, bad=p.press in two) for p in first.comparison.presses)
    comparison = replace(first.comparison, presses=presses)
    suspected = replace(
        explained, ladder=(replace(first, comparison=comparison), *explained.ladder[1:])
    )
    problem = explained_case.problem
    start = replace(problem, experiment=replace(problem.experiment, say=said.append))
    without = without_suspects(start, 0, suspected)
    assert without is not None
    assert (without.verdict, without.added) == ("explained", explained.added)
    assert without.fit.model.readings.presses == explained.final.fit.model.readings.presses - 2
    assert without.comparison.is_noise
    assert all(text.startswith(f"without presses {two[0]}, {two[1]}: ") for text in said)
    assert not any("scoring" in text for text in said)


def test_presses_that_an_effect_accounts_for_are_not_to_be_repeated(explained_case):
    """Those of a moved body's edge stand out of the map alone, and of nothing that knows of it."""
    explained = explained_case.explained
    nothing = replace(explained, accepted=(), verdict="nothing_missing")
    assert suspects_left(explained, None) == ()
    assert suspects_left(explained, WithoutSuspects.of((3, 8), explained)) == ()
    assert suspects_left(explained, WithoutSuspects.of((3, 8), nothing)) == (3, 8)
    record = explain_record(
        explained,
        explained_case.problem,
        replace(explained_case.assessment, without=WithoutSuspects.of((3, 8), explained)),
    )
    told = " ".join(doubts(record.changed(suspect_presses=(3, 8)), explained))
    assert "Presses 3, 8 are outliers for the map alone, but not for the last model" in told
    assert "Without them the answer is the same" in told
