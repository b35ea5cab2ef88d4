"""An effect that can change without moving a reading has no size that the scan would see."""

import numpy as np
import pytest

from identify.design.detection_limits import detection_limits
from identify.effects.base import Effect, EffectParameter
from identify.fit.joint_fit import fit_jointly
from tests.identify.select.loop_problem import TRUE, model, scan, timing, true_compliance


class HalfDead(Effect):
    """A slope of the displacement, and an amplitude that nothing feels."""

    name = "half_dead"
    parameters = (
        EffectParameter("slope", "m/m", "along x", 0.0, -1.0, 1.0, 1e-3),
        EffectParameter("dead", "m", "of nothing", 0.0, -1.0, 1.0, 1e-3),
    )

    def reading(self, readings, force_n, travel_m, *, slope, dead):
        return travel_m + slope * readings.point_m[:, 0]


class Dead(HalfDead):
    """Nothing at all."""

    name = "dead"

    def reading(self, readings, force_n, travel_m, *, slope, dead):
        return np.array(travel_m)


@pytest.mark.parametrize(
    ("effect", "says"),
    [
        (HalfDead(), "a combination of its slope and dead moves no reading of this scan"),
        (Dead(), "the scan does not show it at all"),
    ],
)
def test_what_moves_no_reading_is_untestable_and_has_no_size(effect, says):
    press, _, _, force = timing(0)
    fit = fit_jointly(model(scan(true_compliance()[press] * force, force, 0)), TRUE, rounds=0)
    (limit,) = detection_limits(fit, [effect])
    assert limit.smallest_share is None
    assert limit.untestable == says
