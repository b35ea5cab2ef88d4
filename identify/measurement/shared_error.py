"""Errors that readings share: of the map, of the depth of first touch, and of the channels' lag.

Beside their noise the whitened readings of a press then have the covariance I + E E', where E has
a column for each shared error.
"""

from dataclasses import dataclass

import numpy as np

from identify.effects.readings import Readings
from identify.effects.smooth import LocalLines
from identify.measurement.noise import Noise


@dataclass(frozen=True)
class SharedErrors:
    """Change of whitened readings by one standard deviation of each error that they share.

    Attributes
    ----------
    own : (m, r) of errors that the readings of a press share
    common : (m, s) of those that all share, made independent of `own`
    press : (m,) index of each reading's press
    """

    own: np.ndarray
    common: np.ndarray
    press: np.ndarray

    @classmethod
    def of(cls, own: np.ndarray, common: np.ndarray, press: np.ndarray) -> "SharedErrors":
        """Make the errors that all share independent of those of a press."""
        return cls(own, decorrelated(common, own, press), press)

    def whitened(self, x: np.ndarray) -> np.ndarray:
        """Make readings (m,) or (m, k), whitened by their noise alone, independent."""
        return decorrelated(decorrelated(x, self.own, self.press), self.common, 0 * self.press)

    def transposed(self, x: np.ndarray) -> np.ndarray:
        """Apply the transpose of `whitened`."""
        return decorrelated(decorrelated(x, self.common, 0 * self.press), self.own, self.press)


def decorrelated(x: np.ndarray, errors: np.ndarray, press: np.ndarray) -> np.ndarray:
    """Apply the inverse root of I + E E', press by press.

    Parameters
    ----------
    x : (m,) or (m, k) whitened by the noise
    errors : (m, r) whitened readings' change by one standard deviation of each shared error
    press : (m,) index of each reading's press
    """
    return _scaled_along(x, errors, press, -0.5)


def correlated(x: np.ndarray, errors: np.ndarray, press: np.ndarray) -> np.ndarray:
    """Undo `decorrelated`.

    >>> x, press = np.array([1.0, 2.0, 3.0]), np.array([0, 0, 1])
    >>> errors = np.array([[0.5, 1.0], [1.0, 1.0], [2.0, 1.0]])
    >>> correlated(decorrelated(x, errors, press), errors, press).round(9)
    array([1., 2., 3.])
    """
    return _scaled_along(x, errors, press, 0.5)


def lag_error_m(noise: Noise, readings: Readings, displacement_m: np.ndarray) -> np.ndarray:
    """Return the change (m,) of the travel by one standard deviation of the lag, m.

    Travel and force then belong to different instants: the travel is off by the lag times the
    tip's speed, and so is the first touch where travel counts from it.
    """
    if not noise.lag_s:
        return np.zeros(len(readings))
    press = readings.press
    within = readings.timed_s - readings.timed_s[readings.first][press]
    speed = LocalLines(readings.run, within, displacement_m, readings.sampling_step_s).slopes()
    at_touch = 0.0 if readings.travel_from == "plane" else speed[readings.first][press]
    return noise.lag_s * (speed - at_touch)


def _scaled_along(x: np.ndarray, errors: np.ndarray, press: np.ndarray, power: float) -> np.ndarray:
    """Multiply x by (I + E E')^power, press by press: I + E V ((1 + w)^power - 1)/w V' E'.

    w and V are the eigenvalues and eigenvectors of E'E.
    """
    errors = errors[:, np.any(errors != 0, axis=0)]
    if not (errors.size and x.size):
        return x
    square = _sums(errors[:, :, None] * errors[:, None, :], press)
    value, vector = np.linalg.eigh(square)
    value = np.maximum(value, 1e-300)
    gain = (vector * (np.expm1(power * np.log1p(value)) / value)[:, None, :]) @ np.swapaxes(
        vector, 1, 2
    )
    wide = x if x.ndim == 2 else x[:, None]
    along = gain @ _sums(errors[:, :, None] * wide[:, None, :], press)
    return (wide + np.einsum("mr,mrk->mk", errors, along[press])).reshape(x.shape)


def _sums(values: np.ndarray, press: np.ndarray) -> np.ndarray:
    """Return the sums over each press of values (m, r, k), (j, r, k)."""
    flat = values.reshape(len(values), -1)
    sums = np.column_stack([np.bincount(press, column) for column in flat.T])
    return sums.reshape(-1, *values.shape[1:])
