"""The demo's recording, read back without a viewer: the numbers are those of the run's files."""

import json

import numpy as np
import pytest
from numpy.testing import assert_allclose
from rerun.chunk import RrdReader

from models.scan_file import read_scan
from palpmap.recording.reader import read_summary, scalar_series

PLOTS = {
    "background_pa": ("fit/modulus_kpa/background", 1e-3),
    "inclusion_1.weight_pa": ("fit/modulus_kpa/inclusion_1.weight", 1e-3),
    "inclusion_1.x_m": ("fit/length_mm/inclusion_1.x", 1e3),
    "inclusion_1.y_m": ("fit/length_mm/inclusion_1.y", 1e3),
    "inclusion_1.z_m": ("fit/length_mm/inclusion_1.z", 1e3),
    "inclusion_1.radius_m": ("fit/length_mm/inclusion_1.radius", 1e3),
}
FLOAT32 = 1e-6


@pytest.fixture(scope="module")
def summary(demo):
    return read_summary(demo.folder / "recording.rrd")


@pytest.fixture(scope="module")
def chunks(demo):
    return list(RrdReader(demo.folder / "recording.rrd").stream())


@pytest.fixture(scope="module")
def fit(demo):
    return json.loads((demo.folder / "fit.json").read_text())


def test_the_recording_is_whole_and_small(summary, demo):
    assert summary.whole
    assert summary.closed
    assert summary.layout
    assert summary.missing == ()
    assert (summary.presses, summary.planned_presses, summary.last_press) == (81, 81, 80)
    assert summary.seed == 2
    assert summary.bytes == (demo.folder / "recording.rrd").stat().st_size
    assert summary.bytes <= 25e6


def test_review_says_the_same_of_it(demo, run_review):
    code, said = run_review(demo.folder)
    assert code == 0
    assert said["whole"]
    assert said["presses"] == 81


def test_its_timelines_span_the_scan_and_the_fit(summary, demo, fit):
    start, end = summary.spans["sim_time"]
    assert start == 0
    # The iterations follow the last press, one second apart.
    assert end >= demo.record["scan"]["simulated_s"]
    assert summary.spans["press"] == (0, 80)
    assert summary.spans["iteration"][1] == fit["history"][-1]["iteration"]


@pytest.mark.parametrize("name", PLOTS)
def test_each_parameter_ends_at_its_found_value_beside_the_true_one(summary, fit, demo, name):
    entity, factor = PLOTS[name]
    found = factor * fit["parameters"][name]["value"]
    assert summary.last_values[entity] == pytest.approx(found, rel=FLOAT32)
    body = json.loads((demo.folder / "truth.json").read_text())["body"]
    true = body | body["inclusions"][0]
    assert summary.last_values[f"{entity}.true"] == pytest.approx(
        factor * true[name.split(".")[-1]], rel=FLOAT32
    )


def test_the_misfit_falls_along_the_iterations_to_that_of_the_fit(chunks, fit):
    series = scalar_series(chunks, "fit/chi2_per_dof", "iteration")
    steps = [step["iteration"] for step in fit["history"]]
    assert_allclose(series[:, 0], steps)
    assert_allclose(series[:, 1], [step["chi2_per_dof"] for step in fit["history"]], rtol=FLOAT32)
    assert series[0, 1] > 3 * series[-1, 1]
    assert series[-1, 1] == pytest.approx(fit["chi2_per_dof"], rel=1e-3)


def test_measured_displacements_are_those_of_the_scan(chunks, demo):
    scan = read_scan(demo.folder / "scan.csv")
    held = [np.flatnonzero((scan.press == p) & (scan.phase == "hold")) for p in scan.press_ids]
    series = scalar_series(chunks, "presses/measured_mm", "press")
    assert_allclose(series[:, 0], scan.press_ids)
    mean_mm = []
    for press in scan.press_ids:
        rows = np.isin(scan.phase, ("load", "hold", "unload")) & (scan.press == press)
        near = rows & (scan.force_n >= 0.9 * scan.force_n[rows].max())
        mean_mm.append(1e3 * scan.displacement_m[near].mean())
    assert_allclose(series[:, 1], mean_mm, rtol=FLOAT32)
    on_time = scalar_series(chunks, "presses/measured_mm", "sim_time")
    assert_allclose(on_time[:, 0], scan.time_s[[rows[-1] for rows in held]], atol=1e-6)


def test_modelled_displacements_and_residuals_are_those_of_the_fit(chunks, fit):
    modelled = scalar_series(chunks, "presses/modelled_mm", "press")
    residual = scalar_series(chunks, "presses/residual_um", "press")
    assert len(modelled) == len(residual) == 81
    measured = scalar_series(chunks, "presses/measured_mm", "press")
    assert_allclose(measured[:, 1] - modelled[:, 1], 1e-3 * residual[:, 1], atol=2e-6)
    press, force = np.array(fit["press_index"]), np.array(fit["force_n"])
    predicted, left = np.array(fit["predicted_m"]), np.array(fit["residual_m"])
    for j in range(81):
        near = (press == j) & (force >= 0.9 * force[press == j].max())
        assert modelled[j, 1] == pytest.approx(1e3 * predicted[near].mean(), rel=FLOAT32)
        assert residual[j, 1] == pytest.approx(1e6 * left[near].mean(), rel=1e-5, abs=1e-3)


def test_each_press_is_held_at_the_set_force(chunks, demo):
    set_force = demo.record["scan"]["force_n"]
    scan = read_scan(demo.folder / "scan.csv")
    series = scalar_series(chunks, "scan/force_n", "sim_time")
    for press in scan.press_ids:
        times = scan.time_s[(scan.press == press) & (scan.phase == "hold")]
        held = series[(series[:, 0] >= times[0]) & (series[:, 0] <= times[-1]), 1]
        assert len(held) > 30
        assert held.mean() == pytest.approx(set_force, rel=0.02)
    # No frame is far above it: overshoot of at most 5 %, and the sensor's noise of 5 mN.
    assert series[:, 1].max() < 1.05 * set_force + 5 * 5e-3
    assert np.diff(series[:, 0]).min() > 0
    assert np.diff(series[:, 0]).max() < 0.1  # 25 frames a second, without a gap


def test_on_the_press_timeline_each_press_stands_at_its_full_force(chunks, demo):
    series = scalar_series(chunks, "scan/force_n", "press")
    assert_allclose(series[:, 0], np.arange(81))
    set_force = demo.record["scan"]["force_n"]
    assert np.all(series[:, 1] > 0.9 * set_force)  # a frame with a shape, the noise on top
    assert np.all(series[:, 1] < 1.05 * set_force + 5 * 5e-3)


def test_the_drawn_surface_dips_by_the_measured_displacement(chunks, demo):
    lowest = {}
    for chunk in chunks:
        if chunk.entity_path == "/world/body/surface" and "press" in chunk.timeline_names:
            batch = chunk.to_record_batch()
            if "Mesh3D:vertex_positions" not in batch.schema.names:
                continue
            presses = batch.column("press").to_pylist()
            for press, shape in zip(
                presses, batch.column("Mesh3D:vertex_positions").to_pylist(), strict=True
            ):
                if shape is not None:
                    lowest[press] = shape
    scan = read_scan(demo.folder / "scan.csv")
    assert set(lowest) == set(range(81))
    for press in (0, 40, 80):
        shape = np.array(lowest[press])
        x, y, _ = scan.contact_points[press]
        near = np.hypot(shape[:, 0] - x, shape[:, 1] - y) < 0.005
        dip = 0.048 - shape[near, 2].min()
        deepest = scan.displacement_m[scan.press == press].max()
        # The drawn field is the mesh's own, which rounds the dimple off; and where the modulus
        # changes under the tip, its given pressure moves some points more than their mean, the
        # travel.
        assert 0.4 * deepest < dip < 1.25 * deepest
