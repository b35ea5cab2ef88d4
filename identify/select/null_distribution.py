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


class NullNoise:
    """Residuals of pure noise, drawn once for all searches of one diagnosis.

    Parameters
    ----------
    seed : of the draws
    """

    def __init__(self, seed: int = 0) -> None:
        self._seed = seed
        self._batches: tuple[tuple[int, int], list[np.ndarray]] = ((0, 0), [])

    def batches(self, rows: int, draws: int) -> list[np.ndarray]:
        """Return residuals (rows, b) of so many draws together, in single precision."""
        if self._batches[0] != (rows, draws):
            rng = np.random.default_rng(self._seed)
            drawn = [
                rng.standard_normal((rows, _BATCH), np.float32) for _ in range(draws // _BATCH)
            ]
            self._batches = ((rows, draws), drawn)
        return self._batches[1]


class NullSearch:
    """Simulation of the largest score over a grid whose candidates come block by block.

    Where the observed score is certain nothing is simulated, and all candidates count as
    independent trials (Bonferroni).

    Parameters
    ----------
    candidates : number of all of them
    amplitudes : number of each one's columns, before those that the map absorbs are left out
    one_sided : the score is signed
    noise : from which the null is simulated
    """

    def __init__(
        self,
        candidates: int,
        amplitudes: int,
        one_sided: bool,
        noise: NullNoise,
        settings: DiagnosisSettings = DIAGNOSIS,
    ) -> None:
        self.candidates, self.amplitudes = candidates, amplitudes
        self.one_sided, self.settings = one_sided, settings
        self._noise, self._dof = noise, 1
        self._largest: list[np.ndarray] = []

    def add(self, basis: np.ndarray, statistic: float = 0.0) -> None:
        """Count candidates of orthonormal bases (g, m, q) beyond the map.

        `statistic` is the largest score observed so far.
        """
        g, m, q = basis.shape
        self._dof = max(self._dof, q)
        if self.is_certain(statistic):
            return
        noises = self._noise.batches(m, self.settings.draws)
        if not self._largest:
            self._largest = [np.full(_BATCH, -np.inf) for _ in noises]
        # In single precision: maxima of a thousand draws are known to two digits
        flat = np.ascontiguousarray(basis.transpose(0, 2, 1).reshape(g * q, m), np.float32)
        for largest, noise in zip(self._largest, noises, strict=True):
            t = (flat @ noise).reshape(g, q, _BATCH)
            score = t[:, 0] if self.one_sided else np.sum(t**2, axis=1)
            np.maximum(largest, score.max(axis=0), out=largest)

    def widen(self, candidates: int) -> None:
        """Count further candidates around a score that is certain."""
        self.candidates += candidates

    def null(self, statistic: float = 0.0) -> ScoreNull:
        """Return the distribution, after all candidates, for an observed score."""
        q, one_sided, tail = self._dof, self.one_sided, self.settings.tail
        if self.is_certain(statistic):
            return ScoreNull(np.empty(0), float(self.candidates), q, one_sided, tail)
        ordered = np.sort(np.concatenate(self._largest))
        n = len(ordered)
        upper = np.arange(int((1 - tail) * n), n - n // 100)
        chance = -np.log((upper + 0.5) / n)
        single = np.array([log_sf(float(ordered[i]), q, one_sided) for i in upper])
        trials = float(np.exp(np.median(np.log(chance) - single)))
        return ScoreNull(ordered, max(trials, 1.0), q, one_sided, tail)

    def is_certain(self, statistic: float) -> bool:
        """Return True for a score that needs no simulation; once true, it stays so."""
        if self.candidates == 1:
            return True
        tail = log_sf(statistic, self.amplitudes, self.one_sided)
        return bool(np.log(self.candidates) + tail < self.settings.certain)
