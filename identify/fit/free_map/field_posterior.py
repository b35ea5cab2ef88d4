"""The posterior of a free map: mean, standard deviation, draws, resolution and evidence.

In data space, with the prior covariance C of the field, K and V of
`identify.fit.free_map.field_data`, and the covariance Q of s by the map's own error,

    S = I + V' (K C K' + Q) V,     dev = C K' V S^-1 t,     cov = C - C K' V S^-1 V' K C

and the target t ~ N(0, S) gives the evidence. Further layers (`MaternField.untold`) are no part of
C: the map does not draw them, and all covariances count what they add to its errors, which is
(1 - C K' V S^-1 V' K) times each. Source: Tarantola, "Inverse Problem Theory", SIAM 2005, section
3.2.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_solve, cholesky, eigh, solve_triangular

from identify.fit.free_map.field_data import FieldData
from identify.map import MaternField


@dataclass(frozen=True, eq=False)
class DrawnField:
    """A field (g,), counted from its prior mean, and the `dual` (g,) from which a prior draws it.

    `field` is the prior's covariance times `dual`.
    """

    dual: np.ndarray
    field: np.ndarray

    @property
    def cost(self) -> float:
        """Square of the field's distance from its mean, in the prior's standard deviations."""
        return float(self.dual @ self.field)

    def towards(self, other: DrawnField, share: float) -> DrawnField:
        """Return the field a share of the way to another one."""
        kept = 1 - share
        return DrawnField(
            kept * self.dual + share * other.dual, kept * self.field + share * other.field
        )


@dataclass(frozen=True, eq=False)
class FieldPosterior:
    """A Gaussian field given readings that are linear in it.

    Attributes
    ----------
    data : of the readings
    prior : of the field (g,)
    error : relative error of the map in each press's compliance, of the map's own form
    """

    data: FieldData
    prior: MaternField
    error: float = 0.0

    @cached_property
    def spread_by(self) -> np.ndarray:
        """Prior covariance of s and field, K C (j, g)."""
        return self.prior.product(self.data.by_field)

    @cached_property
    def of_field(self) -> np.ndarray:
        """Prior covariance (j, j) of s by the field, K C K'."""
        return self.spread_by @ self.data.by_field.T

    @cached_property
    def _of_s(self) -> np.ndarray:
        return self.of_field + np.diag(self.data.error_variance(self.error))

    @cached_property
    def _factor(self) -> np.ndarray:
        """Lower triangular factor (j, j) of S."""
        root = self.data.root
        whole = root.T @ self._of_s @ root
        whole[np.diag_indices_from(whole)] += 1
        return cholesky(whole, lower=True)

    @cached_property
    def weights(self) -> np.ndarray:
        """V S^-1 t, (j,): the field is `spread_by` times it."""
        return self.data.root @ cho_solve((self._factor, True), self.data.target)

    @cached_property
    def mean(self) -> np.ndarray:
        """Most probable field (g,), counted from its prior mean."""
        return self.weights @ self.spread_by

    @cached_property
    def seen(self) -> np.ndarray:
        """Whitened part (j, g) of the field that is seen; its squares are the variance taken."""
        return solve_triangular(self._factor, self.data.root.T @ self.spread_by, lower=True)

    @cached_property
    def sd(self) -> np.ndarray:
        """Standard deviation of the field, (g,)."""
        prior = self.prior
        own = prior.variance + prior.level_spread**2 - prior.untold_spread**2
        own = np.maximum(own - np.sum(self.seen**2, axis=0), 0.0)
        return np.sqrt(own + np.sum(self.untold**2, axis=0))

    @cached_property
    def untold(self) -> np.ndarray:
        """Errors (n, g) of the mean by each of the further layers, one standard deviation each."""
        layers, root = self.prior.untold, self.data.root
        short = cho_solve((self._factor, True), root.T @ (self.data.by_field @ layers.T))
        return layers - (root @ short).T @ self.spread_by

    @cached_property
    def share(self) -> np.ndarray:
        """Share of the prior's variance about its level that the readings take away, (g,)."""
        return np.clip(1 - self.sd**2 / self.prior.variance, 0.0, 1.0)

    def damped(self, damping: float) -> tuple[float, DrawnField, np.ndarray]:
        """Return the way to the field of least misfit beside `damping` times the way's own cost.

        Without damping that is the mean. What the readings do not ask for stays (Levenberg and
        Marquardt).

        Returns
        -------
        share : of the way to the field that the second one draws
        aim : that field
        moved : (j,) change of s from where the readings are linear, with the presses' own errors
        """
        data, share = self.data, 1 / (1 + damping)
        error = data.error_variance(self.error)
        whole = data.root.T @ (share * self.of_field + np.diag(error)) @ data.root
        whole[np.diag_indices_from(whole)] += 1
        target = data.target - (1 - share) * data.root.T @ data.here
        weights = data.root @ cho_solve((cholesky(whole, lower=True), True), target)
        aim = DrawnField(weights @ data.by_field, weights @ self.spread_by)
        of_map = (1 - share) * data.here + share * data.by_field @ aim.field
        return share, aim, of_map + error * weights - data.offset

    def moved(self) -> np.ndarray:
        """Change (j,) of s from where the readings are linear, with the presses' own errors."""
        return self.damped(0.0)[2]

    @property
    def step(self) -> np.ndarray:
        """Change (j,) of ln C by the map from that of the present field."""
        return self.of_field @ self.weights - self.data.here

    def misfit(self, moved: np.ndarray) -> float:
        """Chi-square of a change (j,) of s from the present field's, with the presses' errors."""
        root = self.data.root
        gap = self.data.target - root.T @ (self.data.here + moved)
        whole = (root.T * self.data.error_variance(self.error)) @ root
        whole[np.diag_indices_from(whole)] += 1
        return float(gap @ cho_solve((cholesky(whole, lower=True), True), gap))

    def predicted_covariance(self, by_field: np.ndarray, own: np.ndarray) -> np.ndarray:
        """Covariance (n + q) of ln C of n other presses and of the effects' parameters.

        Parameters
        ----------
        by_field : (n, g) their derivative by the field
        own : (n, j) 1 where a press shares the map's error of one of the j presses
        """
        data, effects = self.data, self.data.effects
        error = data.error_variance(self.error)
        half = solve_triangular(self._factor, data.root.T @ self._of_s, lower=True)
        across = self.spread_by @ by_field.T + error[:, None] * own.T
        seen = solve_triangular(self._factor, data.root.T @ across, lower=True)
        of_s = self.prior.product(by_field) @ by_field.T + (own * error) @ own.T - seen.T @ seen
        untold = self.untold @ by_field.T
        of_s += untold.T @ untold
        if not effects.count:
            return of_s
        at_presses = self.untold @ data.by_field.T
        across = across - half.T @ seen + at_presses.T @ untold
        gain = effects.solve(effects.coupling.T)
        of_effects = effects.solve(np.eye(effects.count))
        of_presses = self._of_s - half.T @ half + at_presses.T @ at_presses
        of_effects = of_effects + gain @ of_presses @ gain.T
        return np.block([[of_s, -(gain @ across).T], [-gain @ across, of_effects]])

    @cached_property
    def chi2(self) -> float:
        """Chi-square of the readings beside every field of the prior, the best effects taken.

        The readings' own residual around the linearisation, which no field changes, is part of it.
        """
        data, effects = self.data, self.data.effects
        half = solve_triangular(self._factor, data.target, lower=True)
        own = data.target - data.root.T @ data.offset
        rest = float(data.sums.chi2.sum() - own @ own)
        if effects.count:
            rest -= float(effects.gradient @ effects.solve(effects.gradient))
        return rest + float(half @ half)

    @cached_property
    def log_evidence(self) -> float:
        """Logarithm of the density of the readings, whitened, over that of noise alone."""
        effects = self.data.effects
        log_det = 2 * float(np.log(np.diag(self._factor)).sum())
        if effects.count:
            log_det += float(np.linalg.slogdet(effects.normal)[1])
            log_det -= effects.count * np.log(2 * np.pi)
        return -0.5 * (self.chi2 + log_det)

    @cached_property
    def modes(self) -> tuple[np.ndarray, np.ndarray]:
        """Directions (j, j) of s that the field can follow, and its variance over the noise's."""
        root = self.data.root
        noise = (root.T * self.data.error_variance(self.error)) @ root
        noise[np.diag_indices_from(noise)] += 1
        gain, vectors = eigh(root.T @ self.of_field @ root, noise)
        directions = noise @ vectors
        return solve_triangular(root, directions, lower=True, trans=1), np.maximum(gain, 0.0)

    @property
    def effective(self) -> float:
        """Effective number of parameters of the field: the trace of the readings' hat matrix."""
        gain = self.modes[1]
        return float(np.sum(gain / (1 + gain)))

    def draws(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Return random fields (count, g) of the posterior, by Matheron's rule."""
        data = self.data
        fields = self.prior.draws(rng, count)
        own = np.sqrt(data.error_variance(self.error))
        own = own * rng.standard_normal((count, len(own)))
        simulated = (fields @ data.by_field.T + own) @ data.root
        simulated += rng.standard_normal(simulated.shape)
        short = cho_solve((self._factor, True), (data.target - simulated).T).T
        return fields + (short @ data.root.T) @ self.spread_by

    def smearing_m(self, points: np.ndarray) -> np.ndarray:
        """Width (q,) in m over which grid points (q,) int are smeared.

        The estimate at a point is a weighted mean of the true field; the width is the diameter of a
        ball of as many points as that mean counts.
        """
        back = solve_triangular(self._factor, self.seen[:, points], lower=True, trans=1)
        kernel = (self.data.root @ back).T @ self.data.by_field
        count = kernel.sum(axis=1) ** 2 / np.maximum(np.sum(kernel**2, axis=1), 1e-300)
        return np.cbrt(6 / np.pi * count * self.prior.grid.cell_m3)

    def left_out(self, folds: np.ndarray) -> np.ndarray:
        """Error (j,) of each press's s by the map of the other folds (j,): its own less that."""
        data, found = self.data, np.zeros(len(self.data.target))
        precision = data.root @ data.root.T
        # What readings say of s on their own: s_hat with the covariance precision^-1
        own = solve_triangular(data.root, data.target, lower=True, trans=1)
        for number in np.unique(folds):
            rest, out = folds != number, folds == number
            noise = np.linalg.inv(precision[np.ix_(rest, rest)])
            known = self._of_s[np.ix_(rest, rest)] + noise
            gain = np.linalg.solve(known, own[rest])
            found[out] = self.of_field[np.ix_(out, rest)] @ gain
        return own - found
