"""A study with labelled regions: its file, its run folder, and a true body of regions."""

import json
from pathlib import Path

import numpy as np
import pytest
import pyvista
from typer.testing import CliRunner

import palpmap as pm
from models import InputError
from palpmap.__main__ import app
from palpmap.commands.check import check_study
from palpmap.commands.scan_truth import truth_of_scan
from palpmap.result.field_tables import field_tables
from palpmap.study.study import load_study
from palpmap.study.truth_file import read_truth
from tests.palpmap.test_free_map_study import study

SIZE = (0.06, 0.06, 0.03)  # of the study's body


def labels(path: Path, scale: float = 1.0) -> Path:
    """Write two regions, the second from x = 30 mm on, with voxels of 5 mm."""
    counts = np.rint(np.array(SIZE) / 0.005).astype(int)
    image = pyvista.ImageData(dimensions=counts + 1, spacing=np.full(3, 0.005 * scale))
    x = np.arange(counts[0])[:, None, None] * np.ones(counts)
    image.cell_data["labels"] = 3 + 4 * (x >= 6).ravel(order="F").astype(int)
    image.save(path)
    return path


def test_the_regions_of_a_study_are_those_of_its_body(tmp_path):
    labels(tmp_path / "labels.vti", 1e3)
    path = study(tmp_path, 'kind = "free"\nregions = "labels.vti"\nregions_unit_m = 0.001')
    opened = pm.read_study(path).opened()
    assert opened.map.field is not None
    regions = opened.map.field.regions
    assert regions is not None
    assert regions.at(np.array([[0.029, 0.01, 0.01], [0.031, 0.01, 0.01]])).tolist() == [3, 7]


def test_a_volume_that_does_not_cover_the_body_is_one_sentence(tmp_path):
    labels(tmp_path / "labels.vti", 1e3)
    path = study(tmp_path, 'kind = "free"\nregions = "labels.vti"\nregions_unit_m = 0.0005')
    with pytest.raises(InputError, match=r"key map.regions: covers \d+ % of the body"):
        pm.read_study(path).opened()
    with pytest.raises(InputError, match=r"no key 'regions', as kind is \"inclusions\""):
        pm.read_study(study(tmp_path, 'regions = "labels.vti"'))
    path = study(tmp_path, 'kind = "free"\nregions = "absent.vti"')
    with pytest.raises(InputError, match="no such file, expected a label volume"):
        pm.read_study(path).opened()


def test_a_check_reads_the_regions_of_a_study(tmp_path):
    labels(tmp_path / "labels.vti", 1e3)
    table = 'kind = "free"\nregions = "labels.vti"'
    path = study(tmp_path, f"{table}\nregions_unit_m = 0.001")
    shares = {region.label: region.share for region in check_study(path).regions}
    assert shares == pytest.approx({3: 0.5, 7: 0.5})
    printed = CliRunner().invoke(app, ["check", str(path)]).output
    assert "labels (share of body)   3 (50 %), 7 (50 %)" in printed
    for key, sentence in (
        ("regions_unit_m = 0.0005", r"key map.regions: covers \d+ % of the body"),
        ("", r"found a volume 60 m long.*millimetres: set map.regions_unit_m = 0.001"),
    ):
        with pytest.raises(InputError, match=sentence):
            check_study(study(tmp_path, f"{table}\n{key}"))
    with pytest.raises(InputError, match="no such file, expected a label volume"):
        check_study(study(tmp_path, 'kind = "free"\nregions = "absent.vti"'))


@pytest.mark.slow
def test_a_run_folder_keeps_the_regions_and_reads_them_back(tmp_path):
    labels(tmp_path / "labels.vti")
    path = study(tmp_path, 'kind = "free"\nregions = "labels.vti"')
    fit = pm.fit(pm.read_study(path))
    fit.write(tmp_path / "run")
    kept = load_study(tmp_path / "run" / "study.toml")
    assert kept.map.regions == tmp_path / "run" / "labels.vti"
    again = pm.read_run(tmp_path / "run").fit
    assert [region.label for region in again.field.regions] == [3, 7]
    sight = field_tables(fit, np.zeros(3), fit.experiment.scan)[-1]
    said = {row[0].text: row[1].text for row in sight.rows}["depth of sight"]
    assert said.endswith("mm at the middle press, for changes within its region")
    assert ">Region<" in (tmp_path / "run" / "report.html").read_text(encoding="utf-8")


def test_a_true_body_has_the_moduli_of_its_regions(tmp_path):
    labels(tmp_path / "labels.vti")
    known = load_study(study(tmp_path, 'kind = "free"'))
    table = '[regions]\nfile = "labels.vti"\nmoduli_pa = { 7 = 24000 }\n'
    truth = tmp_path / "truth.toml"
    truth.write_text(f"background_pa = 6000\n{table}", encoding="utf-8")
    found = read_truth(truth, known).map
    places = np.array([[0.029, 0.01, 0.01], [0.031, 0.01, 0.01]])
    assert found(places).tolist() == [6000, 24000]
    assert json.loads(json.dumps(found.record()))["regions_pa"] == {"7": 24000}
    truth.write_text(truth.read_text().replace("7 =", "5 ="), encoding="utf-8")
    with pytest.raises(InputError, match=r"found the label 5, expected labels of .*: 3, 7"):
        read_truth(truth, known)


def test_regions_of_an_earlier_scan_are_not_dropped_in_silence(tmp_path):
    said = {"background_pa": 6e3, "inclusions": [], "regions_pa": {"7": 2.4e4}}
    (tmp_path / "truth.json").write_text(json.dumps({"schema": 1, "body": said}))
    with pytest.raises(InputError, match=r"key body.regions_pa: .* give the TOML file"):
        truth_of_scan(tmp_path / "truth.json")


def test_a_true_inclusion_beside_the_body_is_refused(tmp_path):
    known = load_study(study(tmp_path, "inclusions = 1"))
    truth = tmp_path / "truth.toml"
    spot = "weight_pa = 9e3\nx_m = 0.03\ny_m = 30.0\nz_m = 0.02\nradius_m = 0.01\n"
    truth.write_text(f"background_pa = 6000\n[[inclusions]]\n{spot}", encoding="utf-8")
    with pytest.raises(InputError, match=r"key inclusions.0.y_m: found 30 m, expected 0 to 0.06 m"):
        read_truth(truth, known)
    wide = spot.replace("y_m = 30.0", "y_m = 0.03").replace("radius_m = 0.01", "radius_m = 10.0")
    truth.write_text(f"background_pa = 6000\n[[inclusions]]\n{wide}", encoding="utf-8")
    with pytest.raises(
        InputError, match=r"inclusions.0.radius_m: found 10 m, expected at most 0.06"
    ):
        read_truth(truth, known)
