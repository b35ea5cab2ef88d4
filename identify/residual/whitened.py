"""The residual of a fit in units of its noise, at the best estimate of the true force.

Both columns of a scan are noisy: e = d - C F has the variance s^2 = sd_d^2 + C^2 sd_F^2, and
r = e / s is N(0, 1) if the model is right.  The measured F and r are correlated (sorted by F, pure
noise shows a slope), the latent force F^ = F + (C sd_F^2 / s^2) e and r are independent.  All
comparisons of residuals at different forces, and all derivatives, therefore take F^.
"""

from dataclasses import dataclass

import numpy as np

from identify.effects.readings import Readings
from identify.fit.result import FitResult
from identify.measurement import Noise
from identify.measurement.settings import TOUCH
from identify.measurement.shared_error import SharedErrors, lag_error_m
from models import InputError, Scan


@dataclass(frozen=True)
class Whitened:
    """Readings of a scan with their residual and the directions that the fit absorbs.

    Attributes
    ----------
    scan : Scan
        The m readings that the fit used.
    residual_m : (m,)
        Measured less modelled displacement, m; positive for a softer body.
    sigma_m : (m,)
        Standard deviation of the residual under noise alone, m.
    force_n : (m,)
        Best estimate F^ of the true force, N.
    absorbed : (m, k)
        Derivatives of the modelled displacement by the fitted parameters at F^, over sigma.
    shared : SharedErrors, optional
        Errors of first touch and of the lag, over sigma, which readings share.
    noise_estimated : bool
        The noise was estimated from this scan.
    size : (chi-square, degrees of freedom)
        Of the fit itself, where it is not that of the residual without the absorbed directions:
        beside a free map that of the readings about the prior's mean.
    shared_m : float
        Standard deviation (rms) of the errors that readings share: of first touch and of the lag.
    """

    scan: Scan
    residual_m: np.ndarray
    sigma_m: np.ndarray
    force_n: np.ndarray
    absorbed: np.ndarray
    noise_estimated: bool
    size: tuple[float, int] | None = None
    shared_m: float = 0.0
    shared: SharedErrors | None = None

    def __post_init__(self) -> None:
        for array in (self.residual_m, self.sigma_m, self.force_n, self.absorbed):
            array.setflags(write=False)

    @property
    def whitened(self) -> np.ndarray:
        """Residual in standard deviations, (m,), the readings made independent."""
        return self.apart(self.residual_m / self.sigma_m)

    def apart(self, columns: np.ndarray) -> np.ndarray:
        """Return columns (m,) or (m, q) over sigma as readings without shared errors have them.

        A shared error counts with its standard deviation: projected out, it would hide any offset.
        """
        return columns if self.shared is None else self.shared.whitened(columns)

    @property
    def press_index(self) -> np.ndarray:
        """Press of each reading, 0..j-1, (m,)."""
        return self.scan.press_index

    @property
    def presses(self) -> int:
        """Number of presses j."""
        return len(self.scan.press_ids)

    @property
    def follows(self) -> np.ndarray:
        """Reading i follows reading i - 1 of the same press, (m,) bool."""
        follows = np.zeros(len(self.residual_m), dtype=bool)
        follows[1:] = self.press_index[1:] == self.press_index[:-1]
        return follows


def whitened(fit: FitResult, scan: Scan) -> Whitened:
    """Return the whitened residual of a fit.

    Parameters
    ----------
    fit : FitResult
        With the derivative of each press's compliance by the free parameters.
    scan : Scan
        The scan that was fitted; approach and retract rows are left out, as in the fit.

    Raises
    ------
    InputError
        The scan is not the one that was fitted.
    """
    rows = scan.used()
    if len(rows) != len(fit.force_n) or not (
        np.array_equal(rows.force_n, fit.force_n)
        and np.array_equal(rows.displacement_m, fit.displacement_m)
    ):
        raise InputError(
            f"the fit was made on another scan: it has {len(fit.force_n)} used rows, this scan "
            f"{len(rows)}, or their readings differ; fit this scan anew"
        )
    derivative, inside = fit.derivative_m, within_bounds(fit)
    if fit.field is not None:
        own = [] if derivative is None else [derivative[:, inside]]
        derivative = np.hstack([*own, fit.field.absorbed_m(rows.press_index)])
    elif derivative is None:
        by_map = fit.compliance_jacobian[:, inside]
        derivative = by_map[rows.press_index] * fit.latent_force_n[:, None]
    else:
        derivative = derivative[:, inside]
    shared, shared_m = shared_errors(fit.noise, Readings.of(rows), rows.displacement_m, fit.sigma_m)
    return Whitened(
        scan=rows,
        residual_m=fit.residual_m,
        sigma_m=fit.sigma_m,
        force_n=fit.latent_force_n,
        absorbed=derivative / fit.sigma_m[:, None],
        noise_estimated=fit.noise.estimated,
        size=None if fit.field is None else (fit.chi2, fit.dof),
        shared_m=shared_m,
        shared=shared,
    )


def within_bounds(fit: FitResult) -> np.ndarray:
    """Fitted parameters (k,) bool that no bound of the search holds.

    What one beyond its bound would explain is left in the residual.
    """
    return np.array([name not in fit.at_bound for name in fit.covariance_names], bool)


def shared_errors(
    noise: Noise, readings: Readings, displacement_m: np.ndarray, sigma_m: np.ndarray
) -> tuple[SharedErrors | None, float]:
    """Return the errors of first touch and lag that readings share, and their rms in m.

    What they shift is no structure of a residual. None where the noise has no such errors.
    """
    if not (noise.touch_m or noise.lag_s):
        return None, 0.0
    lag_m = lag_error_m(noise, readings, displacement_m)
    touch_m = np.full_like(sigma_m, noise.touch_m)
    common = np.column_stack([TOUCH.common_share * touch_m, lag_m])
    shared = SharedErrors.of(
        touch_m[:, None] / sigma_m[:, None], common / sigma_m[:, None], readings.press
    )
    return shared, float(np.sqrt(noise.touch_m**2 + np.mean(lag_m**2)))
