"""A small scan by the command: seeds, and folders with a space in their name."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fem.finite_strain import Fung
from models import InputError, read_program
from models.scan_file import read_scan
from palpmap.commands.scan import _truth
from palpmap.commands.scan_truth import write_truth
from palpmap.report.scan_console import refused_table, scan_table
from palpmap.result.press_outcomes import PressesRecord
from palpmap.result.scan_record import ScanRecord
from palpmap.run_folder import sha256
from palpmap.study.placement import place_scan
from palpmap.study.press_plan import grid_plan_of, program_plan_of, reachable
from palpmap.study.study import load_study
from palpmap.study.virtual_lab import default_study
from sim.body import Creep, HiddenBody, Inclusion, TruthMap
from sim.motion import ScanSettings

SMALL = ("scan", "--presses-per-side", "2", "--quiet")


@pytest.fixture(scope="module")
def spaced(run_here, tmp_path_factory):
    """A scan made in a folder with a space in its name, into another one."""
    here = tmp_path_factory.mktemp("my work")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(here)
        run = run_here(*SMALL, "--seed", "5", folder=Path("first run"))
    return run, here / "first run"


def test_a_scan_works_in_and_into_a_folder_with_a_space_in_its_name(spaced):
    run, folder = spaced
    assert run.exit_code == 0, run.stderr
    assert run.record["kept"]
    assert run.record["presses_kept"] == 4
    left = {path.name for path in folder.iterdir()}
    assert left == {
        "scan.csv", "presses.json", "study.toml", "truth.json", "recording.rrd", "run.json",
        "samples.parquet",
    }  # fmt: skip
    told = PressesRecord.read(folder / "presses.json").presses
    assert [(press.outcome, press.kept) for press in told] == [("made", True)] * 4


def test_what_was_written_into_a_folder_with_a_space_is_found_again(spaced, run_review):
    _, folder = spaced
    code, said = run_review(folder)
    assert code == 0
    assert (said["presses"], said["planned_presses"], said["seed"]) == (4, 4, 5)


STUDY = """\
[study]
name = "on the bench"
scan = "scan.csv"

[body]
shape = "block"
size_m = [0.08, 0.08, 0.04]
origin_m = [0.3, -0.2, 0.1]
poisson_ratio = 0.45

[probe]
tip = "flat"
radius_m = 0.004
"""
PROGRAM = """\
x_m,y_m,radius_m,force_n,ramp_s,hold_s,nx,ny,nz
0.34,-0.16,0.004,0.2,0.8,0.4,0,0,-1
{},-0.17,0.004,0.2,0.8,0.4,{},0,{}
"""


@pytest.fixture
def bench(tmp_path):
    """A study whose body stands beside the origin of its scan, and a program of two presses."""
    (tmp_path / "study.toml").write_text(STUDY)
    (tmp_path / "program.csv").write_text(PROGRAM.format(0.35, np.sin(0.7), -np.cos(0.7)))
    return tmp_path


def test_study_scan_and_sentences_have_the_frame_of_the_users_tables(bench, run_here):
    run = run_here(
        "scan", "--study", bench / "study.toml", "--program", bench / "program.csv", "--quiet",
        folder=bench / "run",
    )  # fmt: skip
    assert (run.exit_code, run.record["outcomes"]) == (1, {"made": 1, "skipped": 1}), run.stderr
    scan, study = read_scan(bench / "run" / "scan.csv"), load_study(bench / "run" / "study.toml")
    assert study.body.origin_m == (0.3, -0.2, 0.1)
    np.testing.assert_allclose(scan.contact_points, [[0.34, -0.16, 0.14]], atol=2e-4)
    assert place_scan(scan, study).distance_m.max() < 2e-4
    plan = program_plan_of(study, read_program(bench / "program.csv"))
    _, motion = reachable(plan, ScanSettings())
    assert str(motion.refused[0]).startswith("Press 1 at (350.0, -170.0, 140.0) mm")
    assert "350.0, -170.0, 140.0" in list(refused_table(motion.refused).columns[1].cells)


def test_a_body_is_scanned_before_there_is_a_scan_of_it_but_not_one_from_contacts(
    bench, run_here, monkeypatch
):
    monkeypatch.chdir(bench)
    text = STUDY.replace('scan = "scan.csv"\n', "")
    (bench / "study.toml").write_text(text)
    run = run_here(
        "scan", "--study", "study.toml", "--presses", "1", "--force", "0.1", "--quiet",
        folder=bench / "run",
    )  # fmt: skip
    assert run.exit_code == 0, run.stderr
    assert load_study(bench / "run" / "study.toml").scan == bench / "run" / "scan.csv"
    contacts = text.replace('"block"', '"from-contacts"').replace("size_m", "#")
    (bench / "study.toml").write_text(contacts.replace("poisson", "thickness_m = 0.03\npoisson"))
    run = run_here("scan", "--study", "study.toml", folder=bench / "other")
    assert run.exit_code == 2
    said = " ".join(run.stderr.split())
    assert 'make the surface of a body "from-contacts"; name it under study.scan' in said
    with pytest.raises(InputError, match=r"study\.scan: the key is missing"):
        load_study("study.toml")


def test_a_press_of_a_program_beside_the_body_is_named_in_the_programs_frame(bench):
    program = bench / "program.csv"
    program.write_text(PROGRAM.format(0.5, 0, -1))
    with pytest.raises(InputError, match=r"at x_m 0\.5, y_m -0\.17: .* from 0\.3 to 0\.38 m in x"):
        program_plan_of(load_study(bench / "study.toml"), read_program(program))


@pytest.mark.slow
def test_a_force_that_would_press_the_phantom_flat_is_lowered_and_said(run_here, tmp_path):
    run = run_here(*SMALL, "--force", "3", folder=tmp_path / "run")
    assert run.exit_code == 0
    record = ScanRecord.model_validate(run.record)
    assert (record.lowered, record.outcomes) == (4, {"made": 4})
    assert 0.45 < record.largest.depth_share <= 0.5
    told = PressesRecord.read(tmp_path / "run" / "presses.json").presses
    assert all(press.kept and press.set_force_n < 1.6 for press in told)
    assert told[0].reason.startswith("with 1.51 N in place of 3 N: 3 N would go 47.2 mm deep;")


@pytest.mark.slow
def test_the_papers_force_presses_so_deep_that_it_is_said(run_here, tmp_path):
    run = run_here(*SMALL, "--paper-force", folder=tmp_path / "run")
    assert run.exit_code == 0, run.stderr
    record = ScanRecord.model_validate(run.record)
    assert record.largest.depth_share == pytest.approx(0.99, abs=0.01)
    table = scan_table(record)
    assert "deepest press" in list(table.columns[0].cells)  # pyright: ignore[reportAttributeAccessIssue]
    assert max(read_scan(tmp_path / "run" / "scan.csv").displacement_m) < 0.048


@pytest.mark.slow
def test_one_seed_gives_one_scan_bit_for_bit(spaced, run_here, tmp_path):
    _, folder = spaced  # by a process of its own, and again by this one
    again = run_here(*SMALL, "--seed", "5", folder=tmp_path / "again")
    assert again.exit_code == 0, again.stderr
    assert sha256(folder / "scan.csv") == sha256(again.folder / "scan.csv")


def test_the_truth_of_an_earlier_scan_is_pressed_again(tmp_path):
    study, said = default_study(), tmp_path / "truth.json"
    plan = grid_plan_of(study, 0.3, 2)
    drawn = _truth("random", study, plan, 7)
    write_truth(tmp_path, HiddenBody(truth=drawn.map), ())
    assert _truth(str(said), study, plan, 0) == drawn
    creeping = replace(drawn, law=Fung(2.0), creep=Creep((0.2, 0.1), (0.5, 5.0)), sticking=False)
    write_truth(tmp_path, HiddenBody(truth=drawn.map), (), creeping)
    assert _truth(str(said), study, plan, 0) == creeping
    extra = Inclusion(5000.0, (0.06, 0.03, 0.034), 0.008)
    hidden = {"name": "extra_inclusion", "category": "structured", "values": {"weight_pa": 5e3}}
    both = TruthMap(drawn.map.background_pa, (*drawn.map.inclusions, extra))
    write_truth(tmp_path, HiddenBody(truth=both), [hidden])
    again = _truth(str(said), study, plan, 0)
    assert again.map == drawn.map  # the effect adds its inclusion itself
    assert [record["name"] for record in again.earlier.records] == ["extra_inclusion"]
