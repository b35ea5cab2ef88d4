"""Tests of a whitened residual for structure.

All tests take a residual r ~ N(0, I) (m,) with the derivatives N (m, k) by the fitted parameters
projected out, because a fit hides any structure along them:

    score test   S = r' A_p (A_p' A_p)^-1 A_p' r ~ chi2(rank A_p),  A_p = A - N (N'N)^-1 N' A
    Moran's I    I = z'Wz / z'z of centred group means z, tail by the saddlepoint of
                 Tiefelsdorf (2002), Geographical Analysis 34(3), exact covariance of z
    lag-1        r'Lr with its exact mean and variance under the projection
    Holm         step-down adjustment over all tests (Holm 1979)
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import optimize, special
from scipy.spatial import KDTree

RANK_TOLERANCE = 1e-6
"""Directions with a smaller share beyond the projection count as absorbed."""


@dataclass(frozen=True)
class TestOutcome:
    """Outcome of a score test: `statistic` ~ chi2(`dof`) under noise alone."""

    statistic: float
    dof: int
    p_value: float


def orthonormal(columns: np.ndarray, reference: np.ndarray | None = None) -> np.ndarray:
    """Orthonormal basis (m, r) of the columns (m, q), dependent ones left out.

    Parameters
    ----------
    columns : (m, q)
        The columns, in any units: each is scaled to the length 1 first.
    reference : (q,), optional
        Lengths of the columns before a projection; a column with less than `RANK_TOLERANCE` of it
        is left out.  Default: their own lengths.
    """
    lengths = np.linalg.norm(columns, axis=0) if reference is None else reference
    kept = lengths > 0
    if not kept.any():
        return np.empty((len(columns), 0))
    basis, singular, _ = np.linalg.svd(columns[:, kept] / lengths[kept], full_matrices=False)
    return basis[:, singular > RANK_TOLERANCE]


def project_out(basis: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Columns (m,) or (m, q) without their part along an orthonormal basis (m, r)."""
    return columns - basis @ (basis.T @ columns)


def extended(basis: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Orthonormal basis (m, r) of such a basis (m, k) and of further columns (m, q)."""
    left = project_out(basis, project_out(basis, columns))  # twice, against rounding
    return np.hstack([basis, orthonormal(left, np.linalg.norm(columns, axis=0))])


def score_test(residual: np.ndarray, directions: np.ndarray, nuisance: np.ndarray) -> TestOutcome:
    """Score test of the directions (m, q) after an orthonormal nuisance basis (m, k).

    Examples
    --------
    >>> r = np.array([3.0, 3.0, -3.0, -3.0])
    >>> score_test(r, np.array([[1.0], [1], [-1], [-1]]), np.full((4, 1), 0.5)).statistic
    36.0
    """
    lengths = np.linalg.norm(directions, axis=0)
    basis = orthonormal(project_out(nuisance, directions), lengths)
    statistic = float(np.sum((basis.T @ residual) ** 2))
    return score(statistic, basis.shape[1])


def score(statistic: float, dof: int) -> TestOutcome:
    """Score with its chi-square tail; no degree of freedom gives p = 1."""
    p_value = float(special.chdtrc(dof, statistic)) if dof > 0 else 1.0
    return TestOutcome(round(float(statistic), 9), dof, p_value)


def positive_probability(weights: np.ndarray) -> float:
    """P(sum_i w_i x_i^2 > 0) for independent standard normal x_i, by the saddlepoint.

    Parameters
    ----------
    weights : (q,)
        The eigenvalues of the quadratic form.

    Examples
    --------
    >>> round(positive_probability(np.array([1.0, 1.0, -1.0, -1.0])), 3)
    0.5
    """
    scale = np.max(np.abs(weights), initial=0.0)
    if scale == 0:
        return 1.0
    w = weights / scale
    if w.min() >= 0:
        return 1.0
    if w.max() <= 0:
        return 0.0
    low, high = 0.5 / w.min(), 0.5 / w.max()
    margin = 1e-10 * (high - low)

    def slope(t: float) -> float:
        return float(np.sum(w / (1 - 2 * t * w)))

    saddle = optimize.root_scalar(slope, bracket=(low + margin, high - margin), xtol=1e-14).root
    curvature = 2 * np.sum((w / (1 - 2 * saddle * w)) ** 2)
    root = np.sign(saddle) * np.sqrt(max(np.sum(np.log1p(-2 * saddle * w)), 0.0))
    if abs(root) < 1e-3:
        # The formula is 0/0 at the mean; its limit holds the skewness only.
        skewness = 8 * np.sum(w**3) / (2 * np.sum(w**2)) ** 1.5
        return float(0.5 - skewness / (6 * np.sqrt(2 * np.pi)))
    width = saddle * np.sqrt(curvature)
    return float(special.ndtr(np.log(root / width) / root - root))


@dataclass(frozen=True)
class Alikeness:
    """Likeness of neighbours: Moran's I, its expectation under noise, its one-sided p."""

    moran_i: float
    expected: float
    p_value: float


def moran_test(values: np.ndarray, covariance: np.ndarray, neighbours: np.ndarray) -> Alikeness:
    """Moran's I of group values with known covariance; large I says neighbours are alike.

    Parameters
    ----------
    values : (j,)
        One value a group (press), in units of the noise.
    covariance : (j, j)
        Their covariance under noise (the identity less the part absorbed by the fit).
    neighbours : (j, j)
        Symmetric weights, zero diagonal.
    """
    weights = neighbours * (len(values) / neighbours.sum())
    centred = values - values.mean()
    moran = float(centred @ weights @ centred / (centred @ centred))
    spread = covariance - covariance.mean(axis=0)
    spread = spread - spread.mean(axis=1)[:, None]
    power, vectors = np.linalg.eigh((spread + spread.T) / 2)
    root = vectors * np.sqrt(np.clip(power, 0.0, None))
    form = root.T @ weights @ root
    squares = root.T @ root
    expected = float(np.trace(form) / np.trace(squares))
    eigenvalues = np.linalg.eigvalsh(form - moran * squares)
    return Alikeness(moran, expected, positive_probability(eigenvalues))


def nearest_neighbours(points_m: np.ndarray, count: int = 6) -> np.ndarray:
    """Symmetric neighbour weights (j, j): 1 where both, 1/2 where one is among the nearest.

    Parameters
    ----------
    points_m : (j, 3)
        Contact points, m.
    count : int
        Neighbours of each point (itself excluded).
    """
    number = len(points_m)
    count = min(count, number - 1)
    _, nearest = KDTree(points_m).query(points_m, k=count + 1)
    weights = np.zeros((number, number))
    weights[np.repeat(np.arange(number), count + 1), np.ravel(nearest)] = 1.0
    np.fill_diagonal(weights, 0.0)
    return (weights + weights.T) / 2


@dataclass(frozen=True)
class Correlation:
    """Correlation of consecutive readings, its z and two-sided p."""

    value: float
    z: float
    pairs: int
    p_value: float


def lag_test(residual: np.ndarray, follows: np.ndarray, nuisance: np.ndarray) -> Correlation:
    """Correlation of readings that follow one another, exact mean and variance under noise.

    Parameters
    ----------
    residual : (m,)
        Whitened residual, nuisance already projected out.
    follows : (m,) bool
        Reading i follows reading i - 1 of the same press.
    nuisance : (m, k)
        Orthonormal basis of the projected parameters.
    """
    first = np.flatnonzero(follows) - 1

    def lagged(columns: np.ndarray) -> np.ndarray:
        out = np.zeros_like(columns)
        out[first] += columns[first + 1] / 2
        out[first + 1] += columns[first] / 2
        return out

    pairs = len(first)
    moved = lagged(nuisance)
    inner = nuisance.T @ moved
    # tr(L^2) counts each pair twice with weight 1/4; L^2 on the basis is the moved basis's square.
    mean = -np.trace(inner)
    variance = pairs - 4 * np.sum(moved**2) + 2 * np.sum(inner * inner.T)
    # In units of the residual's own variance: a correlation does not depend on its size.
    scale = np.sum(residual**2) / max(len(residual) - nuisance.shape[1], 1)
    product = float(residual[first] @ residual[first + 1] / scale) if scale > 0 else 0.0
    z = float((product - mean) / np.sqrt(max(variance, 1.0)))
    return Correlation(product / pairs, z, pairs, float(2 * special.ndtr(-abs(z))))


def largest_test(residual: np.ndarray) -> float:
    """P-value of the largest |r| among m independent standard normal readings (Sidak)."""
    single = 2 * special.ndtr(-np.max(np.abs(residual)))
    return float(-np.expm1(len(residual) * np.log1p(-min(single, 1 - 1e-16))))


def holm(p_values: Sequence[float]) -> np.ndarray:
    """Holm's adjusted p-values: the family-wise error stays below alpha where they are < alpha.

    Examples
    --------
    >>> holm([0.01, 0.04, 0.03]).tolist()
    [0.03, 0.06, 0.06]
    """
    p = np.asarray(p_values, dtype=float)
    order = np.argsort(p)
    stepped = np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1))
    adjusted = np.empty(len(p))
    adjusted[order] = np.minimum(stepped, 1.0)
    return adjusted
