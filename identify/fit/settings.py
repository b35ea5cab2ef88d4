"""Numbers that a fit of map and effects is tuned by."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class FitSettings:
    """Accuracy, correction and intervals of a fit; misfits are half of chi-square.

    Lengths of parameters are scaled coordinates (`identify.map.parameters`), of order one. The
    defaults, `PRECISE`, are those of a map alone, which is fitted once and reported to its digits;
    `SEARCH` are those of map and effects, fitted hundreds of times while models are compared.

    Attributes
    ----------
    ftol : decrease of the misfit that is not worth a step. 1e-4 moves no parameter by more than
        0.015 standard deviations, 1e-2 by no more than 0.14 (sqrt(2 ftol))
    rtol : the same as a part of the misfit: a rough valley promises more for ever
    enough : a search ends, too, when two steps in a row lowered chi-square by no more
    max_evaluations : of the finite element model, in one minimisation
    gross_misfit : residual over noise, sqrt(chi-square per degree of freedom), above which the
        model is wrong and the noise says nothing of its parameters: neither digits nor rounds cure
        that, intervals do not bend, and the map counts as having an error of its own
    gross_rtol : `rtol` of a gross misfit, as a part of its excess over the gross limit if the
        search began above that
    rounds, gross_rounds : of correction towards the finer model, at most, and under a gross misfit;
        0 keeps the present correction
    guarded : a correction that raises the finer model's own chi-square is made anew, with a shorter
        step of the map. Without, at one solution of the finer model a round, for starts near the
        minimum
    raised : chi-square by which a first correction may raise it before that is looked into
    nearer, nearer_rounds : part of the map's step that is then tried, and further rounds
    settled : a round that moves the estimate by fewer standard deviations is the last; these count
        as larger by the misfit over the noise
    settled_most : ... and by the misfit once more, but at most this much: the worse the model, the
        less another round is worth
    stops_count : no minimum is known better than the stop of its search: a gross misfit has settled
        within that
    kept_starts : initial maps that are followed, of the dozens that are tried
    start_evaluations : of each that is followed, for one inclusion; several take longer to sort
        themselves out, twice as long for each more
    curved_intervals : intervals follow the bend of the misfit's valley
    interval_evaluations : of each refit along the valley
    interval_tries : lengths of the step along the valley, until chi-square rises as it should
    interval_corrections : towards the finer model in a refit, as the map moves far along the valley
    """

    ftol: float = 1e-4
    rtol: float = 0.0
    enough: float = 0.0
    max_evaluations: int = 100
    gross_misfit: float = 5.0
    gross_rtol: float = 1e-3
    rounds: int = 8
    gross_rounds: int = 3
    guarded: bool = False
    raised: float = 4.0
    nearer: float = 0.25
    nearer_rounds: int = 5
    settled: float = 0.03
    settled_most: float = 10.0
    stops_count: bool = True
    kept_starts: int = 3
    start_evaluations: int = 8
    curved_intervals: bool = True
    interval_evaluations: int = 10
    interval_tries: int = 3
    interval_corrections: int = 0

    def is_gross(self, chi2_per_dof: float) -> bool:
        """Whether the model misfits so much that the noise says nothing of its parameters."""
        return chi2_per_dof > self.gross_misfit**2


PRECISE = FitSettings()
SEARCH = FitSettings(
    ftol=1e-2,
    rtol=1e-6,
    max_evaluations=40,
    rounds=3,
    guarded=True,
    settled=0.1,
    settled_most=1.0,
    stops_count=False,
    interval_corrections=1,
)
