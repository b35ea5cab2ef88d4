"""A study with a free map: its keys, its faces, and the sentences for what does not work."""

import json
import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import palpmap as pm
from identify.map import FreeMap, Grid
from models import InputError
from palpmap.__main__ import app
from palpmap.blind.seal import unseal
from palpmap.blind.trial import Trial, make_trial
from palpmap.figures.cuts import cuts, sample, seen_part
from palpmap.figures.map import extension
from palpmap.recording.maps import cut_views, map_views
from palpmap.result.outline import Outline

STUDY = Path("tests/data/twelve_presses/study.toml").resolve()
BOX = np.array([[0.0, 0.0, 0.0], [0.06, 0.06, 0.03]])  # of a body, m


def study(folder: Path, table: str) -> Path:
    text = STUDY.read_text(encoding="utf-8").split("[map]")[0]
    text = text.replace('"scan.csv"', f'"{(STUDY.parent / "scan.csv").as_posix()}"')
    path = folder / "study.toml"
    path.write_text(f"{text}\n[map]\n{table}\n", encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """What `fit` said of a study with a free map, the study and its run folder."""
    folder = tmp_path_factory.mktemp("free")
    path, run = study(folder, 'kind = "free"'), folder / "run"
    return CliRunner().invoke(app, ["fit", str(path), "--out", str(run)]), path, run


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ('kind = "free"\ninclusions = 2', "no key 'inclusions'"),
        ("length_m = 0.01", "no key 'length_m'"),
        ('kind = "free"\nspread = 9.0', "less than or equal to 4"),
        ('kind = "free"\nlength_m = 12.0', "divide by 1000"),
        ('kind = "free"\nsmoothness = 1.0', "0.5, for a body of any kind, or 1.5"),
        ("smoothness = 0.5", "no key 'smoothness'"),
        ('kind = "fre"', "nearest right name is 'free'"),
    ],
)
def test_wrong_keys_are_one_sentence(tmp_path, table, said):
    with pytest.raises(InputError, match=said):
        pm.read_study(study(tmp_path, table))


def test_a_length_below_the_mesh_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"study.toml, key map.length_m: found 0.001 m, expected"):
        pm.fit(pm.read_study(study(tmp_path, 'kind = "free"\nlength_m = 0.001')))


def test_what_does_not_work_is_said(tmp_path):
    experiment = pm.read_study(study(tmp_path, 'kind = "free"'))
    with pytest.raises(InputError, match="takes no number of inclusions"):
        pm.fit(experiment, inclusions=2)


@pytest.mark.slow
def test_the_kind_of_map_is_decided_by_evidence_and_said(tmp_path):
    found = pm.fit(pm.read_study(study(tmp_path, 'kind = "auto"')))
    assert "the kind of map by evidence" in found.message
    assert "log evidence" in found.message
    with pytest.raises(InputError, match="takes no number of inclusions"):
        pm.fit(pm.read_study(study(tmp_path, 'kind = "auto"')), inclusions=2)


def test_a_free_fit_is_written_read_and_compared(made):
    done, path, run = made
    runner = CliRunner()
    assert "free map" in runner.invoke(app, ["check", str(path)]).output
    assert done.exit_code == 0, done.output
    assert "depth of sight" in done.output
    again = pm.read_run(run).fit
    areas = json.loads((run / "fit.json").read_text(encoding="utf-8"))["field"]["areas"]
    assert [a.contrast for a in again.field.areas] == [a["contrast"] for a in areas] != []
    assert "Felt, times" in done.output
    compared = runner.invoke(app, ["compare", str(run)])
    assert compared.exit_code in (0, 1), compared.output
    assert "Traceback" not in compared.output
    assert compared.exception is None or isinstance(compared.exception, SystemExit)
    import pyvista

    volume = pyvista.read(run / "map.vti")
    points = np.array(volume.points)[::37]
    written = np.array(volume.point_data["modulus_pa"])[::37]
    assert again.map.modulus(points) == pytest.approx(written, rel=1e-4)
    assert (np.array(volume.point_data["lower95_pa"]) < volume.point_data["modulus_pa"]).all()
    report = (run / "report.html").read_text(encoding="utf-8")
    assert "a free map" in report
    assert "depth of sight" in report
    assert "a ball of 10 mm, 3 times as hard" in report
    assert 0 <= again.field.ball_sight_m < 0.03


def test_a_stated_smoothness_is_the_priors_and_is_read_again(made, tmp_path):
    gradual = pm.read_study(study(tmp_path, 'kind = "free"\nsmoothness = 1.5'))
    fit = pm.fit(gradual)
    assert "1.5, for gradual changes" in fit.summary()
    fit.write(tmp_path / "run")
    again = pm.read_run(tmp_path / "run").fit
    assert again.field.hyper.smoothness == 1.5
    prior = again.field.hyper.prior(again.map.grid)
    s = np.sqrt(3)
    at_length = prior.spread**2 * (1 + s) * np.exp(-s)
    assert prior.covariance(np.array([prior.length_m])) == pytest.approx(at_length)
    with pytest.raises(InputError, match="a body of any kind"):
        gradual.of_kind("free", 3.0)
    steep = pm.read_run(made[2]).fit
    assert steep.field.hyper.smoothness == 0.5
    assert np.abs(steep.map.log_pa - fit.map.log_pa).max() > 0.01


def test_a_run_from_before_its_prior_had_a_name_is_of_gradual_changes(made, tmp_path):
    file = shutil.copytree(made[2], tmp_path / "run") / "fit.json"
    record = json.loads(file.read_text(encoding="utf-8"))
    del record["field"]["hyper"]["smoothness"]
    file.write_text(json.dumps(record), encoding="utf-8")
    assert pm.read_run(tmp_path / "run").fit.field.hyper.smoothness == 1.5


@pytest.mark.slow
def test_limits_say_how_deep_a_scan_sees(tmp_path):
    path = study(tmp_path, 'kind = "free"')
    found = pm.limits(pm.read_study(path), [pm.CATALOGUE["contact_offset"]])
    assert found.fit.field is not None
    assert found.record.sight_m == found.fit.field.sight_m > 0.003
    said = " ".join(found.summary().split())
    assert f"Depth of sight: {1e3 * found.record.sight_m:.2f} mm under the middle press" in said
    assert "E0, w, z" not in said


@pytest.mark.slow
def test_limits_plan_scans_of_other_tips_and_lengths(tmp_path):
    """A scan with other tips, or a longer one, has other presses than the map was found by."""
    found = pm.limits(pm.read_study(study(tmp_path, 'kind = "free"')), plan=True)
    better = found.record.model_dump()["limits"]
    assert any(limit["better_scan"] for limit in better)
    assert sum(limit["in_mixed_scan"] is not None for limit in better) > 15


@pytest.mark.slow
def test_presses_that_slipped_under_a_free_map_are_named_and_make_no_spots(tmp_path):
    """Three balls were sure soft spots of a tenth of the modulus there, and nothing was missing.

    Two of the four presses are neighbours, which one ball explains.
    """
    make_trial(tmp_path, Trial(10014, ("outside_slipped_presses",), (0.05,), 1))
    answer = unseal(tmp_path)
    hidden = answer.effects[0].values
    slipped = tuple(sorted(int(v) for name, v in hidden.items() if name != "share"))
    path = tmp_path / "study.toml"
    path.write_text(path.read_text().split("[map]")[0] + '[map]\nkind = "free"\n')
    made = pm.fit(pm.read_study(path))
    assert "presses that slipped" in made.summary()
    (spot,) = made.field.spots
    (true,) = answer.body.inclusions
    assert spot.wide
    assert np.hypot(spot.x_m - true.x_m, spot.y_m - true.y_m) < 0.002
    found = pm.explain(pm.read_study(path), [pm.CATALOGUE["contact_offset"]])
    assert found.verdict == "unexplained"
    assert tuple(found.record.presses_apart) == slipped
    assert "4 of 81 presses, which stand apart" in found.summary()


def test_a_free_map_is_cut_where_it_differs_from_its_layer_in_sight():
    """Layers, and depths that the scan does not see, may differ by more than any lump."""
    grid = Grid.over(BOX, 0.005)
    x, y, z = grid.points_m.T
    lump = np.exp(-((x - 0.02) ** 2 + (y - 0.04) ** 2 + (z - 0.02) ** 2) / 0.006**2)
    deep = np.where((z < 0.01) & (x > 0.05), 5.0, 0.0)
    found = FreeMap(grid, 8.0 + 100 * (0.03 - z) + 0.4 * lump + deep)
    field = SimpleNamespace(spots=(), share=np.where(z < 0.01, 0.05, 0.9))
    outline = Outline(
        *BOX,
        lambda p: p[:, 0] >= 0,
        lambda p: np.full(len(p), 0.03),
    )
    fit: Any = SimpleNamespace(map=found, field=field)
    f: Any = SimpleNamespace(fit=fit, outline=outline, probed_m=None)
    above, side = cuts(f)
    assert (above.at_m, side.at_m) == pytest.approx((0.01, 0.04), abs=0.0026)
    # Its colours are those of the part in sight
    values = sample(f, side, found.modulus)
    seen = seen_part(f, fit, side, values)
    blind = np.isnan(seen)
    assert blind.any()
    assert np.nanmax(seen) < 0.2 * values.max()
    assert extension([values], (np.nanmin(seen), np.nanmax(seen))) == "max"
    assert np.array_equal(seen[~blind], values[~blind])
    # A recording shows the same, where a line of sight would end in what no press shows
    f.origin_m = np.zeros(3)
    views = cut_views(f, fit, found.modulus)
    np.testing.assert_array_equal(views.side_pa, seen)
    assert views.range_pa[1] == np.nanmax([np.nanmax(views.top_pa), np.nanmax(seen)])
    assert views.range_pa[1] < 0.2 * map_views(found.modulus, *BOX).range_pa[1]
    assert views.captions == (
        "10 mm below the surface", "from the side, cut at y = 40 mm"
    )  # fmt: skip
    fit = SimpleNamespace(map=found, field=None)
    assert seen_part(f, fit, side, values) is values


def test_a_cut_follows_a_curved_surface_and_shows_a_spot_just_above_it():
    """The surface of finite elements is a smoothed one: a spot found near it may lie outside."""

    def top(places):
        return 0.03 - 20 * ((places - 0.03) ** 2).sum(axis=1)

    outline = Outline(
        np.zeros(3), np.array([0.06, 0.06, 0.03]), lambda p: p[:, 2] <= top(p[:, :2]), top
    )
    grid = Grid.over(np.array([[0.0, 0.0, 0.0], [0.06, 0.06, 0.03]]), 0.005)
    found = FreeMap(grid, np.full(len(grid.points_m), 8.0))
    spot = SimpleNamespace(wide=False, x_m=0.03, y_m=0.03, z_m=0.0305)
    fit: Any = SimpleNamespace(map=found, field=SimpleNamespace(spots=(spot,), share=np.ones(1)))
    f: Any = SimpleNamespace(fit=fit, outline=outline, probed_m=None)
    above, side = cuts(f)
    assert 0 < above.at_m < 0.002
    depth = sample(f, above, lambda p: top(p[:, :2]) - p[:, 2])
    # All of the body but for its rim, which is thinner than the cut is deep
    assert np.isfinite(depth).mean() > 0.8
    np.testing.assert_allclose(depth[np.isfinite(depth)], above.at_m)
    assert np.isfinite(sample(f, side, found.modulus)).any()
