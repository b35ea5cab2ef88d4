"""The misfit of a scan, both of whose columns are noisy, from a few numbers a press.

A row's displacement d and force F carry noise of sd_d and sd_F. With the compliance C of its press
the residual is e = d - C F, with variance s^2 = sd_d^2 + C^2 sd_F^2, and the best estimate of the
true force is the latent force

    F^ = F + (C sd_F^2 / s^2) e

The misfit sum e^2 / s^2 is the likelihood of the straight line with errors in both columns, the
unknown true forces eliminated, and its exact derivative is that at the latent force:

    d(e / s)/dC = -F^ / s

Taking F for the true force instead attenuates the slope and fabricates structure.
Source: Fuller, "Measurement Error Models", section 1.3 (functional model, known variances).

As e and F^ are linear in the two columns (d, F), the rows of a press may be turned by any rotation
without changing the misfit. The triangular factor of each press's (rows, 2) table (two rows)
therefore holds the information of a thousand samples, and an iteration does not depend on their
number.
"""

from dataclasses import dataclass

import numpy as np

from identify.measurement.noise import Noise


@dataclass(frozen=True)
class PressTable:
    """Each press's rows compressed to two: `displacement` (j, 2) m and `force` (j, 2) N.

    `rows` is the number of rows m behind them.
    """

    displacement: np.ndarray
    force: np.ndarray
    rows: int

    @property
    def slope(self) -> np.ndarray:
        """Compliance (j,) of each press alone, m/N (least squares of d against F)."""
        return np.sum(self.force * self.displacement, axis=1) / np.sum(self.force**2, axis=1)

    def residuals(self, compliance: np.ndarray, noise: Noise) -> tuple[np.ndarray, np.ndarray]:
        """Whitened residuals (j, 2) and their derivative (j, 2) by the compliance (j,)."""
        e, s, latent = whitening(self.displacement, self.force, compliance[:, None], noise)
        return e / s, -latent / s

    def common_factor(self, compliance: np.ndarray, noise: Noise) -> float:
        """Return the factor on all moduli with which compliances (j,) fit the presses best."""
        slope = self.slope
        precision = np.sum(self.force**2, axis=1) / (
            noise.displacement_m**2 + (slope * noise.force_n) ** 2
        )
        return float(np.sum(precision * compliance**2) / np.sum(precision * compliance * slope))

    def dof(self, parameters: int) -> int:
        """Degrees of freedom: rows less so many free parameters, at least one."""
        return max(self.rows - parameters, 1)

    def rms(self, compliance: np.ndarray) -> float:
        """Root mean square of d - C F over the m rows, m."""
        e = self.displacement - compliance[:, None] * self.force
        return float(np.sqrt(np.sum(e**2) / self.rows))


def press_table(
    press_index: np.ndarray, displacement_m: np.ndarray, force_n: np.ndarray, presses: int
) -> PressTable:
    """Compress rows (m,) to two a press by the triangular factor of [F d]."""
    force, displacement = np.zeros((presses, 2)), np.zeros((presses, 2))
    order = np.argsort(press_index, kind="stable")
    ends = np.cumsum(np.bincount(press_index, minlength=presses))[:-1]
    for j, rows in enumerate(np.split(order, ends)):
        columns = np.column_stack([force_n[rows], displacement_m[rows]])
        factor = np.asarray(np.linalg.qr(columns, mode="r"))
        force[j, : len(factor)] = factor[:, 0]
        displacement[j, : len(factor)] = factor[:, 1]
    for array in (force, displacement):
        array.setflags(write=False)
    return PressTable(displacement, force, len(press_index))


def whitening(
    displacement: np.ndarray, force: np.ndarray, compliance: np.ndarray, noise: Noise
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return residual e (m), its standard deviation s (m) and the latent force F^ (N).

    The arrays broadcast; `compliance` is that of the row's press, m/N.
    """
    e = displacement - compliance * force
    variance = noise.displacement_m**2 + (compliance * noise.force_n) ** 2
    latent = force + compliance * noise.force_n**2 / variance * e
    return e, np.sqrt(variance) * np.ones_like(e), latent
