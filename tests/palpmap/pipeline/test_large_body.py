"""A body much larger than its pressed part: cells are fine where the scan sees."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
import pyvista
from matplotlib.contour import ContourSet

import palpmap as pm
from fem import Contacts, PalpationModel, RefinedModel
from fem.mesh import focused_planes, mesh_between, probed_box
from identify.map.gaussian_map import GaussianMap, Inclusion
from models.scan import Scan
from models.scan_file import write_scan
from palpmap.commands.check import check_study
from palpmap.study.cell_size import block_planes, finer_planes
from sim.body.soft_body import DIVISIONS, true_meshes

SIZE, NU, TIP = (0.2, 0.2, 0.1), 0.48, 0.005
TRUTH = GaussianMap(5000.0, (Inclusion(12000.0, 0.0876, 0.0921, 0.08, 0.0083),))
STUDY = """\
[study]
name = "large"
scan = "scan.csv"
[body]
shape = "block"
size_m = [0.2, 0.2, 0.1]
poisson_ratio = 0.48
[probe]
tip = "flat"
radius_m = 0.005
[noise]
displacement_m = 1e-5
force_n = 0.003
[map]
inclusions = 1
"""
AS_SURFACE = STUDY.replace("size_m = [0.2, 0.2, 0.1]", 'file = "block.stl"').replace(
    'shape = "block"', 'shape = "surface"'
)


def presses() -> np.ndarray:
    line = 0.1 + 0.01 * np.arange(-4, 5)
    return np.stack(np.meshgrid(line, line, [SIZE[2]], indexing="ij"), axis=-1).reshape(-1, 3)


def write(folder: Path, compliance: np.ndarray) -> Path:
    points = presses()
    steps, rng = 10, np.random.default_rng(3)
    force = np.tile(np.linspace(0.03, 0.3, steps), len(points))
    travel = force * np.repeat(compliance, steps)
    scan = Scan(
        press=np.repeat(np.arange(len(points)), steps), time_s=0.2 * np.arange(len(force)),
        phase=["load"] * len(force), point_m=np.repeat(points, steps, axis=0),
        direction=np.tile([0.0, 0, -1], (len(force), 1)),
        force_n=force + rng.normal(0, 3e-3, len(force)),
        displacement_m=travel + rng.normal(0, 1e-5, len(force)),
        probe_radius_m=np.full(len(force), TIP), tip_pose=None,
    )  # fmt: skip
    write_scan(scan, folder / "scan.csv")
    (folder / "study.toml").write_text(STUDY)
    return folder / "study.toml"


@cache
def true_compliance() -> np.ndarray:
    middle = (0.045, 0.155)
    sides = [focused_planes(edge, 0.0062, *middle) for edge in SIZE[:2]]
    planes = [*sides, focused_planes(SIZE[2], 0.0062, 0.052, SIZE[2])]
    contacts = Contacts(presses(), np.tile([0.0, 0, -1], (81, 1)), TIP)
    truth = PalpationModel(mesh_between(planes, "alternating"), NU, contacts)
    return truth.evaluate(TRUTH.modulus(truth.points_m)).compliance


def write_surface(folder: Path, compliance: np.ndarray) -> Path:
    study = write(folder, compliance)
    box = pyvista.Box((0, SIZE[0], 0, SIZE[1], 0, SIZE[2]))
    box.triangulate().save(folder / "block.stl")
    study.write_text(AS_SURFACE)
    return study


@pytest.mark.parametrize("kind", ["inclusions = 1", 'kind = "free"'])
def test_cells_are_as_fine_under_the_presses_as_in_a_small_body(tmp_path, kind):
    study = write(tmp_path, np.full(81, 0.015))
    study.write_text(STUDY.replace("inclusions = 1", kind))
    mesh = pm.read_study(study).opened(thin=False).body.coarse.mesh
    centres = mesh.nodes[mesh.cells[:, :4]].mean(axis=1)
    near = (np.abs(centres[:, :2] - 0.1).max(axis=1) < 0.05) & (centres[:, 2] > 0.06)
    cell_m = float(np.cbrt(6 * mesh.cell_volumes[near].mean()))
    assert 0.007 < cell_m < 0.0135
    assert len(mesh.cells) < 6 * 2500
    checked = check_study(study)
    assert checked.cell_size_m == pytest.approx(cell_m, rel=0.1)
    assert "a part of 104 x 104 x 48 mm under them" in " ".join(checked.notes)


@pytest.mark.slow
def test_a_closed_surface_is_meshed_finely_where_presses_show_it(tmp_path):
    study = write_surface(tmp_path, np.full(81, 0.015))
    body = pm.read_study(study).opened(thin=False).body
    assert body.coarse.mesh.focused
    assert body.fine.mesh.focused
    assert body.coarse.probed_m == pytest.approx(
        np.array([[0.048, 0.048, 0.052], [0.152, 0.152, 0.1]])
    )
    centres = body.coarse.mesh.centres_m
    near = (np.abs(centres[:, :2] - 0.1).max(axis=1) < 0.05) & (centres[:, 2] > 0.055)
    assert np.cbrt(7.5 * body.coarse.mesh.cell_volumes[near].mean()) == pytest.approx(
        check_study(study).cell_size_m, rel=0.15
    )


@pytest.mark.slow
@pytest.mark.parametrize("as_written", [write, write_surface])
def test_a_small_spot_in_a_large_body_is_found_within_its_intervals(tmp_path, as_written):
    # Evenly spread, as many cells made it a third as hard as it is, beside a residual of noise
    fit = pm.fit(pm.read_study(as_written(tmp_path, true_compliance())))
    assert fit.success
    held = [
        name
        for name, value in zip(TRUTH.names, TRUTH.values, strict=True)
        if fit.parameters[name].lower95 <= value <= fit.parameters[name].upper95
    ]
    assert held == list(TRUTH.names)
    drawn = [c for axes in fit.plot_map().axes for c in axes.collections]
    assert any(any(c.hatches) for c in drawn if isinstance(c, ContourSet))  # what no press shows


@pytest.mark.slow
def test_the_laboratorys_truth_of_a_large_body_is_no_stiffer_than_the_model():
    # Its two meshes grew otherwise outside the probed part: then 0.7 to 1.3 % stiffer
    size, tip = (0.136, 0.111, 0.059), 0.003
    x, y = np.meshgrid(0.096 + 0.006 * np.arange(6), 0.064 + 0.006 * np.arange(6))
    points = np.column_stack([x.ravel(), y.ravel(), np.full(36, size[2])])
    probed = probed_box(points, np.array([np.zeros(3), size]), tip)
    coarse = block_planes(size, float(np.cbrt(np.prod(probed[1] - probed[0]) / 256)), probed)
    contacts = Contacts(points[[0, 14, 33]], np.tile([0.0, 0, -1], (3, 1)), tip)
    model, truth = (
        RefinedModel(*(PalpationModel(mesh, 0.49, contacts) for mesh in meshes)).evaluate(5e3)
        for meshes in (
            [mesh_between(coarse), mesh_between(finer_planes(coarse))],
            true_meshes(size, DIVISIONS, points, tip),
        )
    )
    np.testing.assert_allclose(truth.compliance, model.compliance, rtol=3e-3)


@pytest.mark.slow
def test_a_free_map_of_a_large_body_has_its_spot_in_place_and_no_false_size(tmp_path):
    study = write(tmp_path, true_compliance())
    study.write_text(STUDY.replace("inclusions = 1", 'kind = "free"'))
    field = pm.fit(pm.read_study(study)).field
    (spot,) = [spot for spot in field.spots if spot.probability > 0.9]
    (true,) = TRUTH.inclusions
    assert np.hypot(spot.x_m - true.x_m, spot.y_m - true.y_m) < 0.002
    assert spot.wide  # its depth, size and contrast are open from above
    assert field.sight_m < 0.03
