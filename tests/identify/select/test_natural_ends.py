"""A bound that is physics is a finding; a bound of the search is a doubt, and never `unexplained`
beside noise."""

from dataclasses import replace

import numpy as np
import pytest

from fem import PalpationModel, RefinedModel, block_mesh
from identify.catalogue.catalogue import CATALOGUE
from identify.effects.base import Effect, EffectParameter
from identify.select.explanation import OTHER_CAUSE
from identify.select.forward_selection import forward_selection
from tests.identify.select.loop_problem import (
    NU,
    SIZE,
    TRUE,
    contacts,
    model,
    scan,
    timing,
    true_compliance,
)


def on_oil() -> np.ndarray:
    """Compliances (25,) of the true body on a base without friction: two meshes, extrapolated."""
    pair = [
        PalpationModel(block_mesh(SIZE, n, split="alternating"), NU, contacts())
        for n in ((6, 6, 4), (10, 10, 6))
    ]
    both = RefinedModel(*pair)
    return both.evaluate(TRUE.modulus(both.points_m), (0.0, 1.0)).compliance


@pytest.mark.slow
def test_a_body_that_slides_without_friction_is_explained():
    press, _, _, force = timing(5)
    table = scan(on_oil()[press] * force, force, 5)
    names = ("contact_offset", "base_sliding", "force_bias", "preconditioning")
    found = forward_selection(model(table), TRUE, table, [CATALOGUE[name] for name in names])
    assert (found.verdict, found.added) == ("explained", ("base_sliding",))
    values = found.final.fit.at.values["base_sliding"]
    assert values["tangential_m_per_pa"] > 10 * SIZE[2] / TRUE.background_pa
    says = CATALOGUE["base_sliding"].evidence(values, found.final.fit.model.readings)
    assert "freely" in says
    for name, value in zip(TRUE.names, TRUE.values, strict=True):
        assert abs(found.final.fit.values[name] - value) < 4 * found.final.fit.std[name]


class SmallOffset(type(CATALOGUE["contact_offset"])):
    """An offset of at most a tenth of a millimetre."""

    name = "small_offset"
    parameters = (EffectParameter("offset_m", "m", "offset", 0.0, -1e-4, 1e-4, 1e-4),)


@pytest.mark.parametrize("natural", ["", "upper"])
def test_a_bound_of_the_search_is_a_doubt_and_a_natural_one_a_finding(natural):
    press, _, _, force = timing(6)
    table = scan(true_compliance()[press] * force + 1.02e-4, force, 6)
    effect: Effect = SmallOffset()
    effect.parameters = (replace(effect.parameters[0], natural=natural),)  # pyright: ignore
    found = forward_selection(model(table), TRUE, table, [effect])
    held = found.final.fit.at.values["small_offset"]["offset_m"]
    assert held == pytest.approx(1e-4, abs=1e-9)
    assert found.final.comparison.is_noise
    if natural:
        assert (found.verdict, found.added) == ("explained", ("small_offset",))
    else:
        assert (found.verdict, found.added) == ("ambiguous", ())
        assert found.ambiguous == (("small_offset", OTHER_CAUSE),)
