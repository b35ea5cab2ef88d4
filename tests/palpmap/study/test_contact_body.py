"""A body from a scan's contacts: its place, its moduli, its copy in a run folder, refusals."""

import json
import re
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from fem import Contacts, PalpationModel, block_mesh
from fem.mesh import under_surface
from identify.design.scan_variants import presses_of
from identify.effects import Readings
from models import InputError, read_program, read_scan, write_scan
from models.scan import Scan
from palpmap.__main__ import app
from palpmap.api import fit
from palpmap.commands.check import check_study
from palpmap.experiment import read_study
from palpmap.result.doubts import assumptions
from palpmap.result.next_scan import Sites, write_presses
from palpmap.result.outline import study_outline
from palpmap.sides import with_sides
from palpmap.study.body_model import _between
from palpmap.study.contact_body import contact_body
from palpmap.study.kept_inputs import keep_inputs
from palpmap.study.placement import place_scan
from palpmap.study.study import load_study
from tests.fem.mesh.test_contact_surface import HEIGHT, dome, grid, touched

MODULUS, NU, TIP, THICK = 8000.0, 0.45, 0.004, 0.026
NOISE = ("--displacement-noise", "2e-5", "--force-noise", "2e-3")
ALOFT = np.array([0.3, -0.2, -0.1])  # of the robot's frame


@cache
def dome_scan(in_the_air: bool = False, force_n: float = 0.2) -> Scan:
    """Two readings a press on a homogeneous dome; the truth is meshed by its own formula."""
    points, inward = touched(grid(4))
    size = 0.04 + 1.5 * THICK, 0.036 + 1.5 * THICK, HEIGHT
    block = block_mesh(size, (8, 8, 4))
    corner = (-size[0] / 2, -size[1] / 2, float(points[:, 2].mean()) - THICK)
    far = 0.028  # beyond, the true dome would end

    def surface(xy: np.ndarray) -> np.ndarray:
        r = np.linalg.norm(xy, axis=1)
        return dome(xy * np.minimum(1, far / np.maximum(r, 1e-9))[:, None])

    model = PalpationModel(under_surface(block, corner, surface), NU, Contacts(points, inward, TIP))
    force = np.tile([0.5 * force_n, force_n], len(points))
    travel = force * np.repeat(model.evaluate(MODULUS).compliance, 2)
    points = np.repeat(points, 2, axis=0) + ALOFT
    if in_the_air:
        force[10:12], points[10:12, 2] = [0.0, 1e-5], points[10:12, 2] + 0.008
    m = len(force)
    return Scan(
        press=np.repeat(np.arange(m // 2), 2), time_s=np.arange(m), phase=["load", "hold"] * 16,
        point_m=points, direction=np.repeat(inward, 2, axis=0), force_n=force,
        displacement_m=travel, probe_radius_m=np.full(m, TIP), tip_pose=None,
    )  # fmt: skip


def new(folder: Path, scan: Scan, *words: str, code: int = 0) -> str:
    write_scan(scan, folder / "scan.csv")
    given = ["new", str(folder / "scan.csv"), "--tip", "flat", "--poisson", str(NU), *NOISE, *words]
    done = CliRunner().invoke(app, [*given, "--out", str(folder / "s"), "--json"])
    assert done.exit_code == code, done.output
    return done.output


@pytest.mark.slow
def test_a_homogeneous_dome_has_its_modulus(tmp_path):
    said = json.loads(new(tmp_path, dome_scan(), "--thickness", str(THICK), "--inclusions", "0"))
    assert "surface goes through 16 contact points" in " ".join(said["said"])
    study = Path(said["study"])
    study.write_text(study.read_text().replace("[body]", "[body]\ncell_size_m = 0.011"))
    found = fit(read_study(study))
    # Beyond the contacts the true dome falls further
    assert found.parameters["background_pa"].value == pytest.approx(MODULUS, rel=0.02)


@pytest.mark.slow
def test_an_organ_that_ends_at_its_base_has_the_stiffness_of_its_closed_surface(tmp_path):
    organ = Path("examples/organ/study.toml")
    scan = read_scan(organ.with_name("scan.csv"))
    thickness = f"{scan.contact_points[:, 2].mean():.3f}"
    said = json.loads(new(tmp_path, scan, "--thickness", thickness))
    closed, contacts = (
        read_study(study).opened(thin=False).body.fine.evaluate(MODULUS).compliance
        for study in (organ, said["study"])
    )
    assert contacts == pytest.approx(closed, rel=0.08)
    assert np.median(contacts / closed) == pytest.approx(1, abs=0.05)


def test_a_stated_margin_moves_the_sides(tmp_path):
    written = new(tmp_path, dome_scan(), "--thickness", str(THICK), "--margin", "0.007")
    body = contact_body(load_study(json.loads(written)["study"]).body)
    assert body.margin_m == pytest.approx(0.007)
    assert "State body.margin_m" not in written
    assumed = tmp_path / "assumed"
    assumed.mkdir()
    told = json.loads(new(assumed, dome_scan(), "--thickness", str(THICK)))
    assert "a fit takes nearer ones" in " ".join(told["said"])
    free = told["study"]
    for study, verdict, said in (
        (free, "explained", True), (free, "nothing_missing", False),
        (json.loads(written)["study"], "explained", False),
    ):  # fmt: skip
        final = SimpleNamespace(fit=SimpleNamespace(effect_names=()))
        explained: Any = SimpleNamespace(fitted_verdict=verdict, final=final)
        problem: Any = SimpleNamespace(study=load_study(study))
        assert ("state body.margin_m" in " ".join(assumptions(explained, problem))) is said
    bad = CliRunner().invoke(app, ["new", "s.csv", "--margin", "0.01", "--out", "s"])
    assert (bad.exit_code, "--margin belongs to" in bad.output) == (2, True)


@pytest.mark.slow
@pytest.mark.parametrize(("margin_m", "found"), [(0.005, 0.25), (THICK, 1.0)])
def test_sides_that_are_not_stated_are_found(tmp_path, margin_m, found):
    line = 0.009 * np.arange(5)
    x, y = (v.ravel() for v in np.meshgrid(line, line, indexing="ij"))
    points, down = np.column_stack([x, y, 0 * x]), np.tile([0.0, 0, -1], (25, 1))
    size = line[-1] + 2 * margin_m, line[-1] + 2 * margin_m, THICK
    placed = Contacts(points + np.array([margin_m, margin_m, THICK]), down, TIP)
    truth = PalpationModel(block_mesh(size, (12, 12, 8)), NU, placed)
    across = np.linalg.norm(truth.points_m[:, :2] - np.divide(size[:2], 2), axis=1)
    compliance = truth.evaluate(MODULUS * (1 + np.exp(-((across / 0.01) ** 2)))).compliance
    force = np.tile([0.1, 0.2], 25)
    noise = np.random.default_rng(0).normal(0, 2e-5, 50)
    scan = Scan(
        press=np.repeat(np.arange(25), 2), time_s=np.arange(50), phase=["load", "hold"] * 25,
        point_m=np.repeat(points, 2, axis=0), direction=np.repeat(down, 2, axis=0), force_n=force,
        displacement_m=force * np.repeat(compliance, 2) + noise,
        probe_radius_m=np.full(50, TIP), tip_pose=None,
    )  # fmt: skip
    experiment = read_study(json.loads(new(tmp_path, scan, "--thickness", str(THICK)))["study"])
    sides = with_sides(experiment)
    assert sides.study.body.margin_m == pytest.approx(0.75 * THICK * found)
    assert sides.study.body.margin_assumed
    assert with_sides(sides) is sides
    # A run folder keeps them
    assert experiment.source is not None
    done = CliRunner().invoke(
        app, ["fit", str(experiment.source), "--out", str(tmp_path / "run"), "--quiet"]
    )
    assert done.exit_code == 0, done.output
    kept = load_study(tmp_path / "run" / "study.toml").body
    assert (kept.margin_m, kept.margin_assumed) == (sides.study.body.margin_m, True)


@pytest.mark.slow
def test_a_press_in_the_air_bends_no_surface_and_is_fitted_by_nobody(tmp_path):
    said = json.loads(new(tmp_path, dome_scan(in_the_air=True), "--thickness", str(THICK)))
    assert "Press 5 (1 of 16): the force does not rise" in " ".join(said["said"])
    experiment = read_study(said["study"])
    points, _ = touched(grid(4))
    heights = contact_body(experiment.study.body).surface.heights(points[:, :2] + ALOFT[:2])
    assert np.abs(heights - points[:, 2] - ALOFT[2]).max() < 1e-3
    opened = experiment.opened(thin=False)
    assert 5 not in opened.scan.press_ids
    mesh = opened.body.coarse.mesh
    cell_m = check_study(said["study"]).cell_size_m
    assert cell_m == pytest.approx(np.cbrt(6 * mesh.volume / len(mesh.cells)), rel=0.1)
    assert experiment.study.map.kind == "free"


def test_the_bodys_frame_is_the_scans_and_its_outline_follows_the_surface(tmp_path):
    study = load_study(json.loads(new(tmp_path, dome_scan(), "--thickness", str(THICK)))["study"])
    placed = place_scan(read_scan(study.scan), study)
    points = touched(grid(4))[0] + ALOFT
    found = placed.scan.contact_points
    np.testing.assert_allclose(found[:, :2], points[:, :2], atol=1e-6)
    # On the body's smoothed surface, which the outermost contacts shape from one side alone
    np.testing.assert_allclose(found[:, 2], contact_body(study.body).surface.heights(found[:, :2]))
    np.testing.assert_allclose(found[:, 2], points[:, 2], atol=3e-4)
    assert placed.angle_deg.max() < 0.6
    outline = study_outline(study)
    middle = points.mean(axis=0)
    assert outline.inside(middle + np.outer([0, 0.01], [0, 0, 1])).tolist() == [True, False]
    assert outline.lower_m[2] == pytest.approx(points[:, 2].mean() - THICK)


@pytest.mark.slow
def test_waves_finer_than_the_cells_make_no_press_stiffer(tmp_path):
    points, inward = touched(grid(9))
    wave = 6e-4 * np.sin(2 * np.pi * points[:, 0] / 0.0125)
    rough = points + np.outer(wave, [0, 0, 1])
    compliance = []
    for name, places in (("even", points), ("rough", rough)):
        both = np.repeat(np.arange(81), 2)
        scan = Scan(
            press=both, time_s=np.arange(162), phase=["load", "hold"] * 81, point_m=places[both],
            direction=inward[both], force_n=np.tile([0.1, 0.2], 81),
            displacement_m=np.tile([5e-4, 1e-3], 81), probe_radius_m=np.full(162, TIP),
            tip_pose=None,
        )  # fmt: skip
        (tmp_path / name).mkdir()
        said = json.loads(new(tmp_path / name, scan, "--thickness", str(THICK)))
        study = load_study(said["study"])
        placed, some = place_scan(read_scan(study.scan), study).scan, slice(None, None, 4)
        contacts = Contacts(
            placed.contact_points[some], placed.contact_directions[some], np.full(21, 0.002)
        )
        edges = contact_body(study.body).size_m
        mesh = _between(
            study.body, [np.linspace(0, e, n + 1) for e, n in zip(edges, (8, 8, 3), strict=True)]
        )
        compliance.append(PalpationModel(mesh, NU, contacts).evaluate(MODULUS).compliance)
    ratio = compliance[1] / compliance[0]
    assert ratio == pytest.approx(np.ones(21), abs=0.03)


def test_a_run_folder_keeps_the_contacts_that_make_the_body(tmp_path):
    study = load_study(json.loads(new(tmp_path, dome_scan(), "--thickness", str(THICK)))["study"])
    scan = read_scan(study.scan)
    run = tmp_path / "run"
    run.mkdir()
    keep_inputs(study, scan.rows(scan.press != 3), run)
    kept = load_study(run / "study.toml")
    assert (len(read_scan(kept.scan).press_ids), kept.body.file) == (15, run / "contacts.csv")
    assert len(contact_body(kept.body).through.points_m) == 16


def test_proposed_presses_are_where_the_scan_was_made_and_go_along_its_normals(tmp_path):
    scan = dome_scan()
    study = load_study(json.loads(new(tmp_path, scan, "--thickness", str(THICK)))["study"])
    placed = place_scan(scan, study).scan
    assert np.abs(placed.contact_points - scan.contact_points).max() > 1e-5  # on a smoothed surface
    presses = presses_of(Readings.of(placed)).taken(np.array([11, 0, 5]))
    write_presses(presses, Sites.of(scan, study), tmp_path / "next.csv")
    program = read_program(tmp_path / "next.csv")
    points = np.column_stack([program.x_m, program.y_m, program.z_m])
    np.testing.assert_allclose(points, scan.contact_points[[11, 0, 5]], atol=1e-8)
    np.testing.assert_allclose(program.direction, scan.contact_directions[[11, 0, 5]], atol=1e-8)


def test_bodies_that_cannot_be_are_refused_in_a_sentence(tmp_path):
    scan = dome_scan()
    thin = new(tmp_path, scan, "--thickness", "0.002", code=2)
    assert re.search("lowest contact .* mm below the base; expected at least 0.0", thin)
    aside = scan.replace(direction=np.tile([1.0, 0, 0], (len(scan), 1)))
    assert "degrees off straight down" in new(tmp_path, aside, "--thickness", "0.02", code=2)
    point_m = scan.point_m.copy()
    point_m[scan.press == 3] = scan.contact_points[4] + [3e-4, 0, 0.006]
    folded = new(tmp_path, scan.replace(point_m=point_m), "--thickness", "0.02", code=2)
    assert re.search("presses (3 and 4|4 and 3): .* one above the other", folded)
    few = scan.rows(scan.press < 8)
    assert "needs at least 10 different places, found 8" in new(
        tmp_path, few, "--thickness", "0.02", code=2
    )
    for table, said in (
        ('shape = "from-contacts"', "thickness_m in m and no size_m"),
        ('shape = "block"\nsize_m = [1, 1, 1]\nthickness_m = 0.1', "only with shape"),
        (
            'shape = "from-contacts"\nthickness_m = 0.1\nmargin_assumed = true',
            "margin_m, as margin_assumed is true",
        ),
    ):
        file = tmp_path / "study.toml"
        file.write_text(
            f'[study]\nname = "a"\nscan = "scan.csv"\n[body]\n{table}\npoisson_ratio = 0.4\n'
            '[probe]\ntip = "flat"\nradius_m = 0.004\n'
        )
        with pytest.raises(InputError, match=said):
            load_study(file)
