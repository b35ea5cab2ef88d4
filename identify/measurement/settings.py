"""Tuning numbers of the measurement model."""

from dataclasses import dataclass


@dataclass(frozen=True)
class NoiseSettings:
    """Settings of the noise estimate (`identify.measurement.noise`).

    Attributes
    ----------
    least_differences : third differences, below which the noise is not estimated
    floor : least noise, relative to the rms of the column
    motion_sigmas : standard errors of the covariance of both columns beyond which common motion is
        subtracted
    """

    least_differences: int = 8
    floor: float = 1e-6
    motion_sigmas: float = 3.0


NOISE = NoiseSettings()


@dataclass(frozen=True)
class LatentForceSettings:
    """Settings of the latent force (`identify.measurement.chain.judge`).

    Attributes
    ----------
    steepest : largest slope of travel over force, in compliances, with which the noise of the force
        is counted: a law that turns a little force into any displacement would explain everything
    rounds : of the latent force, if travel and force are not proportional
    tol : change of the latent force, relative to the largest force, that ends the rounds
    """

    steepest: float = 2.0
    rounds: int = 6
    tol: float = 1e-3


LATENT_FORCE = LatentForceSettings()


@dataclass(frozen=True)
class TouchSettings:
    """Settings of the error of first touch.

    Attributes
    ----------
    common_share : standard deviation of the error that all presses share, relative to that of one
        press alone: a robot takes the same law of contact in all (scans of an organ by balls of 3
        and 8 mm: means of 0.3 to 1.2 of the stated standard deviation, 0.2 by the ball's own law)
    """

    common_share: float = 0.5


TOUCH = TouchSettings()
