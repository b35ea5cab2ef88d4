"""Tuning numbers of detection limits, confounders and planned scans."""

from dataclasses import dataclass

from identify.select.settings import DIAGNOSIS


@dataclass(frozen=True)
class DetectionSettings:
    """Settings of `identify.design.detection_limits`; shares are of the signal's rms.

    Attributes
    ----------
    sigmas : standard errors of an amplitude at its detection limit
    largest_misfit : residual over noise of an unexplained scan from which on no limits are stated
    bias_share : size of an effect for which the bias of the map is stated
    candidates : of a shape's grid
    visible : length of a pattern beyond the fitted parameters, relative to the pattern or in
        standard errors, below which the map absorbs it
    tries : amplitudes until the pattern is `sigmas` long
    accuracy : relative, of that length
    far_map : scaled unknown beyond which the map is fitted to an effect, not projected: a ball's
        edge is then seen from 3.2 % of the signal on, not 1.9 %
    fit_steps, longest_step : Gauss-Newton steps of such a fit, and their largest length
    slack : of the solutions by reduced bases (`BodyMechanics.evaluate`): compliances within 1e-3
    far_signal : size beyond which the linear pattern is accurate enough
    alike : cosine of two patterns above which their effects cannot be distinguished
    clearly_smaller : detection limit of a better scan, relative to the present one
    """

    sigmas: float = 5.0
    largest_misfit: float = 2.0
    bias_share: float = 0.03
    candidates: int = 12
    visible: float = 1e-5
    tries: int = 8
    accuracy: float = 0.1
    far_map: float = 0.1
    fit_steps: int = 4
    longest_step: float = 0.5
    slack: float = 100.0
    far_signal: float = 0.5
    alike: float = DIAGNOSIS.alike
    clearly_smaller: float = 0.7


DETECTION = DetectionSettings()


@dataclass(frozen=True)
class ConfounderSettings:
    """Settings of `geometry_confounders`.

    Attributes
    ----------
    largest_change : relative change of a length; a larger one is no slip of the study
    as_good : share of the decrease of chi-square by the effect
    """

    largest_change: float = 0.3
    as_good: float = 0.9


CONFOUNDERS = ConfounderSettings()


@dataclass(frozen=True)
class PlanSettings:
    """Settings of planned scans (`next_presses`, `scan_variants`).

    Attributes
    ----------
    needed : discrimination, in chi-square, that separates two effects beyond doubt
    aim : discrimination of a reduced design; it may come out at half, and scatters by 2 sqrt(D)
    fewest : presses of a reduced design, so that one slip does not decide
    pause_s : shortest and longest rest before a press
    between_scans_s : rest between two scans of one body, to change the tip
    radii : of a scan with two tips, in units of the present tip
    forces : peak forces of a scan with two, in units of the present ones, where these are borne
    slower : factor on holds and ramps of longer ones
    repeated : presses that are repeated at the end
    most : presses of a further scan; after a longer one, that many of its places, evenly
    """

    needed: float = 25.0
    aim: float = 50.0
    fewest: int = 9
    pause_s: tuple[float, float] = (0.1, 1.0)
    between_scans_s: float = 60.0
    radii: tuple[float, float] = (0.6, 2.0)
    forces: tuple[float, float] = (0.5, 1.5)
    slower: float = 4.0
    repeated: int = 9
    most: int = 150


PLAN = PlanSettings()
