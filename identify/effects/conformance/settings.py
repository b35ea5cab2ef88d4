"""Tolerances of the conformance kit."""

from dataclasses import dataclass


@dataclass(frozen=True)
class ConformanceSettings:
    """Tolerances of `identify.effects.conformance.kit` and `identify.select.plant_and_recover`.

    Attributes
    ----------
    rounding : deviation from the identity, relative to the largest number
    least_change : change of some reading by half a typical size, relative to the largest number
    example : relative agreement of worked examples
    near : cosine of neighbouring candidates' patterns
    gaps : share of neighbours that may be further apart, if candidates are left out
    candidates : of a long grid, for the checks of the hook
    planted_sigmas : standard errors of a planted effect, if its bounds leave room
    score_p : largest p-value of the score of a planted effect
    recovered_sigmas, recovered_share : deviation of the recovered amplitude, in standard errors, or
        relative to the planted one: the law may bend over so many standard errors
    """

    rounding: float = 1e-12
    least_change: float = 1e-6
    example: float = 1e-4
    near: float = 0.8
    gaps: float = 0.05
    candidates: int = 40
    planted_sigmas: float = 15.0
    score_p: float = 1e-3
    recovered_sigmas: float = 5.0
    recovered_share: float = 0.1


CONFORMANCE = ConformanceSettings()
