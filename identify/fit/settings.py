"""Tuning numbers of the fits."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class FitSettings:
    """Accuracy, correction and intervals of a fit; misfits are half of chi-square.

    Lengths of parameters are scaled coordinates (`identify.map.parameters`), of order one. The
    defaults, `PRECISE`, serve a map alone, which is fitted once and reported to its digits;
    `SEARCH` serves map and effects of a model that stays, `TRIAL` the hundreds that are compared.

    Attributes
    ----------
    ftol : decrease of the misfit below which a search ends. 1e-4 moves no parameter by more than
        0.015 standard deviations, 1e-2 by no more than 0.14 (sqrt(2 ftol))
    rtol : the same relative to the misfit: a rough valley promises more for ever
    enough : decrease of chi-square in two steps in a row below which a search ends, too
    max_evaluations : of the finite element model, in one minimisation
    gross_misfit : ratio of residual to noise, sqrt(chi-square per degree of freedom), above which
        the model is wrong and the noise says nothing of its parameters: further digits and rounds
        do not help, intervals stay straight, and the map has an error of its own
    gross_rtol : `rtol` of a gross misfit, relative to its excess over the gross limit if the search
        began above that
    rounds, gross_rounds : largest number of corrections towards the finer model, and under a gross
        misfit; 0 keeps the present correction
    guarded : a correction that raises the finer model's own chi-square is made anew, with a shorter
        step of the map. Without, at one solution of the finer model a round, for starts near the
        minimum
    raised : tolerated rise of chi-square in a first correction, and in any while a minimum is
        sought, times chi-square per reading above one
    nearer, nearer_rounds : share of the map's step that is tried then, and further rounds
    settled : standard deviations of the estimate; a round that moves it by less is the last. They
        count as larger by the misfit over the noise
    settled_most : ... and by the misfit once more, but at most this much: the worse the model, the
        less another round is worth
    stops_count : no minimum is known better than the stop of its search: a gross misfit has settled
        within that
    confirmed : the record of the fit is that of the full model, and its correction is made at the
        estimate; without, both may be those of reduced bases and of a map nearby
    slack, most_misfit_slack : factor on the tolerances of reduced bases in a fit that is not to be
        confirmed, and the largest further one, the ratio of misfit to noise: errors of 1e-4 in
        the worst press's compliance move chi-square by less than one, where models differ by ten
    target, of_gap, reach : chi-square of another model, the share of a fit's distance from it below
        which steps that lower it by less are the last, and the share that a next step must promise;
        nothing without a target
    kept_starts : number of initial maps, among dozens, from which a search starts
    start_evaluations : of each of these, for one inclusion; twice as many for each more, as several
        take longer to separate
    most_inclusions : of a map with a free number of inclusions
    start_depths, start_radii : depths and radii of initial inclusions, shares of the body's height
    curved_intervals : intervals follow the bend of the misfit's valley
    interval_evaluations : of each refit along the valley
    interval_tries : step lengths along the valley, until chi-square rises as it should
    interval_corrections : towards the finer model in a refit, as the map moves far along the valley
    interval_noise : share of the noise in a depth's variance; below it, where the finer mesh's own
        error decides how far the valley goes, a refit has at least one such correction
    sure_sigmas : standard errors of the weight of an inclusion that is certainly there
    straight_step, longest_step : standard deviation in scaled coordinates below which a model
        counts as linear, and above which a step is cut, in the estimate of the curvature bias
    structured_sigmas : standard deviations of chi-square above its mean, beyond which that bias,
        hundredths of a standard error of an effect's size, is no matter
    """

    ftol: float = 1e-4
    rtol: float = 0.0
    enough: float = 0.0
    max_evaluations: int = 100
    gross_misfit: float = 5.0
    gross_rtol: float = 1e-3
    rounds: int = 8
    gross_rounds: int = 3
    guarded: bool = True
    raised: float = 4.0
    nearer: float = 0.25
    nearer_rounds: int = 5
    settled: float = 0.03
    settled_most: float = 10.0
    stops_count: bool = True
    confirmed: bool = True
    slack: float = 10.0
    most_misfit_slack: float = 3.0
    target: float | None = None
    of_gap: float = 0.05
    reach: float = 0.4
    kept_starts: int = 3
    start_evaluations: int = 8
    most_inclusions: int = 4
    start_depths: tuple[float, ...] = (0.15, 0.35, 0.6)
    start_radii: tuple[float, ...] = (0.12, 0.25, 0.45)
    curved_intervals: bool = True
    interval_evaluations: int = 10
    interval_tries: int = 5
    interval_corrections: int = 0
    interval_noise: float = 0.4
    sure_sigmas: float = 5.0
    straight_step: float = 0.02
    longest_step: float = 0.5
    structured_sigmas: float = 10.0

    def is_gross(self, chi2_per_dof: float) -> bool:
        """Whether a misfit is gross: the one definition, see `gross_misfit`."""
        return chi2_per_dof > self.gross_misfit**2

    @property
    def most_spent(self) -> int:
        """Evaluations after which no further round begins beyond `rounds`.

        In a valley that is rough as no model is right, each would take as many as all before; a
        record is worth twice the evaluations of a trial.
        """
        return (1 + self.confirmed) * self.rounds * self.max_evaluations

    @property
    def following(self) -> FitSettings:
        """The settings by which starts are compared, before any correction at their ends."""
        return replace(self, ftol=0.1, rtol=1e-2, enough=1.0, confirmed=False, slack=100.0)


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

TRIAL = replace(SEARCH, confirmed=False, nearer_rounds=2)


@dataclass(frozen=True)
class CrossValidationSettings:
    """Settings of `identify.fit.cross_validation`.

    Attributes
    ----------
    folds : groups of presses that are left out in turn
    longest_step : of the map, in logarithms and inclusion radii; a prediction beyond it is not
        linear and takes the model itself
    high_force : share of the largest force above which readings count as the highest level
    ftol, evaluations, slack : of a fit without a group, where no linear step predicts
    """

    folds: int = 9
    longest_step: float = 0.3
    high_force: float = 2 / 3
    ftol: float = 1e-2
    evaluations: int = 12
    slack: float = 10.0


CROSS_VALIDATION = CrossValidationSettings()


@dataclass(frozen=True)
class FreeComplianceSettings:
    """Settings of the fit with one free compliance per press (`identify.fit.free_compliance`).

    Attributes
    ----------
    compliance_steps, compliance_tol : largest number of Gauss-Newton steps towards the compliances
        for given effects, and change of a compliance, in its standard errors, that ends them (those
        of its press's own misfit, where that is larger than noise)
    longest_step : of ln C
    lost : growth of a press's chi-square by such a step, from which on it goes half way back
    widest : largest difference of ln C from the middle press
    felt, softest : a press met resistance if its force rises above so many standard deviations, and
        its compliance is not so many times that of the middle one
    tail : chi-square per reading from which a press loses its weight
    reweighted : fits with renewed weights
    unfelt : a parameter stands still whose scale moves the readings by less, in their noise
    ftol, rtol : decrease of half of chi-square that ends a fit, absolute and relative
    max_evaluations : of a fit
    own_compliance, own_modulus : largest changes of ln C and ln E of a press on a body of any kind
    own_growth, stiffening : range of the growth of its contact there (0 of a plate over a soft
        body, -4 of a bonded layer that is incompressible and thin), and a start beside the even one
    own_step : of difference quotients by these
    places_differ : p-value below which presses of one place differ
    early : how much sooner than evenly a body softens, of what is taken off before
    """

    compliance_steps: int = 12
    compliance_tol: float = 0.01
    longest_step: float = 0.5
    lost: float = 3.0
    widest: float = 7.0
    felt: float = 6.0
    softest: float = 10.0
    tail: float = 4.0
    reweighted: int = 3
    unfelt: float = 0.1
    ftol: float = 0.05
    rtol: float = 1e-4
    max_evaluations: int = 30
    own_compliance: float = 1.0
    own_modulus: float = 4.0
    own_growth: tuple[float, float] = (-4.0, 0.0)
    stiffening: float = -2.0
    own_step: float = 1e-4
    places_differ: float = 1e-3
    early: float = 20.0


FREE_COMPLIANCE = FreeComplianceSettings()
FREE_COMPLIANCE_TRIAL = replace(
    FREE_COMPLIANCE, reweighted=1, rtol=1e-2, max_evaluations=8, compliance_tol=0.1
)


@dataclass(frozen=True)
class ContactLawSettings:
    """Settings of the search for a contact law (`identify.fit.contact_law`).

    Attributes
    ----------
    bent : chi-square per degree of freedom of straight presses (three times the noise) from which
        on a contact law is sought; the lower `bent_ball` where tip or study bend the curves anyway
    margin : in units of chi-square over that of the best fit, after the price of parameters
    noise_share : least share of presses with noise alone for a law to be accepted
    noise_sd : standard deviations by which the misfit of the true law may lie below its mean
    most_effects : in a law
    least, equal : shares of the excess misfit: an effect takes at least the one, sets within the
        other are equivalent, because the laws themselves are right to a few per cent
    fewer : share of the presses with noise by which a simpler form of the same causes may lie
        below and be as good
    shapes : candidates of a shape parameter
    searched : presses that serve to compare the sets, where there are half as many again
    near, refitted : share of the excess misfit within which of the best set there, and most sets of
        a size, that are then fitted to all presses
    refitted_partial : sets of a size that are fitted to all presses where none holds for enough
    leading, few : sets of a size that a search tries again where presses are set apart, and the
        largest share of all that these are; else all sets are tried
    perhaps : share of an effect's price at which a larger set is among them
    unsure : share of the excess misfit within which another law of contact, or a simpler form of
        it, is as credible, where structure is left; a ball on an uneven body is right to a seventh
        at worst
    most_of : ... and of which a set without noise in enough presses is said to take most
    """

    bent: float = 9.0
    bent_ball: float = 2.0
    margin: float = 10.0
    noise_share: float = 0.8
    noise_sd: float = 3.0
    most_effects: int = 3
    least: float = 0.05
    equal: float = 0.01
    fewer: float = 0.05
    shapes: int = 12
    searched: int = 60
    near: float = 0.03
    refitted: int = 6
    refitted_partial: int = 3
    leading: int = 12
    few: float = 0.2
    perhaps: float = 0.5
    unsure: float = 0.1
    most_of: float = 0.5


CONTACT_LAW = ContactLawSettings()


@dataclass(frozen=True)
class PosteriorSettings:
    """Settings of `identify.fit.posterior`.

    Attributes
    ----------
    chains : independent ones
    trials, rounds : weighted draws by which the proposal finds the posterior's mean and covariance,
        and how often
    freedom : of the proposal's t distribution, whose tails are wider than the posterior's
    unfolded, folds_tried : distance from the estimate, in standard deviations, within which the
        bent coordinates do not fold, and directions in which that is tried
    slack : of reduced bases, see `identify.body.BodyMechanics.evaluate`; on the demo's scan the
        log-posterior was off by 0.01 (rms, largest 0.04) with 10 and 50 alike, for half the time
    largest_r_hat, least_effective : of draws that have settled (Vehtari et al. 2021)
    """

    chains: int = 4
    trials: int = 300
    rounds: int = 2
    freedom: float = 8.0
    unfolded: float = 6.0
    folds_tried: int = 2000
    slack: float = 50.0
    largest_r_hat: float = 1.01
    least_effective: float = 400.0


POSTERIOR = PosteriorSettings()
