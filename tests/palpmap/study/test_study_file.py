"""The study file: what it says, and one sentence for each thing that is wrong in it."""

from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from identify.catalogue.catalogue import CATALOGUE
from identify.effects.readings import Readings
from models.errors import InputError
from models.scan_file import read_scan
from palpmap.study.placement import place_scan
from palpmap.study.study import (
    About,
    Body,
    Effect,
    Map,
    Noise,
    Probe,
    Study,
    load_study,
    write_study,
)
from tests.paths import LAB, ROOT

CASE_A = LAB / "case_a" / "study.toml"
TEXT = CASE_A.read_text()


def test_the_laboratory_study_is_read_as_it_stands_in_the_file():
    study = load_study(CASE_A)
    assert study.name == "case_a"
    assert study.scan == CASE_A.parent / "scan.csv"
    assert study.body.size_m == (0.096, 0.096, 0.048)
    assert (study.probe.tip, study.probe.radius_m) == ("flat", 0.005)
    assert (study.noise.displacement_m, study.noise.force_n) == (2e-5, 5e-3)
    assert study.map.inclusions == 1


def test_what_may_be_left_out_has_its_default(tmp_path):
    path = tmp_path / "study.toml"
    path.write_text(TEXT[: TEXT.index("[noise]")])
    study = load_study(path)
    assert study.noise == Noise(displacement_m=None, force_n=None)
    assert study.map == Map(inclusions=1)
    assert study.effects == ()
    assert study.body.origin_m == (0, 0, 0)


def test_the_start_of_the_travels_count_decides_which_effects_can_be(tmp_path):
    measured = read_scan(CASE_A.parent / "scan.csv")
    for said, can, cannot in (("touch", "breathing_from_touch", "surface_tilt"),
                              ("plane", "displacement_drift", "breathing_from_touch")):  # fmt: skip
        path = tmp_path / f"{said}.toml"
        path.write_text(TEXT.replace("[study]", f'[study]\ntravel_from = "{said}"'))
        readings = Readings.of(place_scan(measured, load_study(path)).scan)
        assert CATALOGUE[can].untestable(readings) is None
        assert "travel counts from" in (CATALOGUE[cannot].untestable(readings) or "")
    open_ = Readings.of(place_scan(measured, load_study(CASE_A)).scan)
    assert all(CATALOGUE[n].untestable(open_) is None for n in ("surface_tilt", "breathing"))


def test_the_example_for_measured_data_says_what_is_assumed():
    study = load_study(ROOT / "examples" / "arma_two_stiff" / "study.toml")
    assert study.body.project_points
    assert study.body.thickness_assumed
    assert study.noise == Noise()
    assert study.map.inclusions == 2
    assert study.map.initial["inclusion_2.z_m"] == -0.064
    assert len(study.map.initial) == 11


BAD = {
    "an unknown key": ("poisson_ratio", "poison_ratio", r"body.poison_ratio: .*'poisson_ratio'"),
    "an unknown table": ("[probe]", "[prob]", r"key prob: unknown key; .*is 'probe'"),
    "a missing key": ("radius_m = 0.005", "", r"probe.radius_m: the key is missing; add the tip's"),
    "a missing table": ('[probe]\ntip = "flat"\nradius_m = 0.005\n', "", r"key probe: .*missing"),
    "a missing scan": ('scan = "scan.csv"', "", r"study.scan: the key is missing; add the scan's"),
    "a scan that is no text": ('"scan.csv"', "3", r"study.scan: found 3, expected the name of a"),
    "an unknown shape": ('"block"', '"blok"', r"body.shape: found 'blok', .*right name is 'block'"),
    "an unknown tip": ('"flat"', '"round"', r"probe.tip: found 'round', expected 'flat', 'sphere'"),
    "two lengths": ("0.096, 0.096, 0.048", "0.1, 0.1", r"body.size_m: .*expected three numbers"),
    "a length of text": ("0.096, 0.096,", '0.1, "a",', r"body.size_m.1: found 'a', expected a num"),
    "a negative length": ("0.096, 0.096,", "0.1, -0.1,", r"body.size_m.1: .*greater than 0"),
    "no size of a block": ("size_m = [0.096, 0.096, 0.048]", "", r"key body: expected size_m = "),
    "a file for a block": ("[probe]", 'file = "a.stl"\n[probe]', r"key body: expected size_m = "),
    "a surface without file": ('shape = "block"', 'shape = "surface"', r"body: expected file = "),
    "an incompressible body": ("0.49", "0.5", r"poisson_ratio: found 0.5, expected less than or"),
    "a number as text": (
        "0.49",
        '"0.3"',
        r"poisson_ratio: found '0.3', expected a number without q",
    ),
    "a NaN": ("radius_m = 0.005", "radius_m = nan", r"probe.radius_m: found nan, .*finite"),
    "an unknown support": ("base-bonded", "hanging", r"body.support: found 'hanging', expected 'b"),
    "an elastic base without compliances": (
        "base-bonded",
        "base-elastic",
        r"key body: expected base_normal_m_per_pa and base_tangential_m_per_pa",
    ),
    "compliances of a bonded base": (
        '"base-bonded"',
        '"base-bonded"\nbase_normal_m_per_pa = 1e-6',
        r"key body: expected no base_normal_m_per_pa .* as support is \"base-bonded\"",
    ),
    "a base in mm/kPa": (
        '"base-bonded"',
        '"base-elastic"\nbase_normal_m_per_pa = 2.0\nbase_tangential_m_per_pa = 0.0',
        r"body.base_normal_m_per_pa: found 2 m/Pa.*multiply by 1e-6",
    ),
    "a base that pulls": (
        '"base-bonded"',
        '"base-elastic"\nbase_normal_m_per_pa = -1e-6\nbase_tangential_m_per_pa = 0.0',
        r"body.base_normal_m_per_pa: found -1e-06, expected greater than or equal to 0",
    ),
    "a side that no block has": (
        '"base-bonded"',
        '"base-bonded"\nheld_sides = ["x2"]',
        r"body.held_sides.0: found 'x2', expected 'x0', 'x1', 'y0' or 'y1'",
    ),
    "a side held twice": (
        '"base-bonded"',
        '"base-bonded"\nheld_sides = ["x0", "x0"]',
        r"body.held_sides: .*each once",
    ),
    "sides of a surface": (
        'shape = "block"\nsize_m = [0.096, 0.096, 0.048]',
        'shape = "surface"\nfile = "a.stl"\nheld_sides = ["x0"]',
        r"key body: expected no held_sides, as shape is",
    ),
    "a block in millimetres": (
        "[0.096, 0.096, 0.048]",
        "[96, 96, 48]",
        r"size_m: found 96 m.*looks like millimetres",
    ),
    "cells in millimetres": (
        'shape = "block"',
        'shape = "block"\ncell_size_m = 12',
        r"body.cell_size_m: found 12 m.*looks like millimetres",
    ),
    "a tip in millimetres": (
        "radius_m = 0.005",
        "radius_m = 5",
        r"radius_m: found 5 m.*looks like millimetres",
    ),
    "noise in millimetres": (
        "displacement_m = 2.0e-5",
        "displacement_m = 0.02",
        r"noise.displacement_m: found 0.02 m.*looks like millimetres",
    ),
    "noise in grams": ("5.0e-3", "5.0", r"noise.force_n: found 5 N.*looks like grams"),
    "noise of zero": ("5.0e-3", "0.0", r"noise.force_n: found 0.0, expected greater than 0"),
    "half an inclusion": ("inclusions = 1", "inclusions = 1.5", r"map.inclusions: found 1.5, exp"),
    "a false word": ("inclusions = 1", 'inclusions = "many"', r"found 'many', .*or \"auto\""),
    "an unknown parameter": (
        "inclusions = 1",
        "[map.initial]\ninclusion_1.zm = 0.01",
        r"key map: .*'inclusion_1.zm' is none; the nearest right name is 'inclusion_1.z_m'",
    ),
    "a parameter of no inclusion": (
        "inclusions = 1",
        "inclusions = 1\n[map.fixed]\ninclusion_2.z_m = 0.01",
        r"parameters of 1 inclusion; 'inclusion_2.z_m' is none",
    ),
    "a parameter that is text": (
        "inclusions = 1",
        '[map.fixed]\ninclusion_1.z_m = "deep"',
        r"map.fixed: expected a number for 'inclusion_1.z_m', not 'deep'",
    ),
    "a guess in millimetres": (
        "inclusions = 1",
        "[map.initial]\ninclusion_1.z_m = 30",
        r"map.initial.inclusion_1.z_m: found 30 m.*looks like millimetres",
    ),
    "a parameter free and fixed": (
        "inclusions = 1",
        "initial.background_pa = 1\nfixed.background_pa = 1",
        r"'background_pa' in \[map.initial\] or \[map.fixed\], not in both",
    ),
    "a background below zero": (
        "inclusions = 1",
        "[map.initial]\nbackground_pa = -6000.0",
        r"map.initial: expected a number greater than 0 for 'background_pa', not -6000.0",
    ),
    "a background as hard as steel": (
        "inclusions = 1",
        "[map.fixed]\nbackground_pa = 2e11",
        r"map.fixed.background_pa: found 2e\+11 Pa, expected at most 1e\+07 Pa of a soft body",
    ),
    "the beginning of an effect's name": (
        "inclusions = 1",
        'inclusions = 1\n[[effects]]\nname = "skin"',
        r"not 'skin'; the nearest right name is 'skin_layer'",
    ),
    "an inclusion of no size": (
        "inclusions = 1",
        "[map.fixed]\ninclusion_1.radius_m = 0",
        r"map.fixed: expected a number greater than 0 for 'inclusion_1.radius_m', not 0",
    ),
    "an infinite guess": (
        "inclusions = 1",
        "[map.initial]\nbackground_pa = inf",
        r"a number for 'background_pa', not inf",
    ),
    "an inclusion that is a hole": (
        "inclusions = 1",
        "initial.background_pa = 5000\nfixed.inclusion_1.weight_pa = -6000",
        r"key map: expected 'inclusion_1.weight_pa' above minus the background, -5000 Pa",
    ),
    "a background in kilopascals": (
        "inclusions = 1",
        "[map.initial]\nbackground_pa = 6.0",
        r"map.initial.background_pa: found 6 Pa.*looks like kilopascals",
    ),
    "an effect twice": (
        "[map]",
        '[[effects]]\nname = "contact_offset"\n[[effects]]\nname = "contact_offset"\n[map]',
        r"key effects: expected each effect once, but 'contact_offset' is named twice",
    ),
    "effects in single brackets": (
        "[map]",
        '[effects]\nname = "contact_offset"\n[map]',
        r"key effects: expected a table for each effect: write \[\[effects\]\]",
    ),
    "effects as a list of names": (
        "[study]",
        'effects = ["contact_offset"]\n[study]',
        r"effects.0: found 'contact_offset', expected a table for each effect: write \[\[eff",
    ),
    "a switch as text": (
        "[study]",
        '[study]\nunits_checked = "yes"',
        r"study.units_checked: found 'yes', expected true or false, without quotes",
    ),
    "a name that is a number": ('"case_a"', "3", r"study.name: found 3, expected text in quotes"),
    "an unknown effect": (
        "[map]",
        '[[effects]]\nname = "tool_complianc"\n[map]',
        r"effects.0: .*not 'tool_complianc'.*right name is 'tool_compliance'",
    ),
    "text that is not TOML": ("[map]", "[map", r"not TOML: .*line 19"),
    "a newer schema": ("[study]", "[study]\nschema = 2", r"study.schema: found 2, .*update"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_study_is_refused_with_its_key(case, tmp_path):
    old, new, sentence = BAD[case]
    assert old in TEXT
    path = tmp_path / "study.toml"
    path.write_text(TEXT.replace(old, new))
    with pytest.raises(InputError, match=sentence) as caught:
        load_study(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_sizes_that_a_user_has_confirmed_are_taken_as_they_stand(tmp_path):
    path = tmp_path / "study.toml"
    path.write_text(
        TEXT.replace("[study]", "[study]\nunits_checked = true").replace(
            "[0.096, 0.096, 0.048]", "[3.0, 3.0, 1.0]"
        )
    )
    assert load_study(path).body.size_m == (3.0, 3.0, 1.0)


@pytest.mark.parametrize(
    ("name", "data", "sentence"),
    [
        ("missing.toml", None, "no such file, expected a study file"),
        ("scan.csv", b"press,time_s", "found a scan, expected a study file"),
        ("study.toml", b"[study]\nname = '\xff'", "byte 0xff at position 16, expected UTF-8"),
    ],
)
def test_a_path_that_holds_no_study_is_refused(name, data, sentence, tmp_path):
    if data is not None:
        (tmp_path / name).write_bytes(data)
    with pytest.raises(InputError, match=sentence):
        load_study(tmp_path / name)


def full_study(folder: Path, name: str = "all of it", **changes) -> Study:
    parts = {
        "study": About(name=name, scan=folder / "data" / "scan.parquet", units_checked=True),
        "body": Body(
            shape="block",
            size_m=(0.09, 0.08, 0.03),
            poisson_ratio=0.45,
            origin_m=(-0.05, 0.01, -0.09),
            project_points=True,
            thickness_assumed=True,
        ),
        "probe": Probe(tip="sphere", radius_m=0.003),
        "noise": Noise(force_n=0.01),
        "map": Map(inclusions=2, initial={"inclusion_2.x_m": 0.01}, fixed={"background_pa": 5e3}),
        "effects": (Effect(name="tool_compliance"), Effect(name="breathing")),
    }
    return Study(**(parts | changes))


def test_a_study_that_was_written_is_read_back_the_same(tmp_path):
    surface = Body(shape="surface", file=tmp_path / "organ.stl", poisson_ratio=0.3)
    for study in (
        full_study(tmp_path),
        full_study(tmp_path, body=surface),
        full_study(tmp_path, map=Map(inclusions="auto"), effects=(), noise=Noise()),
        load_study(CASE_A),
    ):
        write_study(study, tmp_path / "study.toml")
        assert load_study(tmp_path / "study.toml") == study


def test_every_effect_of_the_catalogue_can_stand_in_a_study(tmp_path):
    effects = tuple(Effect(name=effect.name) for effect in CATALOGUE)
    write_study(full_study(tmp_path, effects=effects), tmp_path / "study.toml")
    assert load_study(tmp_path / "study.toml").effects == effects


def test_a_study_written_beside_its_scan_can_move_with_it(tmp_path):
    (tmp_path / "here").mkdir()
    write_study(full_study(tmp_path / "here"), tmp_path / "here" / "study.toml")
    (tmp_path / "here").rename(tmp_path / "there")
    study = load_study(tmp_path / "there" / "study.toml")
    assert study.scan == tmp_path / "there" / "data" / "scan.parquet"


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(name=st.text(st.characters(exclude_categories=["Cs"]), min_size=1))
def test_any_name_survives_writing(name, tmp_path):
    write_study(full_study(tmp_path, name=name), tmp_path / "study.toml")
    assert load_study(tmp_path / "study.toml").name == name
