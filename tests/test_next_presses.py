"""Proposed presses: as few as are needed, and what they promise is what they bring when made."""

import numpy as np
import pytest
from loop_problem import (
    NOISE,
    NU,
    SIZE,
    TRUE,
    contacts,
    model,
    scan,
    timing,
    true_compliance,
)
from numpy.testing import assert_array_equal

from fem import Contacts, PalpationModel, RefinedModel, block_mesh
from identify.body_mechanics import BodyMechanics
from identify.effects.catalogue import effect_named
from identify.joint_fit import fit_jointly
from identify.next_presses import ENOUGH, FEWEST, NEEDED, next_presses
from identify.scan_design import BETWEEN_SCANS_S, presses_of, readings_of, variations
from models.scan import Scan
from models.scan_join import stack_scans

OFFSET_M = 5e-5
RIVALS = {  # with where their fits begin
    "contact_offset": {"offset_m": 2e-5},
    "force_bias": {"bias_n": -2e-3},
    "spherical_tip": {"share": 0.05},
}
SEED = 6


@pytest.fixture(scope="module")
def table() -> Scan:
    """A scan whose travels are all too large by the same."""
    press, _, _, force = timing(SEED)
    return scan(true_compliance()[press] * force + OFFSET_M, force, SEED)


def fits(of_scan: Scan, body: BodyMechanics | None = None):
    plain = model(of_scan, body)
    state = fit_jointly(plain, TRUE).at.state
    return [
        (name, fit_jointly(plain.with_effect(effect_named(name), start, state), TRUE))
        for name, start in RIVALS.items()
    ]


@pytest.fixture(scope="module")
def rivals(table):
    return fits(table)


@pytest.fixture(scope="module")
def proposals(rivals):
    readings = rivals[0][1].model.readings
    return next_presses(rivals[:2], list(variations(presses_of(readings), True)))


def test_what_tells_rivals_apart_comes_first_and_the_quickest_of_it(proposals):
    told = [len(p.told) for p in proposals]
    assert told == sorted(told, reverse=True)
    durations = [p.design.presses.duration_s for p in proposals if p.told]
    assert durations == sorted(durations)
    assert all(p.discrimination >= NEEDED for p in proposals if p.told)
    assert all(p.discrimination < NEEDED for p in proposals if not p.told)
    others = [p.discrimination for p in proposals if not p.told]
    assert others == sorted(others, reverse=True)


def test_only_as_many_presses_are_asked_for_as_are_needed(proposals, rivals):
    best = next(p for p in proposals if p.design.name == "two_radii")
    whole = next(d for d in variations(presses_of(rivals[0][1].model.readings), True)
                 if d.name == "two_radii").presses  # fmt: skip
    count = len(best.design.presses)
    assert FEWEST <= count < len(whole)
    assert ENOUGH <= best.discrimination < 2 * ENOUGH
    asked = [tuple(point) for point in best.design.presses.point_m]
    order = [tuple(point) for point in whole.point_m]
    assert [order.index(point) for point in asked] == sorted(map(order.index, asked))


def test_presses_that_are_made_bring_what_was_promised(proposals, rivals, table):
    """The other side's finite elements press as proposed; both rivals are fitted to all."""
    best = next(p for p in proposals if p.design.name == "two_radii")
    presses = best.design.presses
    radii = Contacts(presses.point_m, presses.direction, presses.radius_m)
    pair = [
        PalpationModel(block_mesh(SIZE, n, split="alternating"), NU, radii)
        for n in ((6, 6, 4), (10, 10, 6))
    ]
    truth = RefinedModel(*pair)
    felt = truth.evaluate(TRUE.modulus(truth.points_m)).compliance
    readings = readings_of(presses, True, rivals[0][1].model.readings)
    rng = np.random.default_rng(SEED)
    m = len(readings)
    further = Scan(
        press=readings.press + 25, time_s=readings.time_s, phase=readings.phase,
        point_m=readings.point_m, direction=readings.direction,
        force_n=readings.force_n + NOISE.force_n * rng.standard_normal(m),
        displacement_m=felt[readings.press] * readings.force_n + OFFSET_M
        + NOISE.displacement_m * rng.standard_normal(m),
        probe_radius_m=readings.radius_m,
    )  # fmt: skip
    both = stack_scans([table, further])
    now = contacts()
    all_contacts = Contacts(
        both.contact_points, both.contact_directions, np.append(now.radius_m, presses.radius_m)
    )
    coarse, fine = (
        PalpationModel(block_mesh(SIZE, n), NU, all_contacts) for n in ((5, 5, 3), (8, 8, 5))
    )
    body = BodyMechanics(
        coarse,
        RefinedModel(coarse, fine),
        lambda nu: PalpationModel(coarse.mesh, nu, all_contacts),
    )
    (_, right), (_, wrong), _ = fits(both, body.corrected(TRUE, body.state()))
    (_, right_before), (_, wrong_before), _ = rivals
    gained = (wrong.chi2 - right.chi2) - (wrong_before.chi2 - right_before.chi2)
    promised = best.discrimination
    assert abs(gained - promised) < 3 * 2 * np.sqrt(promised)
    assert gained > 20


def test_pairs_that_would_stay_alike_are_said(rivals):
    readings = rivals[0][1].model.readings
    designs = [d for d in variations(presses_of(readings), True) if d.name == "same"]
    (proposal,) = next_presses(rivals, designs)
    assert {*proposal.told, *proposal.alike} == {
        ("contact_offset", "force_bias"),
        ("contact_offset", "spherical_tip"),
        ("force_bias", "spherical_tip"),
    }
    assert proposal.pair in (proposal.told or proposal.alike)


def test_a_further_scan_goes_on_in_time_and_order(rivals):
    present = rivals[0][1].model.readings
    further = readings_of(presses_of(present), True, present)
    assert further.time_s[0] > present.time_s[-1] + BETWEEN_SCANS_S
    assert_array_equal(further.order, present.order + 25)
