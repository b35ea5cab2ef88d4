"""Tuning numbers of the model selection."""

from dataclasses import dataclass

from identify.fit.settings import (
    CONTACT_LAW,
    CROSS_VALIDATION,
    PRECISE,
    ContactLawSettings,
    CrossValidationSettings,
    FitSettings,
)
from identify.residual.settings import ResidualSettings


@dataclass(frozen=True)
class DiagnosisSettings:
    """Levels and simulation of the score tests (`identify.select.score_test`).

    Attributes
    ----------
    alpha : family-wise error of the support for any effect of the catalogue, under pure noise
    alike : cosine of two patterns above which their effects cannot be distinguished
    visible : share of a pattern beyond the fitted parameters below which the map absorbs the effect
    draws : simulated residuals of a null distribution
    certain : natural logarithm of a p-value below which nothing is simulated
    tail : upper share of the simulation to which the tail is matched
    block_bytes : memory of the patterns that are scored at a time
    """

    alpha: float = 0.01
    alike: float = 0.9
    visible: float = 1e-5
    draws: int = 1000
    certain: float = -40.0
    tail: float = 0.1
    block_bytes: float = 8e6


DIAGNOSIS = DiagnosisSettings()


@dataclass(frozen=True)
class StartSettings:
    """Settings of `identify.select.start_fit`.

    Attributes
    ----------
    other_shape : chi-square per degree of freedom above which a map has an error of its own, for a
        block in place of a body of another shape; otherwise a gross misfit (`FitSettings`)
    error_rounds : fits with this error as noise
    weaker : factors on the inclusions of a map that the mesh cannot resolve, in turn
    fit, contact_law : of the map, and of the presses alone
    """

    other_shape: float = 1.5
    error_rounds: int = 2
    weaker: tuple[float, ...] = (0.3, 0.1, 0.03)
    fit: FitSettings = PRECISE
    contact_law: ContactLawSettings = CONTACT_LAW


START = StartSettings()


SURE = 1e-3  # family-wise p-value of a missing cause, with a name or without
BESIDE_EFFECTS = ResidualSettings(structure=SURE)


@dataclass(frozen=True)
class SelectionSettings:
    """Thresholds of `identify.select.forward_selection`; shares are of 1.

    Attributes
    ----------
    most_effects : largest number of effects added after the first step
    trace : of the chi-square explained: residue of laws that are right to a seventh
    of_laws, nearly_noise : of the chi-square that contact laws of the presses explain, and residual
        over noise: up to both, structure that remains is within the accuracy of these laws
    imitated : visible share of an effect's pattern below which the map imitates all of it
    worthwhile, third_worthwhile : least share of the unexplained chi-square for an effect beside
        structure, and from the third one on: of four causes the strongest takes a quarter, and the
        second may still stand beside an imitation of the first. In 58 blind trials the hidden
        effect took a third or more, in 40 others 87 %; an imitation of an unknown cause took 21 %
        or less from its second step on
    left_of_error : of the chi-square explained by the possible model error: the pattern of that
        error is an estimate, right to a third, and its own error is in turn like another effect
    mending, of_mend, of_left, alone : steps from which on the last effect may only mend the fit of
        the others, the largest shares of what all explain and of what the others left by which it
        does, and the share by which one of them is no imitation
    by_compliance : of a pattern's square: beyond it, an effect acts on compliances alone
    margin : difference of the criterion (chi-square and price) beyond which an effect wins
    followed : equals of an earlier effect that are followed by one of their own, at most
    pairs : of effects in the place of one that the contact law found, fitted with the map, at most
    close : difference of chi-square below which two effects count as equal at a higher price
    dear : difference of the criterion beyond which they do not
    whole_bound : of an amplitude's bound: a 95 % interval that covers more of it tells nothing
    together : correlation of two effects' amplitudes beyond which only a sum of them is determined
    sure : family-wise p-value of an effect that is added
    shortlist : best-scored effects that are refitted
    hopeless : of the best linear score: a refit does not make up for less
    same_family : of the best linear score in a family, likewise; its members' scores compare well
    refit_evaluations : of the body's model, in a refit
    refit_gain : chi-square of two steps below which a refit ends
    promised : of the score: a refit that brings less may have begun at the wrong place
    start_shares : parts of the linear estimate from which a refit starts, in turn
    eased_weight, eased_radius : factors on the inclusions of an eased map, from which a shape that
        was fitted wrongly finds back
    far_map : scaled coordinate of the map (a logarithm, or a body size) beyond which the finer
        model corrects otherwise and the refit is continued
    correction_doubt : factor on the difference between two courses of the finer model's correction
        by which it may be off, where a refit from the better one is to be spared
    behind_chi2, behind_share : chi-square, and share of the best improvement, by which a candidate
        is beaten. A true effect has come from behind by 130 once the finer model corrected its map
    lagging_share : of the best improvement: no candidate has caught up with more in a continued
        refit
    error_rise : factor on the rms residual up to which a refit counts as no rise of it
    foretold_rise : factor on the error of presses left out, up to which an effect may raise it: in
        71 steps of 56 right answers it always fell
    foretold_rise_beside_field : the same beside a free map, whose search may not have ended: a true
        creep raised it from 84 to 121 um there, a skin at two bounds from 73 to 1370 um
    predicted_share : of the decrease of chi-square: required of the predicted travel alone where
        the rms residual rises
    first_evaluations : of the first step from the contact law
    of_lead : share of what follows a simple law of the residual that an effect must take, where the
        law is gone beside it
    elsewhere : of the unexplained chi-square: share outside the outlying presses below which these
        may have hidden the explanation of the others; what each press with a compliance of its own
        must leave of it to exclude every map; what one effect must take of it to be sought beside
        a map that has an error of its own; and what presses found to stand apart, too, must hold
    meets_presses : chi-square of the middle press over that of noise, each on a body of any kind,
        up to which the effects of a contact law stand beside a structured residual: 0.98 to 1.04
        with the touch of measured scans, 1.18 and 1.19 with effects that imitate a sticky tip
    rough : relative error of a free map in each press's compliance beyond which it is no error of
        its form
    diagnosis, residual, cross_validation : of the analysis of each step. Of a hundred scans with
        nothing hidden, one has a residual beyond the level of its tests: that a cause is missing is
        said from `sure` on, as the name of one
    """

    most_effects: int = 4
    trace: float = 0.02
    of_laws: float = 0.01
    nearly_noise: float = 1.2
    imitated: float = 0.05
    worthwhile: float = 0.1
    third_worthwhile: float = 0.25
    left_of_error: float = 0.1
    mending: int = 4
    of_mend: float = 0.05
    of_left: float = 0.5
    alone: float = 0.9
    by_compliance: float = 0.9
    margin: float = 10.0
    followed: int = 2
    pairs: int = 3
    close: float = 5.0
    dear: float = 40.0
    whole_bound: float = 0.95
    together: float = 0.99
    sure: float = SURE
    shortlist: int = 3
    hopeless: float = 0.1
    same_family: float = 0.4
    refit_evaluations: int = 15
    refit_gain: float = 0.5
    promised: float = 0.3
    start_shares: tuple[float, ...] = (1.0, 0.3, 0.03)
    eased_weight: float = 0.35
    eased_radius: float = 1.3
    far_map: float = 0.3
    correction_doubt: float = 3.0
    behind_chi2: float = 200.0
    behind_share: float = 0.5
    lagging_share: float = 0.2
    error_rise: float = 1.002
    foretold_rise: float = 1.05
    foretold_rise_beside_field: float = 3.0
    predicted_share: float = 0.5
    first_evaluations: int = 40
    of_lead: float = 0.5
    elsewhere: float = 0.5
    meets_presses: float = 1.1
    rough: float = 0.01
    diagnosis: DiagnosisSettings = DIAGNOSIS
    residual: ResidualSettings = BESIDE_EFFECTS
    cross_validation: CrossValidationSettings = CROSS_VALIDATION


SELECTION = SelectionSettings()
