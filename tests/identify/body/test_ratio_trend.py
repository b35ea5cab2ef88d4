"""How the correction to the finer mesh follows the map, against corrections made there."""

import numpy as np
import pytest

from fem import Contacts, PalpationModel, RefinedModel, block_mesh
from identify.body.mechanics import BodyMechanics
from identify.map.gaussian_map import GaussianMap, Inclusion

SIZE = (0.06, 0.06, 0.03)
HARD = GaussianMap(5000.0, (Inclusion(15000.0, 0.024, 0.032, 0.021, 0.008),))
SOFT = GaussianMap(5000.0, (Inclusion(-3000.0, 0.024, 0.032, 0.021, 0.008),))
STEPS = np.array([50.0, 100.0, 2e-4, 2e-4, 2e-4, 1e-4])


@pytest.fixture(scope="module", params=["extrapolated", "finer"])
def mechanics(request) -> BodyMechanics:
    points = [(x, y, 0.03) for x in (0.018, 0.042) for y in (0.018, 0.040)]
    contacts = Contacts(np.array(points), np.array([0, 0, -1.0]), np.array(0.005))
    coarse, fine = (
        PalpationModel(block_mesh(SIZE, cells), 0.45, contacts) for cells in ((4, 4, 2), (6, 6, 3))
    )
    return BodyMechanics.of(
        coarse, RefinedModel(coarse, fine) if request.param == "extrapolated" else fine
    )


# Where it is softest the finer mesh takes the coarse one's least modulus, without its slope
@pytest.mark.parametrize(("stiffness", "off"), [(HARD, 0.005), (SOFT, 0.1)])
def test_the_correction_has_the_slope_of_corrections_at_both_sides(mechanics, stiffness, off):
    state = mechanics.state()
    here = mechanics.corrected(stiffness, state)
    response = here.evaluate(stiffness, state)
    for number, step in enumerate(STEPS):
        ends = [stiffness.values + sign * step * np.eye(6)[number] for sign in (1, -1)]
        maps = [GaussianMap.from_values(end) for end in ends]
        up, down = (np.log(mechanics.corrected(m, state).correction.ratio) for m in maps)
        slope = here.correction.trend.by_map(stiffness)[:, number]
        assert slope == pytest.approx((up - down) / (2 * step), abs=off * np.abs(slope).max())
        up, down = (here.evaluate(m, state).compliance for m in maps)
        slope = response.by_map[:, number]
        assert slope == pytest.approx((up - down) / (2 * step), abs=0.005 * np.abs(slope).max())


def test_of_a_map_with_other_inclusions_the_correction_is_held(mechanics):
    state, plain = mechanics.state(), GaussianMap(5000.0)
    here = mechanics.corrected(HARD, state)
    response = here.evaluate(plain, state)
    coarse = mechanics.evaluate(plain, state).compliance
    assert response.compliance == pytest.approx(here.correction.ratio * coarse, rel=1e-12)
    assert response.by_map.shape == (4, 1)


def test_far_away_the_correction_levels_off(mechanics):
    trend = mechanics.corrected(HARD, mechanics.state()).correction.trend
    far = HARD.changed({"inclusion_1.weight_pa": 1e12, "inclusion_1.radius_m": 0.05})
    assert np.abs(trend.log_change(far)).max() <= 0.03
    assert trend.log_change(HARD).tolist() == [0.0] * 4
