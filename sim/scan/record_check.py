"""Checks of a finished press's samples: its clock, its force and travel, its first touch."""

from __future__ import annotations

import numpy as np

from sim.motion.settings import ScanSettings
from sim.scan.outcome import PressFault
from sim.scan.watchdog import LEAST_NOISE_N, NOISE_STEPS

BEFORE_CONTACT = 0.6
"""Of the travel that is read, between first touch and the first reading: 0.1 on a line, 0.3 where
the force rises with its square."""


def check_record(
    time_s: np.ndarray,
    force_n: np.ndarray,
    depth_m: np.ndarray,
    set_force_n: float,
    settings: ScanSettings,
) -> None:
    """Check the samples of a finished press.

    Parameters
    ----------
    time_s : (t,) as written, from the begin of the approach to the end of the retreat
    force_n, depth_m : force and depth along the press in contact
    set_force_n : wanted force

    Raises
    ------
    PressFault
        A clock that does not run evenly, a force or a travel that jumps.
    """
    step = np.diff(time_s)
    if not ((step > 0.2 * settings.timestep_s) & (step < 5 * settings.timestep_s)).all():
        raise PressFault(
            "clock",
            f"the written times go on by {step.min():.3g} to {step.max():.3g} s from sample to "
            f"sample, {settings.timestep_s:g} s is the period",
        )
    change = np.abs(np.diff(force_n))
    noise = max(settings.force_noise_n, LEAST_NOISE_N)
    allowed = NOISE_STEPS * np.sqrt(2) * noise + 0.05 * set_force_n
    if change.max() > allowed:
        raise PressFault(
            "jump",
            f"the force jumps by {change.max():.3g} N from one sample to the next, at most "
            f"{allowed:.3g} N are noise and motion",
        )
    jump = np.abs(np.diff(depth_m)).max()
    allowed_m = NOISE_STEPS * np.sqrt(2) * settings.displacement_noise_m + 1e-3
    if jump > allowed_m:
        raise PressFault(
            "encoders",
            f"the travel jumps by {1e3 * jump:.3g} mm from one sample to the next, at most "
            f"{1e3 * allowed_m:.3g} mm are noise and motion",
        )


def check_touch(touch_m: float, depth_m: np.ndarray) -> None:
    """Check that the first touch lies where the readings in contact, (t,) m deep, lead back to.

    Raises
    ------
    PressFault
        It lies far before the shallowest of them.
    """
    before, usual = float(depth_m.min()) - touch_m, 1e-4 + BEFORE_CONTACT * float(np.ptp(depth_m))
    if before > usual:
        raise PressFault(
            "touch",
            f"the readings lead back to a touch {1e3 * before:.2g} mm before the first of them, at "
            f"most {1e3 * usual:.2g} mm are usual: the body has moved meanwhile",
        )
