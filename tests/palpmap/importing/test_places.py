"""Presses of a testing machine: a file each, along one line, without a position."""

import json
from pathlib import Path

import numpy as np
import pytest

import palpmap as pm
from models.errors import InputError
from palpmap.commands.check_rig import run_check_rig
from palpmap.console import Output
from palpmap.importing.mapping.rig import parse_rig
from palpmap.importing.propose import propose_rig
from palpmap.importing.readers.read import read_recording

PLACES_MM = [(x, y) for x in (30, 50, 70) for y in (30, 50, 70)]
RIG = """
kind = "stream"
time = {column = "Time", unit = "s", pause_s = 20.0}
force = {column = "Load", unit = "N"}
travel = {column = "Extension", unit = "mm"}
press = {direction = [0.0, 0.0, -1.0]}
probe = {tip = "flat", radius_m = 0.005}
body = {shape = "block", size_m = [0.1, 0.1, 0.048], poisson_ratio = 0.49}
[parts]
"""


def stiffness(place_mm) -> float:
    """N/mm of a press."""
    return 0.1 + 0.001 * place_mm[0]


@pytest.fixture
def machine(tmp_path, request) -> list[Path]:
    """Files of a machine whose courses end as asked: back, in a hold, or at once."""
    rng, files = np.random.default_rng(3), []
    for number, place in enumerate(PLACES_MM, start=1):
        free = rng.uniform(0.8, 1.6)  # its zero is anywhere
        course = [np.linspace(0, free + 2, 90)]
        if request.param != "at once":
            course.append(np.full(40, free + 2))
        if request.param == "back":
            course.append(np.linspace(free + 2, 0, 70))
        way = np.concatenate(course)
        load = stiffness(place) * np.maximum(way - free, 0) + 0.02 + rng.normal(0, 2e-3, len(way))
        rows = zip(0.05 * np.arange(len(way)), way, load, strict=True)
        head = '"Specimen","press"\n\n"Time","Extension","Load"\n"(s)","(mm)","(N)"\n'
        file = tmp_path / f"Specimen_{number}.csv"
        file.write_text(head + "\n".join(f'"{t:.3f}","{d:.5f}","{f:.5f}"' for t, d, f in rows))
        files.append(file)
    return files


def mapping(files, places=PLACES_MM) -> str:
    lines = (f"{f.stem} = [{x / 1e3}, {y / 1e3}, 0.048]"
             for f, (x, y) in zip(files, places, strict=True))  # fmt: skip
    return RIG + "\n".join(lines)


@pytest.mark.parametrize("machine", ["back", "in a hold", "at once"], indirect=True)
def test_each_file_is_a_press_at_its_place(machine, tmp_path, request):
    (tmp_path / "rig.toml").write_text(mapping(machine))
    scan = pm.import_recording(machine, tmp_path / "rig.toml").scan
    assert len(scan.press_ids) == len(PLACES_MM)
    assert scan.contact_points == pytest.approx(np.array([(*p, 48) for p in PLACES_MM]) / 1e3)
    for number, place in enumerate(PLACES_MM):
        own = scan.press == scan.press_ids[number]
        travel_mm = 1e3 * scan.displacement_m[own]
        assert travel_mm.max() == pytest.approx(2.0, abs=0.1)
        off = scan.force_n[own] - stiffness(place) * travel_mm
        assert abs(off.mean()) < 0.01
    phases = set(scan.phase.tolist())
    ends = request.node.callspec.params["machine"]
    assert ("unload" in phases) == (ends == "back")
    assert ("hold" in phases) == (ends != "at once")


@pytest.mark.parametrize("machine", ["back"], indirect=True)
def test_a_proposal_asks_for_the_place_of_each_file(machine):
    recording = read_recording(machine, lambda text: None)
    text = propose_rig(recording)
    assert 'kind = "stream"' in text
    assert all(f'# "{file.stem}" =' in text for file in machine)
    rig = parse_rig(text, Path("rig.toml"))
    assert rig.travel is not None
    assert rig.travel.column == "Extension"
    assert tuple(rig.press.direction) == (0.0, 0.0, -1.0)


@pytest.mark.parametrize("machine", ["back"], indirect=True)
@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("Specimen_3 =", "Specimen_33 =", "no place of Specimen_3"),
        ("Specimen_9 = [0.07, 0.07, 0.048]", "", "no place of Specimen_9"),
        ("[parts]\n", "[parts]\nother = [0.0, 0.0, 0.0]\n", "found a place of other"),
        ("direction = [0.0, 0.0, -1.0]", 'direction = "travel"', "press.direction: expected"),
        ('travel = {column = "Extension", unit = "mm"}\n', "", "travel.column"),
        ("[parts]\n", '[pose]\ncolumns = ["a", "b", "c"]\nunit = "m"\n[parts]\n', "in pose; "),
        ("0.048]\nSpecimen_2", "0.040]\nSpecimen_2", "mm off the block's top"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_refused_in_one_sentence(machine, tmp_path, old, new, said):
    text = mapping(machine)
    assert old in text
    (tmp_path / "rig.toml").write_text(text.replace(old, new))
    with pytest.raises(InputError, match=said) as caught:
        pm.import_recording(machine, tmp_path / "rig.toml")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("machine", ["back", "in a hold"], indirect=True)
def test_a_machine_that_comes_back_is_checked_as_a_rig(machine, tmp_path, capsys, request):
    (tmp_path / "rig.toml").write_text(mapping(machine))
    output = Output(quiet=False, json=True)
    rig = {"files": machine, "rig": tmp_path / "rig.toml", "out": None, "output": output}
    if request.node.callspec.params["machine"] == "in a hold":
        with pytest.raises(InputError, match="record approach and retreat too"):
            run_check_rig(**rig)
        return
    run_check_rig(**rig)
    assert json.loads(capsys.readouterr().out)["bias_n"] == pytest.approx([0.02], abs=2e-3)


@pytest.mark.parametrize("machine", ["back"], indirect=True)
def test_two_files_of_one_name_are_refused(machine, tmp_path):
    twin = tmp_path / "again" / machine[0].name
    twin.parent.mkdir()
    twin.write_text(machine[1].read_text())
    (tmp_path / "rig.toml").write_text(mapping(machine))
    with pytest.raises(InputError, match="2 files are called Specimen_1"):
        pm.import_recording([machine[0], twin], tmp_path / "rig.toml")


def test_readings_without_position_stand_at_the_places_of_their_files(tmp_path):
    files = []
    for number in range(1, 5):
        file = tmp_path / f"press_{number}.csv"
        rows = (f"{d},{0.1 * number * d:.4f}" for d in (0.5, 1.0, 1.5, 2.0))
        file.write_text("Depth (mm),Load (N)\n" + "\n".join(rows))
        files.append(file)
    proposed = propose_rig(read_recording(files, lambda text: None))
    assert 'kind = "readings"' in proposed
    assert '# "press_4" =' in proposed
    (tmp_path / "rig.toml").write_text(
        RIG.replace('"stream"', '"readings"')
        .replace('time = {column = "Time", unit = "s", pause_s = 20.0}\n', "")
        .replace('"Load"', '"Load (N)"')
        .replace('"Extension"', '"Depth (mm)"')
        .replace("press = {", 'press = {number = "part", ')
        + "\n".join(f"{f.stem} = [0.0{n}, 0.05, 0.048]" for n, f in enumerate(files, 2))
    )
    scan = pm.import_recording(files, tmp_path / "rig.toml").scan
    expected = [(0.01 * n, 0.05, 0.048) for n in range(2, 6)]
    assert scan.contact_points == pytest.approx(np.array(expected))
    assert scan.force_n[scan.press == 2].max() == pytest.approx(0.6)
