"""Draws from the posterior of map and effects: the whole bent valley, not its ends alone.

Between the bounds of the search every point counts alike before any reading, in the coordinates of
the search (a parameter in log scale by its logarithm). With the fit's whitened residual r(u),

    ln p(u | readings) = -1/2 r' W r + const,    W = (I + J S J')^-1,

J the derivative at the estimate and S the covariance of the estimate by the finer model's own
error: the part of that error which the parameters can follow counts as noise. The estimate, whose
residual is orthogonal to J, stays the mode, and the curvature there is the fit's covariance. With
J = QR, r'Wr = r'r - (Q'r)' K (Q'r) and K = I - (I + R S R')^-1.

In coordinates z in which the valley is straight (`LogPosterior`) the posterior is almost normal.
There a Metropolis sampler proposes from a t distribution with the posterior's own mean and
covariance, as weighted trials give them, so that most draws are new ones. R-hat and effective
numbers of several chains measure the trust in them (Vehtari et al., Bayesian Analysis 16 (2021)
667).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from identify.effects.units import digits
from identify.fit.settings import POSTERIOR, PosteriorSettings
from identify.optimize.result import InadmissibleError
from models import InputError, replaced

if TYPE_CHECKING:
    from identify.fit.result import FitResult, Solution

_NEEDED = ("arviz_base", "arviz_stats", "h5netcdf")
_ENDS = (0.025, 0.975)
_STEP = 0.5  # standard deviations, of the second derivatives


def refuse_without_arviz() -> None:
    """Raise `InputError` unless the diagnostics and the file format are installed."""
    missing = [name for name in _NEEDED if find_spec(name) is None]
    if missing:
        raise InputError(
            f"samples of the posterior need the package {missing[0]}, which is not installed: "
            "pip install 'palpmap[posterior]', or ask for samples = 0"
        )


def refuse_samples(fit: FitResult) -> None:
    """Raise `InputError` where draws from the posterior of a fit would mean nothing."""
    refuse_without_arviz()
    if fit.field is not None:
        raise InputError(
            "no samples of a free map: its field is normal, and given with its standard deviation"
        )
    if fit.is_gross:
        raise InputError(
            f"no samples: the residual is {digits(fit.chi2_per_dof**0.5)} times the noise, which "
            "then says nothing of the parameters; find what is missing with `palpmap explain`"
        )
    if not fit.covariance_names or not np.isfinite(fit.covariance).all():
        raise InputError("no samples: the scan determines no parameter, or not every one")


@dataclass(frozen=True)
class SampledParameter:
    """Marginal posterior of a parameter, in its unit.

    Attributes
    ----------
    mean, std, lower95, upper95 : of the draws; the interval leaves 2.5 % on either side
    straight_lower95, straight_upper95 : interval of the covariance alone (Laplace's approximation)
    effective, effective_tail : number of independent draws that are worth the same for the mean,
        and for the interval's ends
    r_hat : spread of all chains over that within one; 1 of chains that agree
    """

    mean: float
    std: float
    lower95: float
    upper95: float
    straight_lower95: float
    straight_upper95: float
    effective: float
    effective_tail: float
    r_hat: float

    @property
    def settled(self) -> bool:
        """True if the chains agree, with enough independent draws for mean and interval."""
        enough = min(self.effective, self.effective_tail) >= POSTERIOR.least_effective
        return enough and self.r_hat <= POSTERIOR.largest_r_hat


@dataclass(frozen=True)
class Posterior:
    """Draws from the posterior of a fit.

    Attributes
    ----------
    samples, chains, seed : as drawn
    parameters : by name
    draws : (chains, n, k) of the free parameters, in their units; None if read from a file
    """

    samples: int
    chains: int
    seed: int
    parameters: Mapping[str, SampledParameter]
    draws: np.ndarray | None = None

    @property
    def effective(self) -> float:
        """Least effective number of draws, of any parameter, for its mean or its interval."""
        return min(min(p.effective, p.effective_tail) for p in self.parameters.values())

    @property
    def r_hat(self) -> float:
        """Largest R-hat of any parameter."""
        return max(p.r_hat for p in self.parameters.values())

    @property
    def settled(self) -> bool:
        """True if the intervals of all parameters can be trusted."""
        return all(p.settled for p in self.parameters.values())

    def to_dict(self) -> dict[str, Any]:
        """Return the record without the draws as plain data."""
        found = asdict(replace(self, draws=None))
        del found["draws"]
        return found

    def write(self, path: str | Path) -> None:
        """Write the draws as an ArviZ file (netCDF), in the body's frame."""
        import arviz_base

        if self.draws is None:
            raise ValueError("these draws were read from fit.json: they stand in posterior.nc")
        by_name = {name: self.draws[:, :, i] for i, name in enumerate(self.parameters)}
        tree = arviz_base.from_dict(
            {"posterior": by_name},
            attrs={"posterior": {"inference_library": "palpmap", "seed": self.seed}},
        )
        with replaced(path) as beside:
            tree.to_netcdf(str(beside), engine="h5netcdf")


class LogPosterior:
    """Logarithm of the posterior in coordinates z (k,) in which it is almost normal.

    u = estimate + L (z + T[z, z] / 2), LL' the fit's covariance, and T such that the prediction has
    no second derivative along its own tangents (the acceleration of its geodesics; Bates & Watts,
    Nonlinear Regression Analysis, 1988, ch. 7): the valley is then straight.
    """

    def __init__(self, solution: Solution, settings: PosteriorSettings = POSTERIOR) -> None:
        self._model, self._estimate = solution.model, solution.u
        self._slack = settings.slack
        self._root = np.linalg.cholesky(solution.covariance)
        jacobian = self._model.evaluate(self._estimate, self._slack).jacobian
        self._basis, triangle = np.linalg.qr(jacobian)
        unit = np.eye(len(self._root))
        mesh = solution.covariance - solution.noise_covariance
        self._followed = unit - np.linalg.inv(unit + triangle @ mesh @ triangle.T)
        self._bend = self._geodesic(jacobian, settings)

    def _geodesic(self, jacobian: np.ndarray, settings: PosteriorSettings) -> np.ndarray:
        """Return T (k, k, k), smaller where the coordinates would fold within the posterior."""
        k, root = len(self._root), self._root
        across = root.T @ self._weighted(jacobian).T  # onto the tangents, in z
        bend = np.zeros((k, k, k))
        for b in range(k):
            sides = [self._estimate + step * root[:, b] for step in (-_STEP, _STEP)]
            sides = [np.clip(side, *self._model.bounds) for side in sides]
            apart = np.linalg.norm(sides[1] - sides[0]) / np.linalg.norm(root[:, b])
            try:
                back, forth = (self._model.evaluate(u, self._slack).jacobian for u in sides)
            except InadmissibleError:
                continue
            bend[:, :, b] = -across @ ((forth - back) @ root) / apart
        bend = 0.5 * (bend + bend.swapaxes(1, 2))
        z = np.random.default_rng(0).normal(size=(settings.folds_tried, k))
        z *= settings.unfolded / np.linalg.norm(z, axis=1, keepdims=True)
        while np.linalg.det(np.eye(k) + np.einsum("cab,nb->nca", bend, z)).min() < 0:
            bend *= 0.8
        return bend

    def _weighted(self, change: np.ndarray) -> np.ndarray:
        """Return W times whitened changes (n,) or (n, q)."""
        return change - self._basis @ (self._followed @ (self._basis.T @ change))

    def scaled(self, z: np.ndarray) -> np.ndarray:
        """Return the scaled coordinates (..., k) of the fit for z (..., k)."""
        bent = z + 0.5 * np.einsum("cab,...a,...b->...c", self._bend, z, z)
        return self._estimate + bent @ self._root.T

    def __call__(self, z: np.ndarray) -> float:
        """Return the value at z (k,) but for a constant; minus infinity where nothing may be."""
        u, (low, high) = self.scaled(z), self._model.bounds
        sign, log_volume = np.linalg.slogdet(np.eye(len(z)) + self._bend @ z)
        if sign <= 0 or np.any(u < low) or np.any(u > high):
            return -np.inf
        try:
            residual = self._model.residual(u, self._slack)
        except InadmissibleError:
            return -np.inf
        return float(log_volume) - 0.5 * float(residual @ self._weighted(residual))


def draw_posterior(
    solution: Solution,
    samples: int,
    seed: int = 0,
    progress: Callable[[int], None] | None = None,
    settings: PosteriorSettings = POSTERIOR,
) -> Posterior:
    """Draw from the posterior of a fit.

    Parameters
    ----------
    solution : the fit, not of a free map
    samples : number of draws of all chains together
    seed : of the random numbers
    progress : called with the number of draws so far

    Raises
    ------
    InputError
        The diagnostics are not installed.
    """
    refuse_without_arviz()
    size = -(-samples // settings.chains)
    target = LogPosterior(solution, settings)
    u = target.scaled(_chains(target, len(solution.u), size, seed, progress, settings))
    space, bounds = solution.model.unknowns.unknowns, solution.model.bounds
    draws = np.stack(
        [np.exp(u[..., i]) if p.log else p.typical * u[..., i] for i, p in enumerate(space)], -1
    )
    laplace = np.clip(solution.straight_ends, bounds[0][:, None], bounds[1][:, None]).tolist()
    found = {
        p.name: _marginal(draws[..., i], sorted(p.to_value(end) for end in laplace[i]))
        for i, p in enumerate(space)
    }
    return Posterior(size * settings.chains, settings.chains, seed, found, draws)


def _marginal(draws: np.ndarray, laplace: list[float]) -> SampledParameter:
    """Describe the draws (c, n) of one parameter."""
    from arviz_stats.base.array import array_stats

    def of(measure: Any, **how: Any) -> float:
        return np.asarray(measure(draws, chain_axis=0, draw_axis=1, **how)).item()

    lower, upper = np.quantile(draws, _ENDS).tolist()
    return SampledParameter(
        mean=float(draws.mean()),
        std=float(draws.std()),
        lower95=lower,
        upper95=upper,
        straight_lower95=laplace[0],
        straight_upper95=laplace[1],
        effective=of(array_stats.ess),
        effective_tail=of(array_stats.ess, method="tail", prob=_ENDS),
        r_hat=of(array_stats.rhat),
    )


class _Proposal:
    """Student's t distribution of places z (k,)."""

    def __init__(self, middle: np.ndarray, covariance: np.ndarray, freedom: float) -> None:
        self._middle, self._freedom = middle, freedom
        self._root = np.linalg.cholesky(covariance)

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """Return a place."""
        wide = np.sqrt(self._freedom / rng.chisquare(self._freedom))
        return self._middle + wide * self._root @ rng.normal(size=len(self._middle))

    def log_density(self, z: np.ndarray) -> float:
        """Return the logarithm of the density at a place, but for a constant."""
        away = np.linalg.solve(self._root, z - self._middle)
        nu, k = self._freedom, len(z)
        return -0.5 * (nu + k) * float(np.log1p(away @ away / nu))


def _chains(
    target: LogPosterior,
    k: int,
    size: int,
    seed: int,
    progress: Callable[[int], None] | None,
    settings: PosteriorSettings,
) -> np.ndarray:
    """Return draws z (c, n, k) of independent chains, which begin within the posterior."""
    first, *streams = np.random.default_rng(seed).spawn(settings.chains + 1)
    proposal, starts = _Proposal(np.zeros(k), np.eye(k), settings.freedom), np.zeros((1, k))
    for _ in range(settings.rounds):
        proposal, starts = _nearer(target, proposal, k, first, settings)
    z = np.empty((settings.chains, size, k))
    for chain, rng in enumerate(streams):
        here = starts[rng.integers(len(starts))]
        log_weight = target(here) - proposal.log_density(here)
        for number in range(size):
            other = proposal.draw(rng)
            log_other = target(other) - proposal.log_density(other)
            if np.log(rng.uniform()) < log_other - log_weight:
                here, log_weight = other, log_other
            z[chain, number] = here
            if progress:
                progress(chain * size + number + 1)
    return z


def _nearer(
    target: LogPosterior,
    proposal: _Proposal,
    k: int,
    rng: np.random.Generator,
    settings: PosteriorSettings,
) -> tuple[_Proposal, np.ndarray]:
    """Return a proposal with mean and covariance of weighted trials, and places (n, k) among them.

    The fewer trials count, the more they are held towards the fit's own normal distribution.
    """
    z = np.array([proposal.draw(rng) for _ in range(settings.trials)])
    log_weight = np.array([target(one) - proposal.log_density(one) for one in z])
    if not np.isfinite(log_weight).any():
        return proposal, np.zeros((1, k))  # an estimate between narrow bounds
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    count, held = 1 / float(np.sum(weight**2)), 2.0 * k
    middle = count / (count + held) * weight @ z
    spread = (z - middle).T @ (weight[:, None] * (z - middle))
    covariance = (count * spread + held * np.eye(k)) / (count + held)
    return _Proposal(middle, covariance, settings.freedom), z[rng.choice(len(z), 50, p=weight)]
