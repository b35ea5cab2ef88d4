"""Decision on the residual of a fit: noise, or structure with its main direction.

The residual is tested in units of both noises at the latent force (`identify.residual.whitened`),
with the fitted parameters projected out (`identify.residual.hypothesis_tests`).  A dozen questions
are asked; Holm's correction keeps the probability of structure in pure noise below the level
`ResidualSettings.alpha`.
"""

from dataclasses import replace

import numpy as np
from scipy import special

from identify.effects.units import digits
from identify.fit.result import FitResult
from identify.residual.binned_means import residual_levels
from identify.residual.comparison import Comparison, Reading, ResidualTest
from identify.residual.courses import smooth_course
from identify.residual.hypothesis_tests import (
    TestOutcome,
    holm,
    lag_test,
    largest_test,
    nearest_neighbours,
    orthonormal,
    score_test,
)
from identify.residual.per_press import PressSpace, press_directions, press_residuals
from identify.residual.projected import ResidualView, residual_view
from identify.residual.settings import RESIDUAL, ResidualSettings
from identify.residual.simple_laws import matching_law
from identify.residual.statement import sentence
from identify.residual.whitened import Whitened, whitened
from models import Scan

QUESTIONS = {
    "size": "Is the residual larger than the noise?",
    "place": "Does it follow the place on the surface?",
    "force": "Does it follow the force?",
    "time": "Does it follow the time within a press?",
    "phase": "Does it follow the phase (load, hold, unload)?",
    "order": "Does it follow the order of pressing?",
    "press": "Is any single press an outlier?",
    "all_presses": "Do the presses differ more than noise allows?",
    "neighbours": "Are neighbouring presses alike (Moran's I)?",
    "succession": "Are presses made one after the other alike?",
    "lag": "Are consecutive readings correlated?",
    "reading": "Is any single reading an outlier?",
}


def compare(fit: FitResult, scan: Scan, settings: ResidualSettings = RESIDUAL) -> Comparison:
    """Compare a fit with its scan; see `compare_residual`."""
    return compare_residual(whitened(fit, scan), settings)


def compare_residual(w: Whitened, settings: ResidualSettings = RESIDUAL) -> Comparison:
    """Test a whitened residual.

    Parameters
    ----------
    w : Whitened
        Residual, noise, latent force and absorbed derivatives of m readings.

    Returns
    -------
    Comparison
        Statistics, tests, the decision and its sentence.

    Raises
    ------
    InputError
        There are no more readings than fitted parameters.
    """
    view = residual_view(w, settings)
    found = {"size": _size_test(view), **_pattern_tests(view), **_alikeness_tests(view)}
    tests = _decide([replace(found[name], question=q) for name, q in QUESTIONS.items()], settings)
    fires = {t.name for t in tests if t.fires}
    structured = min(t.p_adjusted for t in tests) < settings.structure
    varies_with, also, confused = _main_direction(view, fires)
    moran, lag = found["neighbours"], found["lag"]
    draft = Comparison(
        is_noise=not structured,
        varies_with=varies_with,
        statement="",
        also_along=also,
        confused_with=confused,
        notes=_notes(view, found),
        alpha=settings.alpha,
        readings=len(w.residual_m),
        parameters=view.absorbed.shape[1],
        rms_m=float(np.sqrt(np.mean(w.residual_m**2))),
        expected_rms_m=float(
            np.sqrt(np.mean(w.sigma_m**2) * view.dof / len(w.residual_m) + w.shared_m**2)
        ),
        chi2=view.chi2,
        dof=view.dof,
        chi2_p=found["size"].p_value,
        noise_estimated=w.noise_estimated,
        scatter=view.scatter,
        moran_i=None if moran.untestable else moran.statistic,
        lag1=None if lag.untestable else lag.statistic,
        tests=tests,
        levels=residual_levels(w, settings),
        presses=press_residuals(w, view.absorbed, view.bad),
        largest=_largest(w),
        law=matching_law(view) if structured else None,
        course=smooth_course(view) if structured else None,
        frame_m=w.scan.frame_m,
    )
    return replace(draft, statement=sentence(draft, settings))


def _size_test(view: ResidualView) -> ResidualTest:
    ratio = view.chi2 / view.dof
    if view.w.noise_estimated:
        independent = max(view.settings.independent_share * view.dof, 1)
        p = float(special.fdtrc(view.dof, independent, ratio))
    else:
        p = float(special.chdtrc(view.dof, view.chi2))
    return ResidualTest("size", "", view.chi2, view.dof, p, times_noise=float(np.sqrt(ratio)))


def _from_score(name: str, score: TestOutcome) -> ResidualTest:
    times = float(np.sqrt(score.statistic / score.dof)) if score.dof else 0.0
    untestable = None if score.dof else "the fitted parameters absorb all of it"
    return ResidualTest(
        name, "", score.statistic, score.dof, score.p_value, 1.0, times, untestable=untestable
    )


def _pattern_tests(view: ResidualView) -> dict[str, ResidualTest]:
    """Score tests of the smooth dimensions, of the presses and of single readings."""
    tests = {}
    for name, reason in view.untestable.items():
        tests[name] = ResidualTest(name, "", untestable=reason)
    for name, columns in view.directions.items():
        tests[name] = _from_score(name, score_test(view.residual, columns, view.nuisance(name)))
    tests["press"] = _worst_press(view)
    space = PressSpace(view.w, view.beyond)
    tests["all_presses"] = _from_score("all_presses", space.omnibus(view.residual, view.beyond))
    largest = float(np.max(np.abs(view.residual)))
    tests["reading"] = ResidualTest(
        "reading", "", largest, 1, largest_test(view.residual), times_noise=largest
    )
    return tests


def _worst_press(view: ResidualView) -> ResidualTest:
    """Test of the press with the largest misfit, beyond the map and smooth laws."""
    if view.w.presses < 2:
        return ResidualTest("press", "", untestable="the scan has only one press")
    worst = PressSpace(view.w, view.smooth).misfits().max() / view.scale**2
    p = min(1.0, float(special.chdtrc(2, worst)) * view.w.presses)
    return ResidualTest("press", "", float(worst), 2, p, times_noise=float(np.sqrt(worst / 2)))


def _alikeness_tests(view: ResidualView) -> dict[str, ResidualTest]:
    """Moran's I over the surface and along the order; correlation of consecutive readings."""
    w, s, tests = view.w, view.settings, {}
    few = f"the scan has only {w.presses} presses; {s.least_presses} are needed"
    for name in ("neighbours", "succession"):
        tests[name] = ResidualTest(name, "", untestable=few)
    if w.presses >= s.least_presses:
        space = PressSpace(w, view.beyond)
        line = np.eye(w.presses, k=1) + np.eye(w.presses, k=-1)
        surface = nearest_neighbours(w.scan.contact_points, s.neighbours)
        for name, neighbours in (("neighbours", surface), ("succession", line)):
            a = space.alikeness(neighbours)
            tests[name] = ResidualTest(name, "", a.moran_i, w.presses, a.p_value)
    pairs = int(w.follows.sum())
    if pairs < s.least_pairs:
        tests["lag"] = ResidualTest("lag", "", untestable=f"only {pairs} readings follow another")
    else:
        c = lag_test(view.residual, w.follows, view.absorbed)
        tests["lag"] = ResidualTest("lag", "", c.value, c.pairs, c.p_value, times_noise=abs(c.z))
    return tests


def _decide(tests: list[ResidualTest], settings: ResidualSettings) -> tuple[ResidualTest, ...]:
    adjusted = iter(holm([t.p_value for t in tests if t.untestable is None]))
    decided = []
    for test in tests:
        if test.untestable is None:
            p = float(next(adjusted))
            test = replace(test, p_adjusted=p, fires=p < settings.alpha)
        decided.append(test)
    return tuple(decided)


def _main_direction(
    view: ResidualView, fires: set[str]
) -> tuple[str | None, tuple[str, ...], tuple[str, ...]]:
    """Return the main direction of the residual, further ones, and equivalent ones.

    The dimension with the largest score wins, at a price of 2 a direction (Akaike), 2 ln m where
    the data chose the direction.  The others are tested again beyond the winner, and named from
    `further_share` of its score on.  A winner with less than `main_share` of the excess chi-square
    is not the main direction.
    """
    settings = view.settings
    candidates = {n: a for n, a in view.directions.items() if n in fires}
    if "press" in fires and view.bad:
        candidates["press"] = press_directions(view.w, view.bad)
    if "reading" in fires:
        candidates["reading"] = _outlying(view)
    if not candidates:
        return _without_pattern(fires), (), ()
    scores = {n: score_test(view.residual, a, view.nuisance(n)) for n, a in candidates.items()}
    chosen = 2 * np.log(len(view.residual))
    price = {n: (chosen if n in ("press", "reading") else 2.0) * scores[n].dof for n in scores}
    best = max(scores, key=lambda n: scores[n].statistic - price[n])
    excess = view.chi2 / view.scale**2 - view.dof / view.scale**2
    if scores[best].statistic - scores[best].dof < settings.main_share * excess:
        return _without_pattern(fires), (best,), ()
    also, confused = [], []
    for name in sorted(set(candidates) - {best}, key=lambda n: -scores[n].statistic):
        limit = settings.alpha / len(QUESTIONS)
        beside = _beyond(view, candidates, name, best)
        if beside.p_value < limit:
            if beside.statistic - beside.dof > settings.further_share * scores[best].statistic:
                also.append(name)
        elif _beyond(view, candidates, best, name).p_value >= limit:
            confused.append(name)
    return best, tuple(also), tuple(confused)


def _outlying(view: ResidualView) -> np.ndarray:
    """Directions of the outlying single readings."""
    limit = -special.ndtri(view.settings.alpha / 2 / len(view.residual))
    rows = np.argsort(-np.abs(view.residual))[: view.settings.most_outlying_readings]
    rows = rows[np.abs(view.residual[rows]) > limit]
    columns = np.zeros((len(view.residual), len(rows)))
    columns[rows, np.arange(len(rows))] = 1.0
    return columns


def _beyond(
    view: ResidualView, columns: dict[str, np.ndarray], name: str, other: str
) -> TestOutcome:
    """Score test of one dimension beyond another one."""
    nuisance = orthonormal(np.hstack([view.nuisance(name), columns[other]]))
    return score_test(view.residual, columns[name], nuisance)


def _without_pattern(fires: set[str]) -> str | None:
    """Dimension of a test without a direction of its own."""
    where = {
        "neighbours": "place",
        "succession": "order",
        "lag": "reading",
        "all_presses": "press",
        "reading": "reading",
    }
    return next((place for test, place in where.items() if test in fires), None)


def _notes(view: ResidualView, tests: dict[str, ResidualTest]) -> tuple[str, ...]:
    notes = [
        f"{QUESTIONS[name]} Cannot be tested: {test.untestable}."
        for name, test in tests.items()
        if test.untestable
    ]
    source = "given"
    if view.w.noise_estimated:
        source = "estimated"
        notes.append("The noise was estimated from this scan, as the study does not give it.")
    if view.scale > 1:
        notes.append(
            f"From one reading to the next the residual scatters {digits(view.scatter)} times as "
            f"much as the noise {source}; the questions of pattern are judged with this larger one."
        )
    elif special.chdtr(view.dof, view.chi2) < view.settings.alpha / 2:
        notes.append(
            f"The residual is {digits(np.sqrt(view.chi2 / view.dof))} times the noise {source}: "
            "that noise seems too large, so small effects may have been missed."
        )
    return tuple(notes)


def _largest(w: Whitened, count: int = 5) -> tuple[Reading, ...]:
    """Return the largest single readings, in standard deviations."""
    scan, r = w.scan, w.whitened
    rows = np.argsort(-np.abs(r))[:count]
    return tuple(
        Reading(
            press=int(scan.press[i]),
            phase=str(scan.phase[i]),
            time_s=float(scan.time_s[i]) if scan.has_time else None,
            point_m=(
                float(scan.point_m[i, 0]),
                float(scan.point_m[i, 1]),
                float(scan.point_m[i, 2]),
            ),
            force_n=float(scan.force_n[i]),
            residual_m=float(w.residual_m[i]),
            sigmas=float(r[i]),
        )
        for i in rows
    )
