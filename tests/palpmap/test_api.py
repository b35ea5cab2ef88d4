"""The Python door: what it returns is what the commands leave."""

import json
import subprocess
import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import palpmap as pm
from palpmap import selection
from palpmap.study import open_study
from tests.paths import LAB, ROOT, TWELVE

STUDY = TWELVE / "study.toml"
NAMES = ("contact_offset", "force_drift", "viscoelasticity")


@pytest.fixture(scope="module")
def fitted() -> pm.FitResult:
    return pm.fit(pm.read_study(LAB / "case_a" / "study.toml"), inclusions=1)


@pytest.fixture(scope="module")
def twelve() -> pm.FitResult:
    """A fit of twelve presses, made in a moment."""
    return pm.fit(pm.read_study(STUDY))


@pytest.fixture(scope="module")
def why() -> pm.Explanation:
    """Twelve presses with a hidden `contact_offset`, put together in memory."""
    study = pm.read_study(STUDY)
    experiment = pm.Experiment(
        study.scan,
        pm.Block((0.06, 0.06, 0.03), poisson_ratio=0.45, cell_size_m=0.01),
        pm.FlatTip(0.004),
        noise=study.study.noise,
    )
    said: list[str] = []
    effects = [effect for effect in pm.CATALOGUE if effect.name in NAMES]
    found = pm.explain(experiment, effects, progress=said.append)
    assert "fitting the map" in said
    return found


def test_every_public_name_is_there_and_documented():
    for name in pm.__all__:
        thing = getattr(pm, name)
        assert isinstance(thing, str | tuple) or ">>>" in (thing.__doc__ or ""), name
    with pytest.raises(AttributeError, match="palpmap has no 'fitt'"):
        _ = pm.fitt  # pyright: ignore[reportAttributeAccessIssue]


@pytest.mark.parametrize("tip", ["flat", "sphere"])
def test_a_fixed_value_is_held_where_the_number_of_inclusions_is_found(tmp_path, tip):
    scan = pm.read_scan(TWELVE / "scan.csv")
    pm.write_scan(scan.rows(scan.press % 2 == 0), tmp_path / "scan.csv")
    text = STUDY.read_text().replace('"flat"', f'"{tip}"').split("[map]")[0]
    study = tmp_path / "study.toml"
    study.write_text(text + '[map]\ninclusions = "auto"\n[map.fixed]\nbackground_pa = 4900')
    background = pm.fit(pm.read_study(study)).parameters["background_pa"]
    assert (background.value, background.free) == (4900.0, False)


def test_a_map_whose_values_are_all_fixed_is_fitted_and_explained(tmp_path):
    free = "[map.initial]\nbackground_pa = 5200.0\n\n[map.fixed]"
    text = STUDY.read_text()
    assert free in text
    study = tmp_path / "study.toml"
    study.write_text(text.replace(free, "[map.fixed]\nbackground_pa = 5000.0"))
    (tmp_path / "scan.csv").write_bytes((TWELVE / "scan.csv").read_bytes())
    experiment = pm.read_study(study)
    fit = pm.fit(experiment)
    assert fit.success
    assert not fit.covariance_names
    assert fit.values["background_pa"] == 5000.0
    why = pm.explain(experiment, [pm.CATALOGUE["contact_offset"]])
    assert why.final.fit.covariance_names == ("contact_offset.offset_m",)
    assert why.added == ("contact_offset",)
    assert why.final.fit.values["contact_offset.offset_m"] == pytest.approx(1.5e-4, rel=0.05)


def test_the_import_alone_loads_nothing_heavy():
    code = "import sys, palpmap; print({'numpy', 'scipy', 'fem', 'pydantic'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


@pytest.mark.slow
def test_a_fit_holds_the_truth_and_shows_itself(fitted):
    truth = json.loads((LAB / "case_a" / "truth.json").read_text())["body"]
    found = fitted.parameters["background_pa"]
    assert fitted.success
    assert found.lower95 < truth["background_pa"] < found.upper95
    assert fitted.covariance.shape == (6, 6)
    assert fitted.map.background_pa == found.value
    assert "background" in fitted.summary()
    assert "kPa" in fitted.summary()
    assert len(fitted.plot_map().axes) >= 2
    assert fitted.plot_residual().axes
    assert '<img src="data:image/png;base64,' in fitted._repr_html_()


@pytest.mark.slow
def test_a_comparison_is_that_of_the_fit(fitted):
    comparison = pm.compare(fitted)
    assert comparison.is_noise
    assert {test.name for test in comparison.tests} >= {"time", "force"}
    assert comparison.statement in comparison.summary().replace("\n", " ")
    assert comparison.plot().axes
    assert comparison.to_dict()["is_noise"] is True


def test_a_written_fit_is_the_commands_folder_and_reads_back(twelve, tmp_path, run_here):
    written = twelve.write(tmp_path / "door")
    done = run_here("fit", STUDY, folder=tmp_path / "command")
    assert done.exit_code == 0, done.stderr
    assert {p.name for p in written.iterdir()} == {p.name for p in done.folder.iterdir()}
    theirs = json.loads((done.folder / "fit.json").read_text())
    ours = json.loads((written / "fit.json").read_text())
    for name, entry in theirs["parameters"].items():
        assert ours["parameters"][name]["value"] == pytest.approx(entry["value"], rel=1e-6)
    again = pm.read_run(written)
    assert again.verdict is None
    assert again.fit.parameters == twelve.parameters
    np.testing.assert_array_equal(again.fit.residual_m, twelve.residual_m)
    assert again.fit.summary().split("residual", 1)[1] == twelve.summary().split("residual", 1)[1]


@pytest.mark.slow
def test_a_missing_effect_is_found_from_memory(why):
    assert why.verdict == "explained"
    assert why.added == ("contact_offset",)
    assert [step.fit.effect_names for step in why.ladder] == [(), ("contact_offset",)]
    assert {row.name for row in why.candidates} == set(NAMES)
    assert {row.name for row in why.limits} == set(NAMES)
    assert why.next_presses == ()
    assert "Explained. With contact_offset" in why.summary().replace("\n", " ")
    assert why.plot_ladder().axes
    offset = why.fit.parameters["contact_offset.offset_m"]
    assert offset.lower95 < 0.15e-3 < offset.upper95


def test_a_written_explanation_reads_back(why, tmp_path):
    folder = why.write(tmp_path / "why")
    names = {p.name for p in folder.iterdir()}
    assert {"result.json", "fit.json", "report.html", "recording.rrd", "study.toml"} <= names
    run = pm.read_run(folder)
    assert run.verdict == why.verdict
    assert run.result is not None
    assert run.result.to_dict()["parameters"] == json.loads(json.dumps(why.to_dict()["parameters"]))
    assert [e.name for e in run.experiment.study.effects] == ["contact_offset"]
    assert run.fit.parameters == why.fit.parameters


def test_written_limits_are_the_commands_folder(tmp_path, run_here):
    found = pm.limits(pm.read_study(STUDY))
    written = found.write(tmp_path / "door")
    done = run_here("limits", STUDY, "--no-plan", folder=tmp_path / "command")
    assert done.exit_code == 0, done.stderr
    assert {p.name for p in written.iterdir()} == {p.name for p in done.folder.iterdir()}
    assert json.loads((written / "limits.json").read_text()) == found.to_dict()


@pytest.mark.slow
def test_the_virtual_robot_follows_a_program():
    program = pm.PressProgram(
        x_m=np.array([0.03, 0.05]),
        y_m=np.array([0.04, 0.06]),
        force_n=np.array([0.2, 0.4]),
        radius_m=np.full(2, 0.005),
        ramp_s=np.full(2, 0.8),
        hold_s=np.full(2, 0.4),
        unload_s=np.full(2, 0.4),
        pause_s=np.ones(2),
    )
    done = []
    body = pm.Block((0.096, 0.096, 0.048), poisson_ratio=0.49)
    scan = pm.scan(body, program, arm=pm.ScanSettings(hold_samples=5), seed=3, on_press=done.append)
    deepest = scan.at_largest_force(scan.force_n)
    np.testing.assert_allclose(deepest, [0.2, 0.4], rtol=0.05)
    np.testing.assert_allclose(scan.contact_points[:, 0], [0.03, 0.05], atol=2e-4)
    assert np.bincount(scan.press_index[scan.phase == "hold"]).tolist() == [5, 5]
    assert [press.statistics.set_force_n for press in done] == [0.2, 0.4]
    moved = pm.Block((0.096, 0.096, 0.048), poisson_ratio=0.49, origin_m=(0.01, 0.0, -0.048))
    elsewhere = pm.scan(moved, replace(program, x_m=program.x_m + 0.01), seed=3)
    np.testing.assert_allclose(elsewhere.contact_points[:, 0], [0.04, 0.06], atol=2e-4)
    np.testing.assert_allclose(elsewhere.contact_points[:, 2], 0.0, atol=2e-4)


@pytest.mark.slow
def test_a_scripted_scan_becomes_an_experiment():
    body = pm.Block((0.08, 0.08, 0.04), poisson_ratio=0.45, cell_size_m=0.01)
    tip, program = pm.FlatTip(0.005), pm.grid_program(body.size_m, per_side=2, force_n=0.2)
    scan = pm.scan(body, program, map=pm.GaussianMap(8000.0), seed=1)
    fit = pm.fit(pm.Experiment(scan, body, tip), inclusions=0)
    found = fit.parameters["background_pa"]
    assert found.value == pytest.approx(8000.0, rel=0.02)


TIP, BODY = pm.FlatTip(0.004), pm.Block((0.06, 0.06, 0.03), poisson_ratio=0.45)
WRONG: Any = TIP
SIZE = (0.1, 0.1, 0.05)
SHAPE: Any = {"shape": "block", "size_m": SIZE}
WRONG_EFFECTS: Any = ["force_drift"]
WRONG_SCAN: Any = "scan.csv"
WRONG_INCLUSION: Any = pm.Inclusion(9e3, 0.03, 0.03, 0.02, 0.01)
NOTHING: Any = None


def in_other_units(**factors: float) -> pm.Experiment:
    """Return the twelve presses with columns times a factor."""
    scan = pm.read_scan(TWELVE / "scan.csv")
    columns: Any = {name: factor * getattr(scan, name) for name, factor in factors.items()}
    return pm.Experiment(replace(scan, **columns), BODY, TIP)


def of_arrays(**values) -> pm.Experiment:
    """Return the twelve presses with one value of a column in all rows."""
    scan = pm.read_scan(TWELVE / "scan.csv")
    columns: dict[str, Any] = {
        k: np.broadcast_to(v, scan.columns[k].shape) for k, v in values.items()
    }
    return pm.Experiment(replace(scan, **columns), BODY, TIP)


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: pm.FlatTip(-1.0), "radius_m: found -1.0, expected"),
        (lambda: pm.Block((0.1, 0.1), poisson_ratio=0.4), "size_m"),
        (lambda: pm.Block((0.1, 0.1, 0.1), poisson_ratio=0.6), "poisson_ratio: found 0.6"),
        (
            lambda: pm.Body(**(SHAPE | {"poison_ratio": 0.4})),
            "poison_ratio: unknown key; the nearest right name is 'poisson_ratio'; expected shape,",
        ),
        (lambda: pm.Body(**SHAPE), "poisson_ratio: the key is missing; add Poisson's ratio"),
        (lambda: pm.Body(shape="block", poisson_ratio=0.4), "Body: expected size_m = [x, y, z]"),
        (
            lambda: pm.Body(shape="blok", size_m=SIZE, poisson_ratio=0.4),  # pyright: ignore[reportArgumentType]
            "shape: found 'blok', expected 'block', 'surface' or 'from-contacts'; the nearest",
        ),
        (lambda: pm.Study(**{"body": BODY, "probe": TIP}), "study: the key is missing; add the"),
        (lambda: pm.Noise(displacement_m=-1.0), "displacement_m: found -1.0, expected"),
        (lambda: of_arrays(force_n=np.nan), "scan, row 1, column force_n: found nan"),
        (lambda: of_arrays(direction=(0, 0, -2)), "column nx, ny, nz: found a length of 2"),
        (lambda: of_arrays(phase="approach"), "press 0 has 0 samples with phase load"),
        (
            lambda: in_other_units(point_m=1e3),
            "found 50 m, expected at most 3 m; this looks like mill",
        ),
        (lambda: in_other_units(displacement_m=1e3), "column displacement_m: found"),
        (lambda: in_other_units(force_n=1e3), "millinewtons (divide by 1000) (if the values are"),
        (lambda: of_arrays(probe_radius_m=4.0), "right, give units_checked=True)"),
        (
            lambda: pm.Experiment(
                of_arrays().scan, pm.Block((60, 60, 30), poisson_ratio=0.45), TIP
            ),
            "body.size_m: found 60 m, expected at most 1 m; this looks like millimetres",
        ),
        (
            lambda: pm.Experiment(of_arrays().scan, BODY, TIP, noise=pm.Noise(force_n=5.0)),
            "noise.force_n: found 5 N",
        ),
        (lambda: pm.Experiment(of_arrays().scan, WRONG, TIP), "body: found Probe("),
        (lambda: pm.diagnose(of_arrays(), effects=WRONG_EFFECTS), "effects: found 'force_drift'"),
        (
            lambda: pm.diagnose(of_arrays(), effects=WRONG_EFFECTS[0]),
            "expected a list, each an ",
        ),
        (
            lambda: pm.Experiment(WRONG_SCAN, BODY, TIP),
            "scan: found 'scan.csv', expected a Scan: g",
        ),
        (lambda: pm.Block(WRONG_SCAN, poisson_ratio=0.4), "size_m"),
        (
            lambda: pm.Block(NOTHING, poisson_ratio=0.4),
            "expected size_m = [x, y, z] in m",
        ),
        (
            lambda: pm.fit(of_arrays(), optimizer=WRONG_SCAN),
            "optimizer: found 'scan.csv', expected",
        ),
        (
            lambda: pm.scan(plant=WRONG_EFFECTS),
            "plant: found 'force_drift', expected 2 val",
        ),
        (
            lambda: pm.scan(plant=[("force_drft", 0.03)]),
            "the nearest right name is 'force_drift', or",
        ),
        (
            lambda: pm.scan(BODY, map=pm.GaussianMap(6e3, (pm.Inclusion(9e3, 0.5, 0, 0, 0.01),))),
            "map.inclusions.0.x_m: found 0.5 m, expected 0 to 0.06 m, inside the body",
        ),
        (lambda: pm.scan(WRONG), "body: found Probe(tip='flat'"),
        (
            lambda: pm.scan(BODY, map=WRONG_SCAN),
            "expected a GaussianMap: give pm.Gau",
        ),
        (lambda: pm.scan(BODY, arm=WRONG), "arm: found Probe("),
        (lambda: pm.scan(BODY, WRONG), "expected a PressProgram or a path: give pm.grid_prog"),
        (lambda: pm.scan(BODY, presses=WRONG), "presses: found Probe("),
        (lambda: pm.scan(BODY, tips=WRONG), "tips: found Probe("),
        (lambda: pm.grid_program(WRONG), "expected 3 values, each a finite number"),
        (lambda: pm.grid_program(SIZE, per_side=WRONG), "per_side: found Probe("),
        (lambda: pm.GaussianMap(WRONG_SCAN), "background_pa: found 'scan.csv', expected a finite"),
        (
            lambda: pm.GaussianMap(6e3, WRONG_INCLUSION),
            "expected a list, each an Inclusion",
        ),
        (lambda: pm.diagnose(of_arrays(), effects=NOTHING), "found None, expected a list, each an"),
        (lambda: pm.fit(of_arrays(), progress=NOTHING), "progress: found None, expected a func"),
        (lambda: of_arrays().scan.replace(force_n=np.ones(3)), "force_n has shape (3,), expected"),
        (lambda: pm.read_study("nowhere.toml"), "nowhere.toml: no such file"),
        (lambda: pm.read_run(ROOT / "docs"), "found no fit.json"),
    ],
)
def test_bad_input_gets_a_sentence(make, sentence):
    with pytest.raises(pm.InputError) as caught:
        make()
    assert sentence in str(caught.value)
    assert "\n" not in str(caught.value)


def test_too_few_samples_are_refused_as_in_a_study(twelve):
    with pytest.raises(pm.InputError, match="samples: found 10, expected a whole number from 1000"):
        twelve.sample(10)


def test_a_number_of_inclusions_may_be_numpys():
    number: Any = np.int64(2)
    assert of_arrays().with_inclusions(number).study.map.inclusions == 2


def test_a_body_takes_arrays():
    body = pm.Body(**(SHAPE | {"size_m": np.array(SIZE), "poisson_ratio": np.float64(0.4)}))
    assert body == pm.Block(SIZE, poisson_ratio=0.4)


def test_strange_units_that_are_meant_are_taken():
    scan = pm.read_scan(TWELVE / "scan.csv")
    known = pm.Experiment(scan.replace(force_n=1e3 * scan.force_n), BODY, TIP, units_checked=True)
    assert known.study.study.units_checked


def test_an_explanation_tells_of_the_start_that_it_was_made_from(monkeypatch):
    """Of the model beside which the answer holds: without an error of the map, say."""
    real = selection.explain_scan

    def without_error(problem, seed, on_step):
        found, without, answered = real(problem, seed, on_step)
        model = replace(answered.model, press_error=0.25)
        return found, without, replace(answered, model=model)

    monkeypatch.setattr(selection, "explain_scan", without_error)
    study = pm.read_study(STUDY)
    why = pm.explain(study, [pm.CATALOGUE["contact_offset"]])
    assert why.problem.model.press_error == 0.25
    assert why.problem.study == study.study


def test_a_free_map_beside_a_thinned_scan_has_the_presses_of_the_inclusions(monkeypatch):
    """Of a scan of hundreds of presses it would take more of them, with which none can compare."""
    monkeypatch.setattr(open_study, "MOST_PRESSES", 8)
    asked = []

    def other_map(found, problem, open_free):
        asked.append((problem.scan.press_ids, open_free().scan.press_ids))

    monkeypatch.setattr(selection, "other_map", other_map)
    study = pm.read_study(STUDY)
    assert len(study.scan.press_ids) == 12
    pm.explain(study, [pm.CATALOGUE["contact_offset"]])
    ((of_inclusions, of_free_map),) = asked
    assert len(of_inclusions) == 8
    assert np.array_equal(of_free_map, of_inclusions)


def test_what_is_no_fit_is_refused_with_the_way_to_one(twelve):
    run = str(TWELVE)
    calls: tuple[Any, ...] = (
        pm.compare, lambda given: pm.predict(given, twelve.experiment),
        lambda given: pm.compare_runs(twelve, given), lambda given: pm.compare_runs(given, twelve),
    )  # fmt: skip
    ways = (
        (pm.read_run(run), f"found this Run, expected a FitResult: give pm.read_run('{run}').fit"),
        (run, f"give pm.read_run('{run}').fit"),
        (twelve.experiment, "found this Experiment, expected a FitResult: give pm.fit(experiment)"),
        (None, "found None, expected a FitResult: give pm.fit(experiment), or pm.read_run(folder)"),
    )
    for call in calls:
        for given, said in ways:
            with pytest.raises(pm.InputError) as caught:
                call(given)
            assert said in str(caught.value)


@pytest.mark.parametrize("given", ["study.toml", None, 3])
def test_what_is_no_experiment_is_refused_in_a_sentence(given, twelve):
    calls: tuple[Any, ...] = (
        pm.fit, pm.diagnose, pm.explain, pm.limits, lambda given: pm.predict(twelve, given)
    )  # fmt: skip
    for call in calls:
        with pytest.raises(pm.InputError, match=r"expected an Experiment: give pm\.read_study"):
            call(given)
