"""Beside a cause outside the catalogue no effect is offered that may be its imitation."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from identify.catalogue.catalogue import CATALOGUE
from identify.effects.unknown_course import COURSES, UNKNOWN
from identify.measurement import model as measurement
from identify.measurement.model import MeasurementModel
from identify.select import forward_selection as selection
from identify.select.accepted_effect import AcceptedEffect
from identify.select.form_average import averaged, structure_factor
from identify.select.form_curve import form_curves
from identify.select.forward_selection import forward_selection
from identify.select.outlying_presses import confirmed
from identify.select.settings import SELECTION
from identify.select.verdicts import effect_verdict
from palpmap.result.explain_words import verdict_detail
from tests.identify.select.loop_problem import TRUE, model
from tests.identify.select.test_forward_selection import planted

EFFECTS = [CATALOGUE[n] for n in ("hysteresis", "force_wander")]


def warmer(d, f, t, phase, press):
    """A body that stiffens and softens again while the room cools and warms."""
    return d * (1 - 0.12 * np.sin(np.pi * (t - t.min()) / np.ptp(t)) ** 2), f


def loop(d, f, t, phase, press):
    """A loop of 8 % of the largest travel, the way back a parabola."""
    top = np.array([d[press == p].max() for p in range(press.max() + 1)])[press]
    return d + 0.3 * d * (1 - d / top) * (phase == "unload"), f


def sawtooth(d, f, t, phase, press):
    """A tip that sticks and jumps on, by 0.12 mm."""
    return d - 1.2e-4 * np.mod(d / 5e-4, 1), f


def looped_and_warmer():
    return planted(12, lambda d, f, t, *rest: loop(*warmer(d, f, t, *rest), t, *rest))


@pytest.fixture(scope="module")
def found():
    table = looped_and_warmer()
    return forward_selection(model(table), TRUE, table, EFFECTS)


@pytest.mark.slow
def test_a_course_takes_the_place_of_the_imitations_of_an_unknown_cause(found):
    assert found.verdict == "unexplained"  # though the residual is noise
    assert found.final.comparison.is_noise
    assert found.unknown == ("unknown_session_share",)
    assert (found.added, found.ambiguous) == (("hysteresis",), ())
    course = found.effect("unknown_session_share")
    said = course.evidence(found.final.fit.at.values[course.name], found.final.fit.model.readings)
    assert "goes with the time of the session, smoothly" in said
    assert said.endswith(("12 %.", "13 %.", "11 %."))


@pytest.mark.slow
def test_an_answer_holds_on_fewer_readings_whatever_other_course_does_as_well_there(found):
    """A course has no name to be doubted: neither its equals nor its bounds count."""
    table = looped_and_warmer()
    (course,) = (a for a in found.accepted if a.is_unknown)
    equal = replace(course.candidates[0], name="unknown_session_force")
    bounded = replace(course, candidates=(*course.candidates, equal))
    answer = replace(found, accepted=tuple(bounded if a is course else a for a in found.accepted))
    some = table.time_s % 3 > 1
    others = table.rows(some)
    assert confirmed(answer, model(others), others, some, print) is not None


@pytest.mark.slow
def test_a_curve_of_any_shape_beside_the_course_is_not_offered_by_name(found, monkeypatch):
    assert found.added == ("hysteresis",)
    monkeypatch.setattr(type(found.effect("hysteresis")), "any_shape", True)
    assert (found.added, found.ambiguous) == ((), ())
    assert found.parts_of_unknown == ("hysteresis",)
    assert effect_verdict(found.effect("hysteresis"), found).verdict == "helps"
    resting = replace(found, resting_on_outliers=("hysteresis",))
    assert resting.ambiguous == ()
    known = replace(found, accepted=tuple(a for a in found.accepted if not a.is_unknown))
    assert known.parts_of_unknown == ()


def test_free_curves_are_marked():
    marked = {effect.name for effect in CATALOGUE if effect.any_shape}
    assert marked == {"free_loop", "free_saturation", "free_stiffening"}


def test_beside_several_courses_of_an_unknown_cause_no_effect_has_a_name():
    """A sticky tip was three courses, a free loop and the saturation of a sensor."""
    table = planted(13, sawtooth)
    found = forward_selection(model(table), TRUE, table, [CATALOGUE["contact_offset"]])
    (offset,) = found.accepted
    courses: Any = [
        replace(offset, name=name, candidates=(SimpleNamespace(name=name, family=UNKNOWN),))
        for name in ("unknown_within_force", "unknown_back_force")
    ]
    one, several = (replace(found, accepted=(offset, *courses[:count])) for count in (1, 2))
    assert one.parts_of_unknown == ()
    assert several.parts_of_unknown == ("contact_offset",)
    law: Any = SimpleNamespace(middle_misfit=1.0)
    called = replace(offset, shown_by_presses=True, law=law)
    assert replace(several, accepted=(called, *courses)).parts_of_unknown == ()


@pytest.mark.slow
def test_the_course_is_drawn_along_the_session(found):
    (curve,) = (c for c in form_curves(found.final.fit) if c.effect == "unknown_session_share")
    assert (curve.along, curve.unit) == ("time of the session", "1")
    start, middle, end = (np.interp(x * curve.at[-1], curve.at, curve.value) for x in (0, 0.5, 1))
    assert middle == pytest.approx(min(curve.value), abs=0.01)
    assert abs(start) < 0.01
    assert end - middle == pytest.approx(0.12, abs=0.03)


@pytest.mark.slow
def test_the_map_beside_the_course_holds(found):
    fit = found.final.fit
    for name, value in zip(TRUE.names, TRUE.values, strict=True):
        assert abs(fit.values[name] - value) < 3 * fit.std[name]


def test_beside_structure_that_no_course_takes_nothing_is_offered_and_intervals_grow():
    table = planted(13, sawtooth)
    found = forward_selection(model(table), TRUE, table, [CATALOGUE["contact_offset"]])
    assert found.verdict == "unexplained"
    assert not found.told_apart
    assert "contact_offset" in [a.name for a in found.accepted]  # the mean of the saw's teeth
    assert (found.added, found.ambiguous, found.unknown) == ((), (), ())
    assert effect_verdict(CATALOGUE["contact_offset"], found).verdict == "helps"
    wide, own = averaged(found, ()), found.final.fit.intervals(curved=False)
    for name in TRUE.names:
        assert wide[name].std > own[name].std
        assert wide[name].lower95 < own[name].lower95 < own[name].upper95 < wide[name].upper95
    # With a contact law that leaves noise in the presses, each on a body of its own, it is
    (offset,) = (a for a in found.accepted if a.name == "contact_offset")
    other = replace(offset.candidates[0], name="touch_threshold")
    for misfit, offered in ((1.04, True), (1.18, False)):
        law: Any = SimpleNamespace(middle_misfit=misfit)
        called = replace(
            offset, candidates=(offset.candidates[0], other), shown_by_presses=True, law=law
        )
        answer = replace(found, accepted=(called,))
        assert answer.ambiguous == (("contact_offset", "touch_threshold"),) * offered
        verdict = effect_verdict(CATALOGUE["contact_offset"], answer)
        assert verdict.verdict == ("indistinguishable" if offered else "helps")
        words = "The single presses call for contact_offset or touch_threshold, with any map."
        assert (words in verdict_detail(answer)) == offered
        alone = replace(called, candidates=called.candidates[:1])
        assert replace(found, accepted=(alone,)).added == ("contact_offset",) * offered


def test_standard_errors_count_an_error_that_the_readings_of_a_press_share():
    """The estimates of a linear model scatter as wide as said, where noise alone says a fifth."""
    rng, presses, each = np.random.default_rng(4), 40, 25
    press = np.repeat(np.arange(presses), each)
    columns = np.column_stack([np.ones(len(press)), rng.standard_normal(presses)[press]])
    covariance = np.linalg.inv(columns.T @ columns)
    estimates, said = [], []
    for _ in range(200):
        error = rng.standard_normal(len(press)) + rng.standard_normal(presses)[press]
        u = covariance @ columns.T @ error
        solution = SimpleNamespace(noise_covariance=covariance, covariance=covariance)
        fit: Any = SimpleNamespace(
            solution=solution, u=u, chi2_per_dof=2.0,
            model=SimpleNamespace(readings=SimpleNamespace(press=press, presses=presses)),
            at=SimpleNamespace(jacobian=columns, residual=error - columns @ u),
        )  # fmt: skip
        estimates.append(u)
        said.append(structure_factor(fit) ** 2 * np.diag(covariance))
    np.testing.assert_allclose(np.mean(said, axis=0), np.var(estimates, axis=0), rtol=0.25)


def test_beside_a_course_nothing_stays_that_was_found_unneeded(monkeypatch):
    """The first step had two effects of a law, of which one was lost later; the seed is kept."""
    asked, fitted = [], []
    part = {n: SimpleNamespace(effect=SimpleNamespace(name=n)) for n in ("ball", "late", "course")}

    class Model(SimpleNamespace):
        without = MeasurementModel.without

        def with_effect(self, effect, values, state):
            return Model(effects=(*self.effects, part["course"]))

    def fit(bic, *names):
        return SimpleNamespace(
            bic=bic, chi2=bic, effect_names=names, model=Model(effects=tuple(map(part.get, names))),
            at=SimpleNamespace(residual=np.zeros(9), values={"course": {}}, state=None), map=None,
        )  # fmt: skip

    def step(fit):
        comparison, diagnosis = SimpleNamespace(law=None, is_noise=False), SimpleNamespace(seed=7)
        return SimpleNamespace(fit=fit, comparison=comparison, diagnosis=diagnosis)

    def diagnose(fit, courses, seed=0, settings=None):
        asked.append(seed)
        return SimpleNamespace(scores=[SimpleNamespace(statistic=900.0, sizes=[1.0])])

    def fit_jointly(model, stiffness):
        fitted.append([p.effect.name for p in model.effects])
        return fit(100.0, *fitted[-1])

    monkeypatch.setattr(selection, "replace", lambda one, **changes: one)
    monkeypatch.setattr(measurement, "replace", lambda one, effects: Model(effects=effects))
    monkeypatch.setattr(selection, "COURSES", [SimpleNamespace(name="course")])
    monkeypatch.setattr(selection, "diagnose", diagnose)
    monkeypatch.setattr(selection, "shortlist", lambda *_, **__: ["course"])
    monkeypatch.setattr(
        selection, "compare_candidates",
        lambda now, *_: (SimpleNamespace(name="course", fit=now.fit, family=UNKNOWN),),
    )  # fmt: skip
    monkeypatch.setattr(selection, "fit_jointly", fit_jointly)
    monkeypatch.setattr(selection, "found_again", lambda fit: fit)
    monkeypatch.setattr(selection, "_grow", lambda *_: None)
    ball: Any = AcceptedEffect("ball", (), shown_by_presses=True)
    ladder: Any = [step(fit(900.0)), step(fit(700.0, "ball", "late")), step(fit(600.0, "ball"))]
    path = selection._Path(ladder, [ball], ["late"])
    means: Any = SimpleNamespace(
        judged=lambda fit, effects: step(fit), say=lambda text: None, settings=SELECTION
    )
    found = selection._with_unknown_cause(path, [], means)
    assert fitted == [["ball", "course"]]
    assert [a.name for a in found.accepted] == ["ball", "course"]
    assert found.dropped == ["late"]
    assert asked == [7]


@pytest.mark.parametrize("course", COURSES, ids=lambda c: c.name)
def test_a_course_is_nothing_at_its_null_and_of_its_quantity_elsewhere(course):
    readings = model(planted(3, lambda d, f, *_: (d, f))).readings
    force, travel = readings.force_n, 0.01 * readings.force_n
    names = [p.name for p in course.parameters]

    def moved(size):
        values = dict.fromkeys(names, size)
        if "force" in course.hooks:
            return course.force(readings, force, **values) - force
        hook = course.reading if "reading" in course.hooks else course.response
        return hook(readings, force, travel, **values) - travel

    assert course.family == UNKNOWN
    assert np.abs(moved(0.0)).max() == 0
    small = course.parameters[0].typical
    change = moved(small)
    assert np.abs(change).max() > 0
    np.testing.assert_allclose(moved(2 * small), 2 * change, atol=1e-12)
