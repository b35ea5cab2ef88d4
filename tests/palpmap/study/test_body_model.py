"""From a study to its finite element models: what holds the body."""

import re
from dataclasses import replace

import numpy as np
import pytest

from fem import Contacts, PalpationModel, Support, block_mesh
from identify.map.gaussian_map import GaussianMap, Inclusion
from models.errors import InputError
from models.scan import Scan
from models.scan_file import read_scan
from palpmap.study.body import Body
from palpmap.study.body_model import _noted, build_body_model, support_of
from palpmap.study.cell_size import cell_size_m, smallest_cell_m
from palpmap.study.study import Study, load_study, write_study
from tests.fem.reference.hayes import punch_factor
from tests.paths import LAB

CASE_A = LAB / "case_a"
ELASTIC = {
    "support": "base-elastic",
    "base_normal_m_per_pa": 2e-6,
    "base_tangential_m_per_pa": 5e-6,
}


def study_with(**body) -> Study:
    """The laboratory's study with another body."""
    study = load_study(CASE_A / "study.toml")
    tables = study.model_dump(by_alias=True)
    tables["body"] |= body
    return Study.model_validate(tables)


@pytest.fixture(scope="module")
def three_presses() -> Scan:
    scan = read_scan(CASE_A / "scan.csv")
    return scan.rows(np.isin(scan.press_index, [0, 31, 40]))


@pytest.mark.parametrize(
    "body",
    [
        ELASTIC,
        {"support": "base-sliding"},
        {"held_sides": ["x0", "y1"], "poisson_ratio": 0.4999},
        ELASTIC | {"held_sides": ["x0"]},
    ],
)
def test_a_support_survives_writing_and_reading(body, tmp_path):
    study = study_with(**body)
    write_study(study, tmp_path / "study.toml")
    assert load_study(tmp_path / "study.toml").body == study.body


@pytest.mark.slow
def test_the_support_of_the_study_holds_all_models(three_presses):
    found = {}
    for name, body in {
        "bonded": {},
        "elastic": ELASTIC,
        "sliding": {"support": "base-sliding"},
        "held": {"held_sides": ["x0", "x1", "y0", "y1"]},
    }.items():
        body = body | {"cell_size_m": 0.016}
        models = build_body_model(study_with(**body), three_presses)
        supports = {models.search.support, models.coarse.support, models.fine.coarse.support,
                    models.fine.fine.support}  # fmt: skip
        assert supports == {support_of(study_with(**body).body)}
        found[name] = models.fine.evaluate(6e3).compliance
    assert (found["held"] < found["bonded"]).all()
    assert (found["bonded"] < found["sliding"]).all()
    assert (found["bonded"] < found["elastic"]).all()
    # As built by hand, on a mesh of its own
    contacts = Contacts(three_presses.contact_points, (0, 0, -1), 0.005)
    mesh = block_mesh((0.096, 0.096, 0.048), (12, 12, 6))
    own = PalpationModel(mesh, 0.49, contacts, support=Support(normal=2e-6, tangential=5e-6))
    np.testing.assert_allclose(found["elastic"], own.evaluate(6e3).compliance, rtol=5e-3)


def test_a_further_compliance_of_the_base_is_in_series_with_the_studys():
    mesh, contacts = block_mesh((2, 2, 1), (3, 3, 2)), Contacts((1, 1, 1), (0, 0, -1), 0.2)
    one = PalpationModel(mesh, 0.4, contacts, near_field=False, support=Support(normal=0.1))
    both = PalpationModel(mesh, 0.4, contacts, near_field=False,
                          support=Support(normal=0.4, tangential=0.2))  # fmt: skip
    np.testing.assert_allclose(
        one.evaluate(1.0, (0.3, 0.2)).compliance, both.evaluate(1.0).compliance, rtol=1e-9
    )


def test_a_slanted_press_on_a_sliding_base_is_refused_with_what_to_do(three_presses):
    slanted = np.array([0.6, 0.0, -0.8])
    scan = replace(three_presses, direction=np.tile(slanted, (len(three_presses.direction), 1)))
    with pytest.raises(InputError, match=r'body.support: found "base-sliding", but press \d push'):
        build_body_model(study_with(support="base-sliding"), scan)
    held = study_with(support="base-sliding", held_sides=["x0"])
    assert np.isfinite(build_body_model(held, scan).search.evaluate(6e3).compliance).all()


@pytest.mark.slow
def test_finer_cells_come_closer_to_what_a_fine_mesh_answers(three_presses):
    contacts = Contacts(three_presses.contact_points, (0, 0, -1), 0.005)
    mesh = block_mesh((0.096, 0.096, 0.048), (14, 14, 7), split="alternating")
    exact = PalpationModel(mesh, 0.49, contacts)
    ball = GaussianMap(6e3, (Inclusion(20e3, 0.043, 0.047, 0.036, 0.007),))
    known = exact.evaluate(ball.modulus(exact.points_m)).compliance

    def error(study: Study) -> float:
        model = build_body_model(study, three_presses).coarse
        return float(
            np.abs(model.evaluate(ball.modulus(model.points_m)).compliance / known - 1).max()
        )

    assert error(study_with(cell_size_m=0.008)) < 0.5 * error(study_with())
    same = build_body_model(study_with(cell_size_m=0.012), three_presses)
    default = build_body_model(study_with(), three_presses)
    for model in ("search", "coarse"):
        cells = [len(getattr(one, model).mesh.cells) for one in (same, default)]
        assert cells[0] == cells[1]


def test_cells_that_cannot_be_computed_with_are_refused_with_the_least_size():
    least = smallest_cell_m(study_with().body)
    assert cell_size_m(study_with(cell_size_m=least).body) == least
    with pytest.raises(InputError, match=rf"cell_size_m: found 0.001 m, .* at least {least:g} m"):
        cell_size_m(study_with(cell_size_m=0.001).body)


def test_an_assumed_thickness_is_said_with_its_weight_as_a_bonded_layer_has_it():
    body = Body(
        shape="block", size_m=(0.14, 0.14, 0.02), poisson_ratio=0.45, thickness_assumed=True
    )
    contacts = Contacts([[0.07, 0.07, 0.02]], [0.0, 0.0, -1.0], 0.005)
    model = PalpationModel(block_mesh((0.14, 0.14, 0.02), (16, 16, 4)), 0.45, contacts)
    said = _noted(body, model, "")
    percent = float(re.search(r"would be ([\d.]+) % softer", said).group(1))
    thin, thick = (punch_factor(0.005 / h, 0.45) for h in (0.02, 1.2 * 0.02))
    assert percent == pytest.approx(100 * (thin / thick - 1), rel=0.1)
