"""The exported map is the fitted one, and MuJoCo's body answers the presses as the fit does."""

import json
import xml.etree.ElementTree as ET
from dataclasses import replace

import mujoco
import numpy as np
import pytest
import pyvista
from typer.testing import CliRunner

import palpmap as pm
from identify.fit import Estimate
from identify.map.gaussian_map import GAUSSIAN
from palpmap.__main__ import app
from palpmap.export import export_run, load_mujoco
from palpmap.export.body import ExportedBody
from tests.paths import LAB, TWELVE

AGREES = 0.05


@pytest.fixture(scope="module")
def run():
    return pm.read_run(TWELVE)


def test_paraview_shows_the_map_at_its_places(run, tmp_path):
    grid = pyvista.read(export_run(run, "vti", tmp_path / "map.vti")[0])
    mesh = pyvista.read(export_run(run, "vtu", tmp_path / "map.vtu")[0])
    table = np.loadtxt(export_run(run, "csv", tmp_path / "map.csv")[0], delimiter=",", skiprows=1)
    origin = run.experiment.opened(thin=False).origin_m
    name = "young_modulus_pa"
    for points, values in (
        (grid.points, grid.point_data[name]),
        (mesh.points, mesh.point_data[name]),
        (mesh.cell_centers().points, mesh.cell_data[name]),
        (table[:, :3], table[:, 3]),
    ):
        np.testing.assert_allclose(values, run.fit.map.modulus(points - origin), rtol=1e-4)
    size = run.experiment.study.body.size_m
    np.testing.assert_allclose(np.ptp(grid.points, axis=0), size, rtol=1e-6)
    assert mesh.volume == pytest.approx(np.prod(size), rel=1e-6)


def test_the_map_of_an_export_is_that_of_the_report(run, tmp_path):
    edge = Estimate(0.8, 0.1, "1", 0.6, 1.0, free=True)
    drift = Estimate(0.01, 0.001, "N", 0.0, 0.02, free=True)
    named = {"inclusion_edge.edge": edge, "force_bias.bias_n": drift}
    fit = replace(run.fit, estimates={**run.fit.parameters, **named})
    path, said = export_run(replace(run, fit=fit), "febio", tmp_path / "body.feb")
    assert said == ["Map and body are exported, and of the model not: force_bias."]
    found = np.array([e.text for e in ET.parse(path).find("MeshData/ElementData")], float)
    body = ExportedBody.of(run)
    middle = body.mesh.nodes[body.mesh.cells[:, :4]].mean(axis=1)
    shape = replace(GAUSSIAN, edge=0.8)
    np.testing.assert_allclose(found, run.fit.map.modulus(middle, shape), rtol=1e-6)
    assert np.abs(found / run.fit.map.modulus(middle) - 1).max() > 0.1


def test_an_export_leaves_the_volume_of_a_free_map_alone(run, tmp_path):
    there = replace(run, folder=tmp_path)
    assert export_run(there, "vti")[0] == tmp_path / "map_grid.vti"
    assert export_run(there, "csv")[0] == tmp_path / "map.csv"


def test_febio_gets_an_element_with_its_modulus_for_each_cell(run, tmp_path):
    root = ET.parse(export_run(run, "febio", tmp_path / "body.feb")[0]).getroot()
    assert root.attrib["version"] == "4.0"
    nodes = np.array([node.text.split(",") for node in root.iter("node")], float)
    cells = np.array([elem.text.split(",") for elem in root.iter("elem")], int) - 1
    moduli = np.array([entry.text for entry in root.find("MeshData/ElementData")], float)
    origin = run.experiment.opened(thin=False).origin_m
    middle = nodes[cells[:, :4]].mean(axis=1) - origin
    np.testing.assert_allclose(moduli, run.fit.map.modulus(middle), rtol=1e-6)
    # FEBio's tet10: corners with positive volume, then the middles of edges 12, 23, 31, 14, 24, 34
    corner = nodes[cells[:, :4]]
    assert np.linalg.det(corner[:, 1:] - corner[:, :1]).min() > 0
    edges = ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))
    halves = np.stack([corner[:, pair].mean(axis=1) for pair in edges], axis=1)
    np.testing.assert_allclose(nodes[cells[:, 4:]], halves, atol=1e-9)
    assert [part.tag for part in root if part.tag in ("Mesh", "MeshDomains", "MeshData")] == [
        "Mesh", "MeshDomains", "MeshData",  # FEBio refuses another order
    ]  # fmt: skip
    assert [entry.attrib["lid"] for entry in root.find("MeshData/ElementData")] == [
        str(k + 1) for k in range(len(cells))
    ]
    held = np.array(root.find("Mesh/NodeSet").text.split(","), int) - 1
    low = nodes[:, 2].min()
    assert set(held) == set(np.flatnonzero(nodes[:, 2] < low + 1e-9))
    assert root.find("Material/material/E").attrib["type"] == "map"


def mujoco_compliance(path, press):
    """Travel of a press of 0.1 mm by its force, m/N, once the simulated body is at rest."""
    model = load_mujoco(path)
    data = mujoco.MjData(model)
    with np.load(path.with_suffix(".npz")) as stored:
        weights, expected = stored["weights"][press], stored["compliance_m_per_n"][press]
    force = 1e-4 / expected
    body = model.flex_vertbodyid
    free = model.body_dofnum[body] == 3
    dofs = model.body_dofadr[body][free][:, None] + np.arange(3)
    data.qfrc_applied[dofs] = force * weights[free]
    travel = 0.0
    for _ in range(400):
        mujoco.mj_step(model, data, 10)
        before, travel = travel, float(np.sum(weights[free] * data.qpos[dofs]))
        if abs(travel - before) < 2e-4 * abs(travel):
            break
    return travel / force, expected


def test_mujoco_repeats_a_press(run, tmp_path):
    path, said = export_run(run, "mujoco", tmp_path / "body.xml")
    assert "body.npz beside it" in said[-2]
    assert "MuJoCo" in said[-1]
    found, expected = mujoco_compliance(path, 4)
    assert found == pytest.approx(expected, rel=AGREES)
    (tmp_path / "body.npz").unlink()
    with pytest.raises(pm.InputError, match="no such file"):
        load_mujoco(path)


@pytest.mark.slow
def test_mujoco_repeats_presses_from_corner_to_corner_of_a_laboratory_scan(tmp_path):
    fit = pm.fit(pm.read_study(LAB / "case_c" / "study.toml"), inclusions=1)
    fit.write(tmp_path / "run")
    path, _ = export_run(pm.read_run(tmp_path / "run"), "mujoco", tmp_path / "body.xml")
    off = [found / expected - 1 for found, expected in
           (mujoco_compliance(path, press) for press in range(0, 81, 10))]  # fmt: skip
    assert np.abs(off).max() < AGREES


def test_the_command_writes_beside_the_run_and_refuses_a_wrong_ending(run, tmp_path):
    result = CliRunner().invoke(
        app, ["export", str(TWELVE), "--to", "csv", "--out", str(tmp_path / "a.csv"), "--json"]
    )
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["file"].endswith("a.csv")
    result = CliRunner().invoke(app, ["export", str(TWELVE), "--to", "vti", "--out", "a.csv"])
    assert result.exit_code == 2
    assert "ends in .vti" in result.stderr
