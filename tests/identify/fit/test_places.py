"""Places that are pressed again: one compliance each, under the right law of contact alone."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from identify.catalogue.catalogue import CATALOGUE
from identify.fit.contact_law import ContactLaw, _told_by_places, contact_law
from identify.fit.free_compliance import FreeCompliance
from identify.fit.free_compliance_fit import FreeComplianceFit
from identify.fit.settings import CONTACT_LAW
from identify.measurement.places import Places, numbered, places_of
from identify.select.first_step import _equals
from identify.select.settings import SELECTION
from tests.identify.fit.test_contact_law import PRESSES, ball, flat

PLACES = PRESSES // 2
OFFSET_M = 2e-4


def again(own: FreeCompliance) -> FreeCompliance:
    """Return the presses with the second half of them at the places of the first."""
    point = own.readings.point_m[own.readings.first]
    point[PLACES:] = point[:PLACES]
    readings = replace(own.readings, point_m=point[own.readings.press])
    return replace(own, readings=readings, contacts=replace(own.contacts, points_m=point))


def two_depths(travel, force):
    """Press every place to its full depth and to a third, in turns, its touch found late."""
    half = slice(PLACES, None)
    force[half] = force[:PLACES]
    travel[half] = travel[:PLACES]
    each = np.arange(PRESSES)
    share = np.where((each + (each >= PLACES)) % 2 == 0, 1.0, 1 / 3)[:, None]
    return share * travel - OFFSET_M, share * force


def fit_of(presses: FreeCompliance, *names: str) -> FreeComplianceFit:
    return presses.compared(presses.fit([presses.begun(CATALOGUE[name], {}) for name in names]))


def test_a_place_has_one_compliance_under_the_right_law_alone():
    presses = again(flat(1, two_depths))
    right, plain = fit_of(presses, "contact_offset"), fit_of(presses)
    assert right.again == plain.again == PLACES - 2  # less what goes with the order
    assert right.is_of_places
    assert 0.2 * PLACES < right.between < 2.5 * PLACES
    assert not plain.is_of_places
    assert right.total == right.misfit + right.between


def test_presses_that_were_weighted_down_say_nothing_of_their_places():
    def slipped(travel, force):
        travel, force = two_depths(travel, force)
        travel[-1] += 1e-4 + 3e-4 * (-1.0) ** np.arange(travel.shape[1])
        return travel, force

    presses = again(flat(1, slipped))
    found = fit_of(presses, "contact_offset")
    assert found.is_of_places
    light = presses.compared(replace(found, felt=np.ones(PRESSES), residual=0 * found.residual))
    assert not light.is_of_places


def test_a_body_that_softens_from_press_to_press_keeps_its_places():
    def softening(travel, force):
        travel, force = two_depths(travel, force)
        softer = 1 + 0.03 * -np.expm1(-np.arange(PRESSES) / 8)[:, None]
        return softer * (travel + OFFSET_M) - OFFSET_M, force

    presses = again(flat(1, softening))
    assert fit_of(presses, "contact_offset").is_of_places
    assert not fit_of(presses).is_of_places


def test_without_places_that_are_pressed_again_nothing_is_compared():
    found = fit_of(flat(1))
    assert (found.between, found.again) == (0.0, 0)
    assert not found.is_of_places


def test_a_place_is_one_point_direction_and_tip():
    point = np.zeros((4, 3))
    point[1, 0] = 1e-5
    turned = [[0, 0, -1], [0, 0, -1], [0, 0.6, -0.8], [0, 0, -1]]
    places = Places(point, np.array(turned), np.array([4e-3, 4e-3, 4e-3, 2e-3]))
    assert numbered(places).tolist() == [0, 0, 1, 2]
    assert len(set(numbered(places_of(again(flat(1)).readings)))) == PLACES


@pytest.fixture(scope="module")
def law() -> ContactLaw:
    return contact_law(ball(0, threshold_n=0.05), CATALOGUE)


def key_of(fit: FreeComplianceFit, law: ContactLaw) -> tuple[str, ...]:
    return next(names for names, one in law.fits.items() if one is fit)


@pytest.mark.parametrize(
    ("found", "other", "kept"),
    [
        (10.0, 12.0, True),
        (10.0, 1e4, False),
        (90.0, 1e4, True),  # places that differ under the law found as well say nothing
    ],
)
def test_places_that_differ_under_another_law_refute_it(law, found, other, kept):
    late = next(name for name in law.names if law.candidates(name))
    near = [fit for _, fit in law.candidates(late)]
    told = replace(
        law,
        found=replace(law.found, between=found, again=12),
        fits={
            n: replace(fit, between=other, again=12) if any(fit is one for one in near) else fit
            for n, fit in law.fits.items()
        },
    )
    assert bool(told.candidates(late)) == kept
    assert bool(told.refuted) == (not kept)
    beside_map = list(_equals(told, replace(SELECTION, meets_presses=np.inf)))
    assert [one.found for one in beside_map[: len(near)]] == [
        told.fits[key_of(f, law)] for f in near
    ]


@pytest.mark.parametrize(("between", "first"), [(1e4, "other"), (10.0, "best")])
def test_a_law_under_which_places_differ_gives_way_to_one_that_does_as_well(law, between, first):
    late = next(name for name in law.names if law.candidates(name))
    other, best = law.candidates(late)[0][1], law.found
    names = {best.names: between, other.names: 8.0}
    presses: Any = SimpleNamespace(
        compared=lambda fit: replace(fit, between=names.get(fit.names, 1e4), again=12)
    )
    chosen, fits = _told_by_places(presses, law.plain, best, law.fits, CONTACT_LAW)
    assert chosen.names == {"other": other, "best": best}[first].names
    assert chosen.again == 12
    assert set(fits) == set(law.fits)


@pytest.mark.parametrize(("unknowns", "chosen"), [(2, ("hysteresis", "contact_offset")),
                                                  (3, ("play",))])  # fmt: skip
def test_two_effects_of_as_many_numbers_take_the_place_of_one(unknowns, chosen):
    """Two scans of a dome: play met the curves, and a place was softer in its hard presses."""

    def fit(names, misfit, total, unknowns=2, is_of_places=True) -> Any:
        return SimpleNamespace(names=names, misfit=misfit, total=total, unknowns=unknowns,
                               is_of_places=is_of_places, dof=3000)  # fmt: skip

    plain, play = fit((), 6035.0, 6035.0, 0, False), fit(("play",), 2737.0, 2888.0, 2, False)
    both = fit(("hysteresis", "contact_offset"), 2701.0, 2783.0, unknowns)
    fits = {one.names: one for one in (play, both)}
    presses: Any = SimpleNamespace(compared=lambda fit: fit)
    assert _told_by_places(presses, plain, play, fits, CONTACT_LAW)[0].names == chosen


def test_a_law_that_is_worse_for_the_curves_alone_is_not_refuted_by_its_places(law):
    alike = {n: replace(fit, between=10.0, again=12) for n, fit in law.fits.items()}
    far = replace(law, found=replace(law.found, between=10.0, again=12), fits=alike)
    assert far.refuted == ()
