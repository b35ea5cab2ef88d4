"""The residual of each press: its level, its misfit in sigma, its pull on the fitted parameters."""

from dataclasses import dataclass

import numpy as np
from scipy import special

from identify.residual.directions import common, with_gain
from identify.residual.hypothesis_tests import (
    Alikeness,
    TestOutcome,
    extended,
    moran_test,
    orthonormal,
    project_out,
    score,
)
from identify.residual.settings import RESIDUAL, ResidualSettings
from identify.residual.trimmed import outlying
from identify.residual.whitened import Whitened

LARGEST_SIGMAS = 37.0  # beyond, the p-value is below the smallest floating-point number


@dataclass(frozen=True)
class PressResidual:
    """Residual of one press.

    `mean_m` is the weighted mean residual (m) with its standard error `mean_error_m`;
    `softer` the relative excess of the measured over the modelled compliance; `misfit` ~ chi2(2)
    under noise (level and slope), `sigmas` the same as a normal deviate; `influence` the largest
    shift of a fitted parameter, in its standard deviations, when the press is left out.
    """

    press: int
    point_m: tuple[float, float, float]
    readings: int
    mean_m: float
    mean_error_m: float
    softer: float
    misfit: float
    sigmas: float
    influence: float
    bad: bool


class PressSpace:
    """Level and slope of every press as orthonormal directions, beyond a nuisance basis.

    Attributes
    ----------
    values : (2 j,)
        Whitened residual along them.
    covariance : (2 j, 2 j)
        Their covariance under noise: the identity less the part along the nuisance.
    """

    def __init__(self, w: Whitened, nuisance: np.ndarray) -> None:
        self.press_index, self.presses = w.press_index, w.presses
        level = self._normalised(1 / w.sigma_m)
        slope = w.force_n / w.sigma_m
        raw = np.sqrt(self._sum(slope**2))
        slope = slope - level * self._sum(level * slope)[w.press_index]
        own = np.sqrt(self._sum(slope**2)) > 1e-6 * raw  # else a press at one single force
        slope = self._normalised(slope) * own[w.press_index]
        self.level, self.slope = level, slope
        residual = project_out(nuisance, w.whitened)
        seen = np.vstack(
            [self._sum(level[:, None] * nuisance), self._sum(slope[:, None] * nuisance)]
        )
        present = np.concatenate([np.ones(w.presses), own.astype(float)])
        self.values = np.concatenate([self._sum(level * residual), self._sum(slope * residual)])
        self.covariance = np.diag(present) - seen @ seen.T
        self.directions = int(present.sum())

    def _sum(self, rows: np.ndarray) -> np.ndarray:
        out = np.zeros((self.presses, *rows.shape[1:]))
        np.add.at(out, self.press_index, rows)
        return out

    def _normalised(self, rows: np.ndarray) -> np.ndarray:
        length = np.sqrt(self._sum(rows**2))
        return rows / np.where(length > 0, length, 1.0)[self.press_index]

    def omnibus(self, residual: np.ndarray, nuisance: np.ndarray) -> TestOutcome:
        """Score test of all levels and slopes at once, beyond the nuisance in them."""
        explained = self._explained(residual)
        outside = nuisance - self._fitted(nuisance)
        lengths = np.ones(nuisance.shape[1])
        extra = orthonormal(outside, lengths)
        statistic = (
            explained + np.sum((extra.T @ residual) ** 2) - np.sum((nuisance.T @ residual) ** 2)
        )
        return score(statistic, self.directions + extra.shape[1] - nuisance.shape[1])

    def _fitted(self, columns: np.ndarray) -> np.ndarray:
        level, slope = self.level[:, None], self.slope[:, None]
        index = self.press_index
        return level * self._sum(level * columns)[index] + slope * self._sum(slope * columns)[index]

    def _explained(self, residual: np.ndarray) -> float:
        parts = self._sum(self.level * residual), self._sum(self.slope * residual)
        return float(sum(np.sum(p**2) for p in parts))

    def block(self, press: int) -> np.ndarray:
        """Return the indices of a press's level and slope among the directions."""
        return np.array([press, press + self.presses])

    def misfits(self) -> np.ndarray:
        """chi2(2) of each press on its own, (j,)."""
        at = np.column_stack([self.block(j) for j in range(self.presses)]).T
        blocks = self.covariance[at[:, :, None], at[:, None, :]]
        inverse = np.linalg.pinv(blocks, rcond=1e-6, hermitian=True)
        return np.einsum("ja,jab,jb->j", self.values[at], inverse, self.values[at])

    def without(self, press: int) -> None:
        """Add the directions of a press to the nuisance, as if the press were left out."""
        at = self.block(press)
        inverse = np.linalg.pinv(self.covariance[np.ix_(at, at)], rcond=1e-6, hermitian=True)
        gain = self.covariance[:, at] @ inverse
        self.values = self.values - gain @ self.values[at]
        self.covariance = self.covariance - gain @ self.covariance[at]

    def alikeness(self, neighbours: np.ndarray) -> Alikeness:
        """Moran's I of the levels for symmetric neighbour weights (j, j)."""
        j = self.presses
        return moran_test(self.values[:j], self.covariance[:j, :j], neighbours)


def bad_presses(
    w: Whitened, smooth: np.ndarray, scale: float, settings: ResidualSettings = RESIDUAL
) -> list[int]:
    """Outlying presses beyond all smooth patterns, worst first (indices).

    Parameters
    ----------
    w : Whitened
        The residual.
    smooth : (m, q)
        Orthonormal basis of the smooth patterns.
    scale : float
        Standard deviations of the noise in units of `w.sigma_m`.
    settings : ResidualSettings
        `alpha` is the probability of naming any press under noise.

    Notes
    -----
    Presses apart from a map that meets the others are tested each without the others of them:
    together they pull the fit along, and others would be named. Where a smooth pattern takes them
    all, a spot that the map lacks, and without any, the others are tested: the worst press is set
    aside before the next, else it would pull its neighbours along.
    """
    apart, outliers = _apart(w, smooth, scale, settings)
    if outliers:
        return outliers
    space = PressSpace(w, smooth)
    for press in apart:
        space.without(press)
    most = min(settings.most_outlying_presses, w.presses // settings.presses_per_outlier)
    while len(outliers) < most:
        misfits = space.misfits()
        worst = int(np.argmax(misfits))
        if special.chdtrc(2, misfits[worst] / scale**2) * w.presses > settings.alpha:
            break
        outliers.append(worst)
        space.without(worst)
    return outliers


def _apart(
    w: Whitened, smooth: np.ndarray, scale: float, settings: ResidualSettings
) -> tuple[list[int], list[int]]:
    """Presses apart from the map, and those beyond all smooth patterns, too, worst first."""
    if w.size is not None:  # a free map bends to single presses
        return [], []
    own = (w.scan.displacement_m - w.residual_m) / w.sigma_m
    apart = outlying(w.press_index, w.apart(own), w.whitened, w.apart(w.absorbed), settings.trimmed)
    misfits = {}
    for press in apart:
        space = PressSpace(w, smooth)
        for other in apart[apart != press]:
            space.without(int(other))
        misfits[int(press)] = float(space.misfits()[press]) / scale**2
    sure = [p for p, m in misfits.items() if special.chdtrc(2, m) * w.presses < settings.alpha]
    return [*misfits], sorted(sure, key=lambda press: -misfits[press])


def press_directions(w: Whitened, presses: list[int]) -> np.ndarray:
    """Offset and gain of each of some presses, (m, 2 q)."""
    return w.apart(with_gain(w, (w.press_index[:, None] == np.array(presses)).astype(float)))


def press_residuals(w: Whitened, absorbed: np.ndarray, bad: list[int]) -> tuple[PressResidual, ...]:
    """Every press's residual, in the order of the scan's press ids.

    Parameters
    ----------
    w : Whitened
        The residual.
    absorbed : (m, k)
        Orthonormal basis of the fitted parameters' derivatives.
    bad : list of int
        Indices of the outlying presses.
    """
    space = PressSpace(w, extended(absorbed, w.apart(common(w))))
    misfits = space.misfits()
    pull = influences(w, absorbed)
    weight = 1 / w.sigma_m**2
    index, j = w.press_index, w.presses
    total = np.bincount(index, weight, j)
    mean = np.bincount(index, weight * w.residual_m, j) / total
    moment = np.bincount(index, weight * w.force_n**2, j)
    modelled = w.scan.displacement_m - w.residual_m
    product = np.bincount(index, weight * w.force_n * w.residual_m, j)
    stiffness = np.bincount(index, weight * w.force_n * modelled, j) / moment
    points = w.scan.contact_points
    sigmas = -special.ndtri(np.maximum(special.chdtrc(2, misfits), 1e-300) / 2)
    return tuple(
        PressResidual(
            press=int(press),
            point_m=(float(points[i, 0]), float(points[i, 1]), float(points[i, 2])),
            readings=int(np.sum(index == i)),
            mean_m=float(mean[i]),
            mean_error_m=float(1 / np.sqrt(total[i])),
            softer=float(product[i] / moment[i] / stiffness[i]),
            misfit=float(misfits[i]),
            sigmas=float(sigmas[i]),
            influence=float(pull[i]),
            bad=i in bad,
        )
        for i, press in enumerate(w.scan.press_ids)
    )


def influences(w: Whitened, absorbed: np.ndarray) -> np.ndarray:
    """Length of the parameters' shift in standard deviations when a press is left out, (j,).

    With the whitened Jacobian's orthonormal basis Q, leaving out the rows of press j shifts the
    fitted coordinates by (I - Q_j' Q_j)^-1 Q_j' r_j = Q_j' (I - Q_j Q_j')^-1 r_j: one solve of the
    size of a press, no refit.
    """
    pull = np.zeros(w.presses)
    residual = project_out(absorbed, w.whitened)
    for j in range(w.presses):
        rows = w.press_index == j
        q = absorbed[rows]
        own = np.linalg.lstsq(np.eye(len(q)) - q @ q.T, residual[rows], rcond=None)[0]
        pull[j] = np.linalg.norm(q.T @ own)
    return pull
