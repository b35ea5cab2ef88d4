"""Thresholds of the residual analysis."""

from dataclasses import dataclass


@dataclass(frozen=True)
class TrimmedSettings:
    """Settings of the least trimmed squares (`identify.residual.trimmed`).

    Attributes
    ----------
    kept : share of the presses whose errors are minimised; the others may be anything
    starts : random sets of as few presses as determine the unknowns
    steps, last_steps : concentrations of each set, and of the best one
    sigmas : error of an outlying press, over the scale of all; one in 150,000 is noise
    scale : largest scale of the others' errors, over the noise: beyond it they are not met either
    unknowns : most of them, as a share of the presses
    """

    kept: float = 0.8
    starts: int = 500
    steps: int = 3
    last_steps: int = 20
    sigmas: float = 4.5
    scale: float = 3.0
    unknowns: float = 0.5


TRIMMED = TrimmedSettings()


@dataclass(frozen=True)
class LawErrorSettings:
    """Settings of the error of a fit's laws in a prediction (`identify.residual.law_error`).

    Measured on scans cut at a depth and predicted beyond it: docs/real_measurements.md.

    Attributes
    ----------
    least_reach : smallest share of a press's depth that is taken as its shallow part
    deep : share of a press's depth from which on its readings are deep, where nothing is cut
    uneven : part of a common error of the laws that may differ from press to press; with none,
        two of eight such predictions had bands that were too narrow
    neighbours : nearest presses by which the unevenness of a place is told
    tail : degrees of freedom of Student's t, by which single presses count less
    least_size, largest_size, sizes : errors of the laws that are tried, as shares of the travel
    told : largest error of ln C by the shallow readings of a press that predicts its deep ones
    """

    least_reach: float = 0.35
    deep: float = 0.8
    uneven: float = 0.5
    neighbours: int = 6
    tail: float = 4.0
    least_size: float = 2e-3
    largest_size: float = 1.0
    sizes: int = 40
    told: float = 0.3


LAW_ERROR = LawErrorSettings()


@dataclass(frozen=True)
class ResidualSettings:
    """Levels, sample sizes and thresholds of `identify.residual.compare`.

    Attributes
    ----------
    alpha : family-wise error of the tests under pure noise
    structure : family-wise p-value below which the residual is not noise; the selection of effects
        asks for less than `alpha`
    bins : largest number of bins of force, and of time
    neighbours : nearest presses of each press in Moran's I
    least_presses, least_trend_presses : for a pattern over places, and for a trend in their order
    patterns : largest number of smooth patterns over places
    least_pairs : pairs of consecutive readings for the lag-1 correlation
    least_differences : second differences for the reading-to-reading scatter
    scatter_sigmas : standard errors beyond which this scatter replaces the noise given
    independent_share : independent numbers per degree of freedom of an estimated noise, which comes
        from third differences
    main_share : share of the excess chi-square that a main direction takes at least
    further_share : chi-square of a further direction, relative to the main one
    most_outlying_presses : largest number of outlying presses; more are no matter of single presses
    presses_per_outlier : presses in the scan for each outlying one
    most_outlying_readings : largest number of outlying readings
    trimmed : of the presses apart from a map that meets the others
    law_share : share of the excess chi-square that a simple law surely takes. Creep is a lag of the
        displacement to 75 %, a force that is read late to 96 to 98 %
    """

    alpha: float = 0.01
    structure: float = 0.01
    bins: int = 8
    neighbours: int = 6
    least_presses: int = 9
    least_trend_presses: int = 8
    patterns: int = 12
    least_pairs: int = 20
    least_differences: int = 30
    scatter_sigmas: float = 3.5
    independent_share: float = 0.4
    main_share: float = 0.2
    further_share: float = 0.1
    most_outlying_presses: int = 12
    presses_per_outlier: int = 5
    most_outlying_readings: int = 20
    trimmed: TrimmedSettings = TRIMMED
    law_share: float = 0.85


RESIDUAL = ResidualSettings()
