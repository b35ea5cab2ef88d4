"""A recording holds the numbers that were given to it."""

from types import SimpleNamespace

import numpy as np
import pytest
import rerun as rr
from numpy.testing import assert_allclose, assert_array_equal
from rerun.chunk import RrdReader

import palpmap as pm
from fem.errors import MeshError
from palpmap.commands import growing_map
from palpmap.commands.growing_map import GrowingMap
from palpmap.recording.frames import Frame
from palpmap.recording.layout import plot_view
from palpmap.recording.maps import (
    _GROUND,
    MapViews,
    log_map,
    map_views,
    modulus_colors,
    residual_colors,
)
from palpmap.recording.reader import read_summary, scalar_series
from palpmap.recording.recorder import Recording
from palpmap.recording.scene import LinkShape, drawn_shape, vertex_normals
from tests.paths import TESTS

FLOAT32 = 1.2e-7  # relative rounding of single precision
LINKS = (
    LinkShape("upper", "capsule", (0.05, 0.1, 0.0), (0.0, 0.0, 0.1)),
    LinkShape("upper", "sphere", (0.06, 0.0, 0.0), (0.0, 0.0, 0.2)),
    LinkShape("probe", "cylinder", (0.005, 0.05, 0.0), (0.0, 0.0, 0.0)),
)
VERTICES = np.array(
    [[0, 0, 0], [0.09, 0, 0], [0, 0.06, 0], [0.01, 0.02, 0.04]]
)  # a tetrahedron, nowhere symmetric
TRIANGLES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
TRUE = {
    "background_pa": 6000.0,
    "inclusion_1.weight_pa": 20000.0,
    "inclusion_1.x_m": 0.03,
    "inclusion_1.y_m": 0.01,
    "inclusion_1.z_m": 0.032,
    "inclusion_1.radius_m": 0.008,
}


def modulus(points):
    center = [TRUE[f"inclusion_1.{axis}_m"] for axis in "xyz"]
    squared = ((points - center) ** 2).sum(axis=1) / TRUE["inclusion_1.radius_m"] ** 2
    return TRUE["background_pa"] + TRUE["inclusion_1.weight_pa"] * np.exp(-squared / 2)


def true_views():
    return map_views(modulus, VERTICES.min(axis=0), VERTICES.max(axis=0), cells=30)


def press_frames(rng, press, peak_n=0.3):
    """Frames of one press: force and travel rise, stay and fall, the poses are random."""
    force = peak_n * np.clip(np.minimum(np.arange(30) - 5, 25 - np.arange(30)) / 5, 0, 1)
    for k, value in enumerate(force):
        poses = rng.normal(size=(2, 7))
        poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
        yield Frame(
            time_s=1.2 * press + 0.04 * k,
            link_poses=poses,
            force_n=float(value),
            displacement_m=0.004 * float(value),
            contact_point_m=np.array([0.01, 0.02, 0.04]),
            force_vector_n=np.array([0.0, 0.0, -value]),
            surface=lambda v=value: np.outer([0, 0.1, 0.2, 1], [0, 0, -0.004 * v]),
        )


def record_scan(recording, presses=3):
    """Truth, scene and presses; returns the frames."""
    rng = np.random.default_rng(5)
    recording.truth(true_views(), TRUE)
    recording.scene(
        VERTICES,
        TRIANGLES,
        links=LINKS,
        body_modulus_pa=modulus(VERTICES),
        body_position_m=(0.4, -0.1, 0.2),
    )
    frames = []
    for press in range(presses):
        frames += (batch := list(press_frames(rng, press)))
        for frame in batch:
            recording.frame(frame)
        point = (0.01 * press, 0.02, 0.04)
        recording.press_done(press, 1.2 * press + 0.6, point, 0.3, 1e-3 * (press + 1.25))
    return frames


def record_fit(recording, presses=3, steps=4):
    for k in range(steps):
        parameters = {name: value * (1 + 0.5**k) for name, value in TRUE.items()}
        recording.iteration(
            SimpleNamespace(
                iteration=k, parameters=parameters, chi2_per_dof=10.0**-k, rms_m=3e-5 * 2.0**-k
            ),
            true_views(),
        )
    ids = np.arange(presses)
    recording.comparison(ids, 1e-3 * (ids + 1.2), 1e-6 * np.array([5.0, -40.0, 20.0])[:presses])


@pytest.fixture(scope="module")
def whole_run(tmp_path_factory):
    path = tmp_path_factory.mktemp("run") / "recording.rrd"
    with Recording(path, "twelve presses", seed=11, planned_presses=3) as recording:
        frames = record_scan(recording)
        record_fit(recording)
        recording.event("done")
    return path, frames


def chunks_of(path):
    return list(RrdReader(path).stream())


def rows(path, entity, component, timeline=None):
    """Values of a component, in the order of a timeline, or static ones."""
    found = []
    for chunk in chunks_of(path):
        batch = chunk.to_record_batch()
        on_timeline = chunk.is_static if timeline is None else timeline in chunk.timeline_names
        if chunk.entity_path == f"/{entity}" and on_timeline and component in batch.schema.names:
            values = batch.column(component).to_pylist()
            times = [0] * len(values)
            if timeline is not None:
                times = batch.column(timeline).cast("int64").to_pylist()
            found += [(t, v) for t, v in zip(times, values, strict=True) if v is not None]
    return [value for _, value in sorted(found, key=lambda row: row[0])]


def test_force_and_travel_of_every_frame_are_recorded_against_the_simulation_time(whole_run):
    path, frames = whole_run
    force = scalar_series(chunks_of(path), "scan/force_n", "sim_time")
    travel = scalar_series(chunks_of(path), "scan/displacement_mm", "sim_time")
    assert_allclose(force[:, 0], [f.time_s for f in frames], atol=1e-9)  # times are whole ns
    assert_allclose(force[:, 1], [f.force_n for f in frames], rtol=FLOAT32)
    assert_allclose(travel[:, 1], [1e3 * f.displacement_m for f in frames], rtol=FLOAT32)


def test_link_poses_are_recorded_with_the_quaternion_turned_to_xyzw(whole_run):
    path, frames = whole_run
    for i, link in enumerate(("upper", "probe")):
        positions = rows(path, f"world/robot/{link}", "Transform3D:translation", "sim_time")
        turns = rows(path, f"world/robot/{link}", "Transform3D:quaternion", "sim_time")
        expected = np.array([f.link_poses[i] for f in frames])
        assert_allclose(np.squeeze(positions), expected[:, :3], rtol=FLOAT32)
        assert_allclose(np.squeeze(turns), expected[:, [4, 5, 6, 3]], rtol=FLOAT32)


def test_each_press_shows_its_largest_force_and_the_dent_that_goes_with_it(whole_run):
    path, _ = whole_run
    force = scalar_series(chunks_of(path), "scan/force_n", "press")
    assert_allclose(force, [[0, 0.3], [1, 0.3], [2, 0.3]], rtol=FLOAT32)
    shapes = np.squeeze(rows(path, "world/body/surface", "Mesh3D:vertex_positions", "press"))
    dented = VERTICES + np.outer([0, 0.1, 0.2, 1], [0, 0, -0.0012])
    assert_allclose(shapes[-1], dented, rtol=2 * FLOAT32, atol=1e-9)


def test_the_surface_is_at_rest_again_when_the_tip_has_left(whole_run):
    path, _ = whole_run
    shapes = rows(path, "world/body/surface", "Mesh3D:vertex_positions", "sim_time")
    assert_allclose(shapes[-1], VERTICES, rtol=FLOAT32, atol=1e-9)
    deepest = min(shape[3][2] for shape in shapes)
    assert_allclose(deepest, 0.04 - 0.0012, rtol=2 * FLOAT32)


def test_the_force_arrow_points_at_the_force_and_ends_with_it(whole_run):
    path, _ = whole_run
    vectors = rows(path, "world/body/force", "Arrows3D:vectors", "sim_time")
    assert vectors[-1] == []
    longest = min((v for v in vectors if v), key=lambda v: v[0][2])
    assert_allclose(longest, [[0, 0, -0.05 * 0.3]], rtol=FLOAT32, atol=1e-9)
    tails = rows(path, "world/body/force", "Arrows3D:origins", "press")
    heads = np.squeeze(tails) + np.squeeze(longest)
    aside = heads - [0.01, 0.02, 0.04]
    assert_allclose(aside[:, 2], 0, atol=1e-8)  # level with the contact point, beside the tip
    assert (np.linalg.norm(aside, axis=1) < 0.02).all()


def test_the_way_home_after_the_last_press_is_recorded_too(tmp_path):
    path = tmp_path / "recording.rrd"
    with Recording(path, "home") as recording:
        frames = record_scan(recording, presses=1)
        for frame in press_frames(np.random.default_rng(2), press=1, peak_n=0.0):
            recording.frame(frame)
    force = scalar_series(chunks_of(path), "scan/force_n", "sim_time")
    assert len(force) == len(frames) + 30
    assert read_summary(path).presses == 1


def test_measured_modelled_and_residual_stand_at_their_press(whole_run):
    path, _ = whole_run
    for entity, expected in (
        ("presses/measured_mm", [1.25, 2.25, 3.25]),
        ("presses/modelled_mm", [1.2, 2.2, 3.2]),
        ("presses/residual_um", [5.0, -40.0, 20.0]),
    ):
        table = scalar_series(chunks_of(path), entity, "press")
        assert_allclose(table, np.column_stack([[0, 1, 2], expected]), rtol=FLOAT32)
        clock = scalar_series(chunks_of(path), entity, "sim_time")
        assert_allclose(clock[:, 0], [0.6, 1.8, 3.0], atol=1e-9)


def test_parameters_and_misfit_are_recorded_for_every_iteration_beside_the_truth(whole_run):
    path, _ = whole_run
    chunks = chunks_of(path)
    share = 1 + 0.5 ** np.arange(4)
    weight = scalar_series(chunks, "fit/modulus_kpa/inclusion_1.weight", "iteration")
    assert_allclose(weight, np.column_stack([np.arange(4), 20 * share]), rtol=FLOAT32)
    depth = scalar_series(chunks, "fit/length_mm/inclusion_1.z", "iteration")
    assert_allclose(depth[:, 1], 32 * share, rtol=FLOAT32)
    true = scalar_series(chunks, "fit/length_mm/inclusion_1.z.true", "iteration")
    assert_allclose(true[:, 1], 32.0, rtol=FLOAT32)
    rms = scalar_series(chunks, "fit/rms_um", "iteration")
    assert_allclose(rms[:, 1], 30 * 0.5 ** np.arange(4), rtol=FLOAT32)
    drawn = scalar_series(chunks, "fit/misfit/chi2_per_dof", "iteration")
    assert_allclose(drawn[:, 1], [0, -1, -2, -3], atol=1e-9)


def test_iterations_follow_the_scan_on_its_clock_one_second_apart(whole_run):
    path, frames = whole_run
    rms = scalar_series(chunks_of(path), "fit/rms_um", "sim_time")
    assert_allclose(rms[:, 0], frames[-1].time_s + np.arange(1, 5), atol=1e-8)


def test_maps_hold_the_modulus_with_the_far_side_in_the_first_row(whole_run):
    path, _ = whole_run
    views = true_views()
    for folder, timeline in (("maps/true", None), ("maps/found", "iteration")):
        for name, image in (("top", views.top_pa), ("side", views.side_pa)):
            buffer = rows(path, f"{folder}/{name}", "DepthImage:buffer", timeline)[-1][0]
            pixels = np.array(buffer, np.uint8).view(np.float32).reshape(image.shape)
            assert_allclose(pixels, image[::-1], rtol=FLOAT32)


def test_true_and_found_map_and_the_body_share_one_colour_scale(whole_run):
    path, _ = whole_run
    true_range = rows(path, "maps/true/top", "DepthImage:depth_range")[-1]
    found_range = rows(path, "maps/found/top", "DepthImage:depth_range", "iteration")[-1]
    assert true_range == found_range
    assert_allclose(true_range[0], true_views().range_pa)
    packed = rows(path, "world/body/surface", "Mesh3D:vertex_colors", "sim_time")[-1]
    colors = np.array([[c >> 24, c >> 16 & 255, c >> 8 & 255] for c in packed])
    assert_array_equal(colors, modulus_colors(modulus(VERTICES), true_views().range_pa))


def test_colours_of_moduli_that_lie_far_apart_are_logarithmic_and_nothing_has_the_ground():
    def colour(modulus_pa: float, span: tuple[float, float]) -> list[int]:
        return modulus_colors([modulus_pa], span)[0].tolist()

    middle = colour(5.5e3, (1e3, 1e4))
    assert colour(1e4, (1e3, 1e5)) == middle
    assert colour(50.5e3, (1e3, 1e5)) != middle
    image = np.array([[1e3, np.nan], [1e4, 1e5]])
    views = MapViews(image, image, np.zeros(3), np.ones(3), in_part=True)
    drawn: dict = {}
    log_map(lambda entity, *parts: drawn.update({entity: parts}), "map", views, views.range_pa)
    picture = drawn["map/top"][1]
    assert isinstance(picture, rr.Image)
    packed = picture.buffer.as_arrow_array()[0].as_py()
    pixels = np.array(packed).reshape(2, 2, 3)  # its first row is on top
    assert pixels[1, 1].tolist() == list(_GROUND)
    assert pixels[0, 0].tolist() == middle
    whole = MapViews(np.abs(image[1:]), image[1:], np.zeros(3), np.ones(3))
    log_map(lambda entity, *parts: drawn.update({entity: parts}), "map", whole, whole.range_pa)
    assert isinstance(drawn["map/top"][1], rr.DepthImage)


def test_both_pictures_of_a_map_see_an_inclusion_wherever_it_lies():
    views = true_views()
    column = np.abs(np.linspace(0, 0.09, 61)[1::2] - 0.03).argmin()
    for image in (views.top_pa, views.side_pa):
        assert image.max() > 25000
        assert image.max(axis=0).argmax() == column
    assert views.top_pa.max(axis=1).argmax() < 8  # y = 10 of 60 mm
    assert views.side_pa.max(axis=1).argmax() > 8  # z = 32 of 40 mm


def test_a_residual_is_red_where_the_body_gave_way_more_and_blue_where_less():
    red, blue = residual_colors([1.0, -1.0], 1.0).astype(int)
    assert red[0] > red[2] + 100
    assert blue[2] > blue[0] + 100


def test_a_capsule_is_drawn_from_the_centre_of_its_lower_cap():
    quarter_turn_about_x = (np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0)  # its z axis becomes -y
    capsule = drawn_shape(
        LinkShape("l", "capsule", (0.02, 0.1, 0), (0.3, 0.2, 0.1), quarter_turn_about_x)
    )
    start = capsule.translations.as_arrow_array().to_pylist()[0]
    assert_allclose(start, [0.3, 0.3, 0.1], rtol=FLOAT32)


def test_a_shape_that_cannot_be_drawn_is_refused_by_name():
    with pytest.raises(ValueError, match=r"'plane'.*capsule, cylinder"):
        LinkShape("link3", "plane", (0, 0, 0), (0, 0, 0))


def test_normals_of_an_outward_surface_point_outwards():
    normals = vertex_normals(VERTICES, TRIANGLES)
    outward = VERTICES - VERTICES.mean(axis=0)
    assert ((normals * outward).sum(axis=1) > 0).all()
    assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=4e-3)  # rounded to 1/256


def view_names(path):
    reader = RrdReader(path)
    column = "ViewBlueprint:display_name"
    names = set()
    for blueprint in reader.blueprints():
        for chunk in reader.stream(store=blueprint):
            batch = chunk.to_record_batch()
            if column in batch.schema.names:
                names |= {value[0] for value in batch.column(column).to_pylist() if value}
    return names


def test_the_legend_of_a_plot_stands_above_its_curves():
    curves = {"fit/a": (1.0, 3.0), "fit/a.true": (2.0, 2.0), "fit/b": (-1.0, 0.0), "scan/c": (9, 9)}
    for under, low, high, rows in (((), -1.0, 3.0, 3), (("b",), -1.0, 0.0, 1)):
        axis = plot_view("fit", "Fit", under, curves).properties["ScalarAxis"].range
        bottom, top = axis.as_arrow_array().to_pylist()[0]
        assert bottom < low
        share = (top - high) / (top - low)  # above the curves, for the rows of the legend
        assert 0.12 * rows < share < 0.2 * rows
    assert "ScalarAxis" not in plot_view("fit", "Fit", (), {"scan/c": (9, 9)}).properties


def test_the_layout_shows_scene_maps_presses_and_fit(whole_run):
    names = view_names(whole_run[0])
    assert {
        "The arm presses on the body",
        "Truth: Young's modulus",
        "Found: Young's modulus",
        "Each press: measured and modelled, mm",
        "Parameters: kPa",
        "Contact force, N",
        "Events",
        "About",
        "Residual: red +40, blue -40 µm",
    } <= names


def test_a_fit_of_a_scan_from_file_needs_neither_robot_nor_truth(tmp_path):
    path = tmp_path / "recording.rrd"
    wanted = ("body", "presses", "fit", "comparison", "events", "about")
    with Recording(path, "real", planned_presses=3, parts=wanted) as recording:
        recording.scene(VERTICES, TRIANGLES)
        recording.measured([4, 7, 9], VERTICES[1:], [1e-3, 2e-3, 3e-3])
        recording.iteration(
            SimpleNamespace(iteration=0, parameters=TRUE, chi2_per_dof=1.0, rms_m=1e-5),
            true_views(),
            modulus(VERTICES),
        )
        recording.comparison([4, 7, 9], [1e-3, 2e-3, 2.9e-3], [0.0, 0.0, 1e-4])
        recording.event("done")
    found = read_summary(path)
    assert found.whole
    assert (found.presses, found.last_press) == (3, 9)
    measured = scalar_series(chunks_of(path), "presses/measured_mm", "press")
    assert_allclose(measured, [[4, 1], [7, 2], [9, 3]])
    names = view_names(path)
    assert "Found: Young's modulus" in names
    assert not any("Truth" in name or "arm" in name or "force" in name for name in names)


def test_comparing_a_press_that_was_not_recorded_is_refused(tmp_path):
    with Recording(tmp_path / "r.rrd", "r") as recording:
        recording.scene(VERTICES, TRIANGLES)
        recording.measured([0], VERTICES[:1], [1e-3])
        with pytest.raises(ValueError, match=r"\[3\].*not recorded"):
            recording.comparison([0, 3], [1e-3, 1e-3], [0.0, 0.0])


def test_81_presses_on_a_fine_surface_stay_under_25_megabytes(tmp_path):
    rng = np.random.default_rng(1)
    side = 55
    x, y = (a.ravel() for a in np.meshgrid(*[np.linspace(0, 0.096, side)] * 2, indexing="ij"))
    vertices = np.column_stack([x, y, 0.048 + 0.004 * np.sin(40 * x)])
    i = np.arange(side * side).reshape(side, side)
    corner = [i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, 1:]]
    a, b, c, d = (k.ravel() for k in corner)
    triangles = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    links = [LinkShape(f"link{i}", "sphere", (0.05, 0, 0), (0, 0, 0)) for i in range(9)]
    path = tmp_path / "recording.rrd"
    presses = 6
    with Recording(path, "large", planned_presses=81) as recording:
        recording.scene(vertices, triangles, links=links)
        before = path.stat().st_size
        for press in range(presses):
            force = 0.3 * np.clip(np.minimum(np.arange(112) - 40, 90 - np.arange(112)) / 8, 0, 1)
            away = np.linalg.norm(vertices - vertices[500 * press + 3], axis=1)
            dent = 0.005 * np.arcsin(0.005 / np.maximum(away, 0.005))  # m/N, rigid disc
            for k, value in enumerate(force):
                recording.frame(
                    Frame(
                        time_s=press * 4.5 + 0.04 * k,
                        link_poses=rng.normal(size=(9, 7)),  # noise does not compress
                        force_n=float(value),
                        displacement_m=0.005 * float(value),
                        contact_point_m=vertices[500 * press + 3],
                        force_vector_n=np.array([0, 0, -value]),
                        surface=lambda u=dent * value: np.outer(u, [0.1, -0.2, -1.0]),
                    )
                )
            recording.press_done(press, press * 4.5 + 3, vertices[500 * press + 3], 0.3, 1.5e-3)
        a_press = (path.stat().st_size - before) / presses
    assert 81 * a_press < 24e6  # and 1 MB for all that comes once
    assert a_press > 112 * 9 * 28  # the frames are there at all


def test_no_scan_is_lost_for_an_estimate_of_its_map(tmp_path, monkeypatch):
    def refuse(*given, **more):
        raise MeshError("press 3 hangs over the edge")

    experiment = pm.read_study(TESTS / "data/twelve_presses/study.toml")
    monkeypatch.setattr(growing_map, "fit_map", refuse)
    with Recording(tmp_path / "grown.rrd", "a scan") as recording:
        GrowingMap(recording, experiment.study).follow(experiment.scan)
    told = [text[0] for text in rows(tmp_path / "grown.rrd", "events", "TextLog:text", "sim_time")]
    assert "no estimate of the map: press 3 hangs over the edge" in told


def test_the_map_grows_with_the_scan(tmp_path):
    """Too few presses at first; then an estimate at each doubling, and one of the whole."""
    experiment = pm.read_study(TESTS / "data/twelve_presses/study.toml")
    scan, file = experiment.scan, tmp_path / "grown.rrd"
    box = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]])
    with Recording(file, "a scan") as recording:
        recording.scene(box, np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]))
        growing = GrowingMap(recording, experiment.study)
        for count in range(4, 12):
            some = scan.rows(np.isin(scan.press, scan.press_ids[:count]))
            growing.follow(some, whole=count == 11)
    told = [text[0] for text in rows(file, "events", "TextLog:text", "sim_time")]
    made = [text for text in told if "estimate" in text]
    assert made == [f"estimate of the map from {count} presses" for count in (4, 8, 11)]
