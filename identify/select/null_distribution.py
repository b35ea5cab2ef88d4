"""Null distribution of the score where a shape was searched on a grid.

The score of an effect with a shape parameter is the largest over its candidates; its distribution
under the null is simulated with the scan's own patterns (r ~ N(0, I), cheap because linear).
Beyond the simulation, the tail is that of a number of independent trials (Gumbel):
p = 1 - exp(-N sf(S)), N matched to the simulation.
"""

from dataclasses import dataclass

import numpy as np
from scipy import special

from identify.select.settings import DIAGNOSIS, DiagnosisSettings

_BATCH = 500  # residuals held in memory at a time


def log_sf(statistic: float, dof: int, one_sided: bool) -> float:
    """Natural logarithm of the tail of one candidate.

    Parameters
    ----------
    statistic : a signed z for a one-sided effect, else chi-square
    dof : of the chi-square

    Examples
    --------
    >>> round(log_sf(1.6448536, 1, True), 4)
    -2.9957
    """
    if one_sided:
        return float(special.log_ndtr(-statistic))
    tail = float(special.chdtrc(dof, statistic))
    if tail > 0:
        return float(np.log(tail))
    x = statistic / 2  # asymptotic, where the tail underflows
    return float(
        (dof / 2 - 1) * np.log(x) - x - special.gammaln(dof / 2) + np.log1p((dof / 2 - 1) / x)
    )


@dataclass(frozen=True)
class ScoreNull:
    """Null distribution of the largest score over a grid.

    `largest` (n,) sorted simulated maxima; `trials` effective number of independent candidates;
    `tail` upper share of the simulation that the trials replace.
    """

    largest: np.ndarray
    trials: float
    dof: int
    one_sided: bool
    tail: float = DIAGNOSIS.tail

    def log_p(self, statistic: float) -> float:
        """Natural logarithm of the p-value of a statistic."""
        if len(self.largest) == 0:
            return min(np.log(self.trials) + log_sf(statistic, self.dof, self.one_sided), 0.0)
        n = len(self.largest)
        edge = self.largest[int((1 - self.tail) * n)]
        if statistic < edge:
            rank = float(np.interp(statistic, self.largest, np.arange(n) + 0.5, left=0.0))
            return float(np.log1p(-rank / n)) if rank < n else -np.inf
        tail = np.log(self.trials) + log_sf(statistic, self.dof, self.one_sided)
        return float(np.log(-np.expm1(-np.exp(tail)))) if tail > -20 else float(tail)


def score_null(
    basis: np.ndarray,
    one_sided: bool,
    rng: np.random.Generator,
    statistic: float = 0.0,
    settings: DiagnosisSettings = DIAGNOSIS,
) -> ScoreNull:
    """Simulate the largest score over a grid.

    Parameters
    ----------
    basis : (g, m, q) orthonormal basis of each candidate's pattern beyond the map
    one_sided : the score is signed (q = 1)
    statistic : observed score; where it is certain nothing is simulated, and all candidates count
        as independent trials (Bonferroni)
    """
    g, m, q = basis.shape
    if g == 1 or np.log(g) + log_sf(statistic, q, one_sided) < settings.certain:
        return ScoreNull(np.empty(0), float(g), q, one_sided, settings.tail)
    # In single precision: maxima of a thousand draws are known to two digits
    flat = np.ascontiguousarray(basis.transpose(0, 2, 1).reshape(g * q, m), np.float32)
    largest = []
    for _ in range(settings.draws // _BATCH):
        noise = rng.standard_normal((m, _BATCH)).astype(np.float32)
        t = (flat @ noise).reshape(g, q, _BATCH)
        score = t[:, 0] if one_sided else np.sum(t**2, axis=1)
        largest.append(score.max(axis=0))
    ordered = np.sort(np.concatenate(largest))
    n = len(ordered)
    upper = np.arange(int((1 - settings.tail) * n), n - n // 100)
    chance = -np.log((upper + 0.5) / n)
    single = np.array([log_sf(float(ordered[i]), q, one_sided) for i in upper])
    trials = float(np.exp(np.median(np.log(chance) - single)))
    return ScoreNull(ordered, max(trials, 1.0), q, one_sided, settings.tail)
