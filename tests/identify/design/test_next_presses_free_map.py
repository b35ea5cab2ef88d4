"""Proposed presses beside a free map: they know its prior, and what the present scan says of it."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from fem import Contacts, PalpationModel, block_mesh
from identify.body.mechanics import BodyMechanics
from identify.catalogue.catalogue import CATALOGUE
from identify.design.next_presses import _Planned, _Present, next_presses
from identify.design.predicted_limits import planned
from identify.design.scan_variants import (
    Design,
    Presses,
    presses_of,
    readings_of,
    variations,
)
from identify.design.settings import PLAN
from identify.effects.base import Values
from identify.fit.free_compliance import FreeCompliance
from identify.fit.free_map.field_evidence import Hyper
from identify.fit.free_map_fit import FreeMapFit
from identify.fit.result import FitResult
from identify.map import FreeMap, GaussianMap, Grid, MaternField
from identify.map.initial_guess import REFERENCE_PA
from identify.map.parameters import ParameterSpace
from identify.measurement.chain import OperatingPoint
from identify.measurement.model import MeasurementModel
from tests.identify.select.loop_problem import NOISE, NU, SIZE, points

TRUE = {"contact_offset": {"offset_m": -4e-5}}
LENGTHS_M, LEVEL = (0.009, 0.06), np.log(8e3)
HYPER = Hyper(0.02, 0.3, 0.02)
CANDIDATES = {"contact_offset": {"offset_m": -2e-5}, "touch_threshold": {"threshold_n": 4e-3}}


def pressed(
    presses: Presses,
    true_values: Mapping[str, Values] = TRUE,
    profile: Literal["flat", "hertz"] = "flat",
) -> MeasurementModel:
    """Readings of an uneven body, their travel too short by the same; without noise."""
    readings = readings_of(presses, timed=False)
    radius = presses.radius_m * {"flat": 1.0, "hertz": 0.6}[profile]
    contacts = Contacts(presses.point_m, presses.direction, radius, profile)
    coarse = PalpationModel(block_mesh(SIZE, (5, 5, 3)), NU, contacts)
    grid = Grid.over(np.array([[0, 0, 0], SIZE]), 0.006)
    true = LEVEL + MaternField(grid, 0.02, 0.3).draws(np.random.default_rng(3), 1)[0]
    c = coarse.evaluate(FreeMap(grid, true).modulus(coarse.points_m)).compliance
    unit = REFERENCE_PA * coarse.evaluate(REFERENCE_PA).compliance
    model = MeasurementModel(
        readings, np.zeros(len(readings)), NOISE, BodyMechanics.of(coarse),
        ParameterSpace(FreeMap(grid, np.full(len(grid), LEVEL)), (), ()), unit_compliance=unit,
    )  # fmt: skip
    chain = replace(model.chain, effects=[CATALOGUE[name] for name in true_values])
    at = OperatingPoint(c, unit / c, readings.force_n, true_values)
    return replace(model, displacement_m=chain.predict(at))


def fits(presses: Presses, true_values: Mapping[str, Values] = TRUE) -> list[tuple[str, FitResult]]:
    model = pressed(presses, true_values)
    state = model.mechanics.state()
    return [
        (name, FreeMapFit(model.with_effect(CATALOGUE[name], at, state), HYPER, LENGTHS_M).run())
        for name, at in CANDIDATES.items()
    ]


def chi2(candidates: list[tuple[str, FitResult]]) -> list[float]:
    """Chi-square of each candidate beside every map of its prior."""
    posteriors = [fit.field and fit.field.posterior for _, fit in candidates]
    return [posterior.chi2 for posterior in posteriors if posterior]


@pytest.fixture(scope="module")
def present() -> Presses:
    each, down = np.ones(25), np.tile([0.0, 0.0, -1.0], (25, 1))
    return Presses(points(), down, 0.004 * each, 0.3 * each, each, 2 * each, each, each, 0 * each)


@pytest.fixture(scope="module")
def candidates(present):
    return fits(present)


@pytest.fixture(scope="module")
def designs(present) -> dict[str, Design]:
    return {design.name: design for design in variations(present, timed=False)}


def test_designs_of_any_presses_are_planned_at_the_map_of_the_fit(candidates, designs):
    fit = candidates[0][1]
    two = designs["two_radii"]
    fewer = replace(two, presses=two.presses.taken(np.arange(0, 25, 3)))
    for further in (True, False):
        model, at = planned(fit, fewer, further=further)
        c = model.mechanics.evaluate(fit.map, fit.at.state).compliance
        assert at.compliance == pytest.approx(c, rel=1e-9)
        # The modulus under a tip is that of the homogeneous body of the press's compliance
        homogeneous = model.mechanics.evaluate(GaussianMap(REFERENCE_PA), fit.at.state).compliance
        assert at.modulus == pytest.approx(REFERENCE_PA * homogeneous / c, rel=1e-9)
        assert model.displacement_m == pytest.approx(at.predicted_m)
        assert (model.map_uncertainty is None) == further


def test_presses_are_planned_with_the_compliances_that_the_present_readings_ask_for(
    candidates, designs
):
    """Beside an effect a map may be off that was found without it: the readings say how far."""
    fit = candidates[0][1]
    softer = 1 + 0.01 * np.arange(25)
    assert fit.at.compliance == pytest.approx(fit.at.body.compliance, rel=1e-3)
    at = replace(fit.at, compliance=softer * fit.at.body.compliance)
    off = replace(fit, solution=replace(fit.solution, at=at))
    for name in ("two_forces", "two_radii"):  # those of another tip: as the press at their place
        model, there = planned(off, designs[name], further=True)
        assert there.compliance == pytest.approx(softer * there.body.compliance, rel=1e-12)
        r = model.readings
        travel = there.compliance[r.press] * r.force_n + fit.values["contact_offset.offset_m"]
        assert there.predicted_m == pytest.approx(travel, abs=1e-9)


def test_planned_readings_of_a_ball_are_those_of_its_law_at_the_forces_that_are_set(present):
    soft = replace(present, force_n=np.linspace(0.02, 0.05, 25))
    model = pressed(soft, profile="hertz")
    fit = FreeMapFit(model, HYPER, LENGTHS_M).run()
    (same,) = (d for d in variations(soft, timed=False) if d.name == "same")
    further, there = planned(fit, same, further=True)
    exact = there.point._replace(force_n=further.readings.force_n)
    assert further.displacement_m == pytest.approx(further.chain.predict(exact), abs=2e-7)


def test_planned_readings_end_where_those_of_the_scan_do(present):
    """A robot notes none as the tip leaves: at no force laws differ most."""
    noted = readings_of(replace(present, released=np.full(25, 0.1)), timed=True)
    assert presses_of(noted).released == pytest.approx(0.1)
    again = readings_of(presses_of(noted), timed=True)
    assert again.force_n.min() == pytest.approx(noted.force_n.min())
    back = again.phase == "unload"
    assert np.ptp(again.time_s[back & (again.press == 0)]) == pytest.approx(0.9 * 5 / 6, rel=1e-6)


def test_places_that_were_pressed_tell_more_than_another_body_of_the_prior(candidates, designs):
    design, fit = designs["two_forces"], dict(candidates)
    for (truth, name), known in (
        _Planned(_Present.of(candidates), design).worth_in_order(np.arange(25)).items()
    ):
        (_, there), (model, at) = (planned(fit[n], design) for n in (truth, name))
        apart = at.whitened(there.predicted_m - at.predicted_m, model.readings.press)
        fitted = at.jacobian @ np.linalg.lstsq(at.jacobian, apart, rcond=None)[0]
        assert known > 1.2 * np.sum((apart - fitted) ** 2)


@pytest.mark.parametrize(
    ("name", "least"), [("same", 0.95), ("two_forces", 0.95), ("two_radii", 0.6)]
)
def test_presses_alone_are_promised_what_their_own_fits_bring(
    candidates, designs, present, name, least
):
    """Laws of contact are told by places with a compliance of their own: no map ties these."""
    order = "contact_offset", "touch_threshold"
    now = misfits(present)
    at_present = _Present.of(candidates, dict(zip(CANDIDATES, now, strict=True)))
    promised = _Planned(at_present, designs[name]).worth_in_order(np.arange(25))[order]
    further = designs[name].presses
    both = zip(vars(present).values(), vars(further).values(), strict=True)
    then = misfits(Presses(*map(np.concatenate, both)))
    gained = (then[1] - then[0]) - (now[1] - now[0])
    assert least < gained / promised < 1.05  # another tip's laws bend


def test_few_presses_of_a_design_are_planned_where_the_presses_alone_tell(candidates, present):
    """Some at places that were pressed, and one elsewhere."""
    elsewhere = present.point_m.copy()
    elsewhere[3] += [3e-3, 3e-3, 0.0]
    further = replace(present, point_m=elsewhere, force_n=present.force_n / 3)
    few = Design("few", "with few presses", further.taken(np.arange(0, 25, 3)))
    alone = dict(zip(CANDIDATES, misfits(present), strict=True))
    small = replace(PLAN, needed=0.01, aim=0.02, fewest=2)
    (proposal,) = next_presses(candidates, [few], None, small, alone)
    assert proposal.enough
    assert 2 <= len(proposal.design.presses) < len(few.presses)
    assert 0.1 < proposal.discrimination < 0.6  # of 0.69 by all nine


@pytest.mark.parametrize(
    ("threshold_n", "offset_m", "least", "most"),
    [(0.0, -4e-4, 0.9, 1.1), (0.03, 0.0, 0.8, 1.1), (0.02, -2e-4, 0.0, 20.0)],
)
def test_readings_between_two_laws_promise_no_more_than_they_have_shown(
    present, threshold_n, offset_m, least, most
):
    """Once more the same presses: they show what the present ones did, or two sigmas more."""
    true_values = {
        "contact_offset": {"offset_m": offset_m},
        "touch_threshold": {"threshold_n": threshold_n},
    }
    between = fits(present, true_values)
    chi2 = misfits(present, true_values)
    shown = abs(np.subtract(*chi2))
    alone = dict(zip(CANDIDATES, chi2, strict=True))
    (same,) = (d for d in variations(present, timed=False) if d.name == "same")
    promised = min(_Planned(_Present.of(between, alone), same).worth(np.arange(25)).values())
    assert least * shown < promised < most * shown
    assert promised < shown + 4 * 9  # of 78, were one law right


def misfits(presses: Presses, true_values: Mapping[str, Values] = TRUE) -> list[float]:
    """Chi-square of the presses under each candidate, each place with a compliance of its own."""
    model = pressed(presses, true_values)
    assert model.unit_compliance is not None
    alone = FreeCompliance(
        model.readings, model.displacement_m, NOISE, model.mechanics.contacts, NU,
        model.unit_compliance, model.mechanics.state(),
    )  # fmt: skip
    return [
        alone.compared(alone.fit([alone.begun(CATALOGUE[name], values)])).total
        for name, values in CANDIDATES.items()
    ]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["two_forces", "two_radii"])
def test_presses_that_are_made_bring_what_was_promised(candidates, designs, present, name):
    """All presses are made, without noise, and both candidates are refitted to all of them.

    A refit finds a prior anew as well, and follows the bend of the laws; the promise is straight.
    """
    further = designs[name].presses
    promised = _Planned(_Present.of(candidates), designs[name]).worth_in_order(np.arange(25))
    both = zip(vars(present).values(), vars(further).values(), strict=True)
    made = Presses(*(np.concatenate(pair) for pair in both))
    (right, wrong), (right_now, wrong_now) = map(chi2, (candidates, fits(made)))
    gained = (wrong_now - right_now) - (wrong - right)
    assert 0.45 < gained / promised["contact_offset", "touch_threshold"] < 1.3
