"""The recording of an explanation holds the numbers of its ladder."""

import json
import string
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.image import imread
from numpy.testing import assert_allclose, assert_array_equal
from rerun.chunk import RrdReader

from palpmap.commands.review import run_review as review_run
from palpmap.console import Output
from palpmap.recording import entities as parts
from palpmap.recording.explain import BEFORE, CANDIDATES, ERROR, record_explanation
from palpmap.recording.explain_layout import PRESSES
from palpmap.recording.maps import map_views, residual_colors
from palpmap.recording.reader import read_summary, scalar_series
from palpmap.result.finding import step_finding


@pytest.fixture(scope="module")
def chunks(explained_case):
    return list(RrdReader(explained_case.folder / "recording.rrd").stream())


def rows(chunks, entity, component):
    """(iteration, value) of a component of an entity; iteration None where it is static."""
    found = []
    for chunk in chunks:
        if chunk.entity_path == f"/{entity}":
            batch = chunk.to_record_batch()
            if component in batch.schema.names:
                steps = (
                    batch.column(parts.ITERATION).to_pylist()
                    if parts.ITERATION in batch.schema.names
                    else [None] * batch.num_rows
                )
                values = batch.column(component).to_pylist()
                found += zip(steps, values, strict=True)
    return found


def painted(chunks, entity, step):
    """Colours (j, 3) of the points of an entity at a step."""
    ((_, packed),) = [r for r in rows(chunks, entity, "Points3D:colors") if r[0] == step]
    value = np.array(packed, np.uint32)
    return np.stack([value >> 24, value >> 16 & 255, value >> 8 & 255], axis=1).astype(np.uint8)


def layout_of(path):
    """(timeline at opening, {name: origin} of all views) of the layout."""
    reader, timeline, views = RrdReader(path), "", {}
    for blueprint in reader.blueprints():
        for chunk in reader.stream(store=blueprint):
            batch = chunk.to_record_batch()
            if "TimePanelBlueprint:timeline" in batch.schema.names:
                timeline = batch.column("TimePanelBlueprint:timeline").to_pylist()[-1][0]
            if "ViewBlueprint:space_origin" in batch.schema.names:
                (name,), (origin,) = (
                    batch.column(f"ViewBlueprint:{column}").to_pylist()[-1]
                    for column in ("display_name", "space_origin")
                )
                views[name] = origin.strip("/")
    return timeline, views


def has_content(chunk):
    """Whether there is more than the style of a curve."""
    names = chunk.to_record_batch().schema.names
    return any(":" in name and not name.startswith("Series") for name in names)


@pytest.mark.parametrize("timeline", [None, parts.PRESS])
def test_on_opening_no_view_is_empty_and_the_presses_have_their_tab(
    explained_case, chunks, timeline
):
    opened, views = layout_of(explained_case.folder / "recording.rrd")
    filled = {
        chunk.entity_path.strip("/")
        for chunk in chunks
        if has_content(chunk)
        and (chunk.is_static or (timeline or opened) in chunk.timeline_names)
    }  # fmt: skip
    empty = {n for n, o in views.items() if not any(f"{e}/".startswith(f"{o}/") for e in filled)}
    assert opened == parts.ITERATION
    assert empty == (set() if timeline else {PRESSES})
    (text,) = rows(chunks, parts.ABOUT, "TextDocument:text")[-1][1]
    assert PRESSES in text


def test_the_maps_are_coloured_on_the_scale_of_the_last_and_the_true_one(explained_case, tmp_path):
    case = explained_case
    finding = step_finding(case.folder, case.problem, case.explained.final)
    first, last = case.explained.ladder
    wild = {name: 30 * value for name, value in first.fit.values.items() if "weight" in name}
    other = first.fit.map.changed(wild)
    explained = replace(
        case.explained, ladder=(replace(first, fit=replace(first.fit, map=other)), last)
    )
    record_explanation(tmp_path / "r.rrd", finding, explained, case.record, case.problem, {})
    chunks = list(RrdReader(tmp_path / "r.rrd").stream())
    box = finding.outline.lower_m, finding.outline.upper_m
    maps = [map_views(m.modulus, *box).range_pa for m in (last.fit.changed_map, finding.truth)]
    wanted = [min(low for low, _ in maps), max(high for _, high in maps)]
    ranges = [r for _, (r,) in rows(chunks, f"{parts.FOUND_MAP}/top", "DepthImage:depth_range")]
    assert_allclose(ranges, [wanted, wanted])


def test_review_finds_the_recording_whole_and_small(explained_case, run_review):
    code, record = run_review(explained_case.folder)
    assert code == 0
    assert record["whole"]
    assert record["missing"] == () or record["missing"] == []
    summary = read_summary(explained_case.folder / "recording.rrd")
    assert summary.presses == 25
    assert summary.spans[parts.ITERATION] == (0, 1)
    assert summary.bytes < 4e6


def test_texts_have_only_characters_that_the_viewer_can_draw(chunks):
    """Its font lacks block elements, and one of them ends the program."""
    texts = [
        text
        for chunk in chunks
        for column in chunk.to_record_batch().schema.names
        if column.startswith("TextDocument:text")
        for (text,) in filter(None, chunk.to_record_batch().column(column).to_pylist())
    ]
    assert len(texts) >= 2
    assert set("".join(texts)) - set(string.printable) <= set("µ²±×−–·∫■σ")


@pytest.mark.slow
def test_the_layout_is_rendered_to_a_picture(explained_case, capsys):
    output = Output(json=True)
    if not review_run(run=explained_case.folder, png=True, summary=False, output=output):
        said = capsys.readouterr().err
        assert "Vulkan" in said, said
        pytest.skip("no Vulkan driver here")
    picture = imread(json.loads(capsys.readouterr().out)["picture"])
    assert picture[..., :3].std() > 0.02  # something is drawn


def test_errors_fall_as_on_the_ladder(explained_case, chunks):
    ladder = explained_case.record.ladder
    for name, key in (
        ("rms_um", "rms_m"),
        ("held_out_um", "held_out_rms_m"),
        ("noise_um", "noise_rms_m"),
    ):
        series = scalar_series(chunks, f"{ERROR}/{name}", parts.ITERATION)
        assert_allclose(
            series, [[k, 1e6 * getattr(step, key)] for k, step in enumerate(ladder)], rtol=1e-12
        )
    chi2 = scalar_series(chunks, parts.CHI2, parts.ITERATION)[:, 1]
    assert_allclose(chi2, [step.chi2_per_dof for step in ladder], rtol=1e-12)


def test_residuals_are_painted_on_one_scale_before_and_after(explained_case, chunks):
    means = [
        1e6 * np.array([p.mean_m for p in rung.comparison.presses])
        for rung in explained_case.explained.ladder
    ]
    limit = max(np.abs(m).max() for m in means)
    for step, mean in enumerate(means):
        assert_array_equal(
            painted(chunks, f"{parts.RESIDUAL_MAP}/points", step), residual_colors(mean, limit)
        )
    assert_array_equal(painted(chunks, f"{BEFORE}/points", None), residual_colors(means[0], limit))


def test_measured_is_modelled_and_residual(chunks):
    measured, modelled, residual = (
        scalar_series(chunks, entity, parts.PRESS)
        for entity in (parts.MEASURED, parts.MODELLED, parts.RESIDUAL)
    )
    assert len(measured) == 25
    assert_allclose(measured[:, 1] - modelled[:, 1], 1e-3 * residual[:, 1], atol=1e-12)


def test_parameters_and_their_truth_are_those_of_the_record(explained_case, chunks):
    found = explained_case.record.parameters
    for name in ("background_pa", "viscoelasticity.g", "viscoelasticity.tau_s"):
        entity, factor = parts.parameter_entity(name)
        last = scalar_series(chunks, entity, parts.ITERATION)[-1]
        assert_allclose(last, [1, factor * found[name].value], rtol=1e-12)
    entity, _ = parts.parameter_entity("background_pa", true=True)
    assert_allclose(scalar_series(chunks, entity, parts.ITERATION)[:, 1], 5.0)
    entity, _ = parts.parameter_entity("viscoelasticity.g")
    assert_allclose(scalar_series(chunks, entity, parts.ITERATION)[0], [0, 0])  # not there yet


def test_candidates_and_the_verdict_stand_in_words(explained_case, chunks):
    texts = dict(rows(chunks, CANDIDATES, "TextDocument:text"))
    assert "viscoelasticity" in texts[0][0]
    assert "viscoelasticity" not in texts[1][0]
    events = [text[0] for _, text in rows(chunks, parts.EVENTS, "TextLog:text")]
    assert any("keeps sinking" in text for text in events)
    assert events[-1].startswith("Explained.")
