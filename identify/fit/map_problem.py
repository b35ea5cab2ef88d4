"""The least-squares problem of a scan: minimise from a map, from several, towards a finer model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fem import PalpationModel
from fem.errors import SolverError
from identify.body.discretization_error import FineModel, fine_solution
from identify.body.forward import Forward, compliance
from identify.fit.result import FitIteration
from identify.map.gaussian_map import GaussianMap
from identify.map.initial_guess import scaled
from identify.map.parameters import parameter_space
from identify.measurement.errors_in_variables import PressTable
from identify.measurement.noise import Noise
from identify.optimize.optimizers import Optimizer
from identify.optimize.result import InadmissibleError, OptimizeResult
from models.errors import InputError

Progress = Callable[[FitIteration], None]

# Half of chi-square that is not worth a step: it moves no parameter by more than 0.015 deviations.
_FTOL = 1e-4
# A model that misfits so many times the noise is wrong, and neither digits nor rounds cure it: of
# what chi-square has in excess, this part is not worth a step, and few rounds of correction do.
_GROSS, _GROSS_ROUNDS = 5.0, 3
_GROSS_RTOL = 1e-3
_KEPT_STARTS = 3
_TRIAL_EVALUATIONS = 8  # of one inclusion; several take longer to sort themselves out
_FINE_ROUNDS = 8
# A round of defect correction that moves the estimate by fewer standard deviations is the last.
_SETTLED = 0.03


@dataclass(frozen=True)
class Minimum:
    """The end of a minimisation, the accepted steps that led there and all evaluations made."""

    forward: Forward
    result: OptimizeResult
    history: tuple[FitIteration, ...]
    nfev: int

    @property
    def map(self) -> GaussianMap:
        """The map at the minimum."""
        return self.forward.space.to_map(self.result.x)

    def after(self, earlier: Minimum) -> Minimum:
        """Return this minimum with the earlier path before its own."""
        steps = enumerate(self.history, start=len(earlier.history))
        own = tuple(replace(step, iteration=number) for number, step in steps)
        return replace(self, history=earlier.history + own, nfev=earlier.nfev + self.nfev)


@dataclass(frozen=True)
class Correction:
    """A minimum corrected towards a finer model.

    `coarse_error` (j,) is the relative error of the coarse model's compliance against the finer
    one's, `own_error` (j,) what the finer one is off by itself, `settled` whether the last round
    moved the estimate no more.
    """

    minimum: Minimum
    coarse_error: np.ndarray
    own_error: np.ndarray
    settled: bool


@dataclass(frozen=True)
class ScanProblem:
    """The compressed rows of a scan, their noise and the optimiser that fits a model to them."""

    table: PressTable
    noise: Noise
    optimizer: Optimizer
    progress: Progress | None = None

    def chi2(self, prediction: np.ndarray) -> float:
        """Chi-square of compliances (j,) over all rows."""
        return float(np.sum(self.table.residuals(prediction, self.noise)[0] ** 2))

    def is_gross(self, minimum: Minimum) -> bool:
        """Whether the model misfits so much that the noise says nothing of its parameters."""
        dof = self.table.dof(len(minimum.result.x))
        return minimum.result.fun > self._gross(dof)

    @staticmethod
    def _gross(dof: int) -> float:
        """Half of chi-square from which on a misfit is gross."""
        return 0.5 * dof * _GROSS**2

    def jacobian(self, forward: Forward, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Compliance (j,) and the whitened residuals' derivative (2 j, k) by the coordinates u."""
        prediction, gradient = forward.evaluate(u)
        return prediction, self.whitened(prediction, gradient)

    def whitened(self, prediction: np.ndarray, gradient: np.ndarray) -> np.ndarray:
        """Whiten the derivative (j, k) of the compliance: that of the residuals (2 j, k)."""
        _, slope = self.table.residuals(prediction, self.noise)
        return (slope[:, :, None] * gradient[:, None, :]).reshape(-1, gradient.shape[1])

    def minimize(
        self, forward: Forward, u: np.ndarray, limit: int = 100, progress: Progress | None = None
    ) -> Minimum:
        """Minimise from the scaled coordinates u with at most so many evaluations."""
        history: list[FitIteration] = []
        rms: dict[bytes, float] = {}
        dof = self.table.dof(len(u))

        def evaluate(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            prediction, jac = self.jacobian(forward, u)
            rms[u.tobytes()] = self.table.rms(prediction)
            return self.table.residuals(prediction, self.noise)[0].ravel(), jac

        def accept(u: np.ndarray, fun: float) -> None:
            stiffness = forward.space.to_map(u)
            values = dict(zip(stiffness.names, stiffness.values.tolist(), strict=True))
            step = FitIteration(len(history), values, 2 * fun, 2 * fun / dof, rms[u.tobytes()])
            history.append(step)
            if progress:
                progress(step)

        result = self.optimizer(
            evaluate,
            u,
            bounds=forward.space.bounds,
            ftol=_FTOL,
            rtol=_GROSS_RTOL,
            above=self._gross(dof),
            max_evaluations=limit,
            callback=accept,
        )
        return Minimum(forward, result, tuple(history), result.nfev)

    def continued(self, earlier: Minimum, forward: Forward) -> Minimum:
        """Minimise onwards from an earlier minimum, reporting its own steps as the next ones."""
        # The first step repeats the last one, unless the model has changed in between.
        repeated = 1 if forward is earlier.forward else 0
        offset = len(earlier.history) - repeated

        def progress(step: FitIteration) -> None:
            if self.progress and step.iteration >= repeated:
                self.progress(replace(step, iteration=offset + step.iteration))

        own = self.minimize(forward, earlier.result.x, progress=progress)
        return replace(own, history=own.history[repeated:]).after(earlier)

    def from_best(
        self,
        model: PalpationModel,
        maps: Sequence[GaussianMap],
        box: np.ndarray,
        ratio: np.ndarray | float = 1.0,
    ) -> Minimum:
        """Try all maps once, follow the best few a little, and the best of those to its end.

        `ratio` (j,) multiplies the model's compliance, see `Forward`.
        """
        tried = []
        for stiffness in maps:
            try:
                prediction = ratio * compliance(model, stiffness)
            except (InadmissibleError, SolverError):
                continue
            # The best common factor of all moduli is known without another solve.
            factor = self.table.common_factor(prediction, self.noise)
            if factor > 0:
                tried.append((self.chi2(prediction / factor), scaled(stiffness, factor)))
        if not tried:
            raise InputError(
                "no map explains the scan even roughly: check the signs and units of force_n and "
                "displacement_m"
            )
        tried.sort(key=lambda pair: pair[0])
        kept = [stiffness for _, stiffness in tried[:_KEPT_STARTS]]
        # A body with hard and soft spots: a start with a wrong sign never comes back from it
        kept += [stiffness for _, stiffness in tried[_KEPT_STARTS:] if _is_mixed(stiffness)][:1]
        followed = []
        for stiffness in kept:
            forward = Forward(model, parameter_space(stiffness, box), ratio)
            u = forward.space.to_scaled(stiffness)
            most = _TRIAL_EVALUATIONS * max(2 * len(stiffness.inclusions) - 1, 1)
            followed.append(self.minimize(forward, u, most))
        best = min(followed, key=lambda minimum: minimum.result.fun)
        if self.progress:
            for step in best.history:
                self.progress(step)
        spent = len(maps) + sum(minimum.nfev for minimum in followed)
        best = replace(best, nfev=spent)
        return best if best.result.success else self.continued(best, best.forward)

    def towards(self, fine: FineModel, minimum: Minimum) -> Correction:
        """Correct the coarse model towards a finer one until the estimate no longer moves."""
        rounds = 0
        while True:
            before, model = minimum.result.x, minimum.forward.model
            coarse, _ = minimum.forward.bare(before)
            corrected, own_error, _ = fine_solution(fine, minimum.map, model, coarse)
            minimum = self.continued(minimum, minimum.forward.rescaled(corrected / coarse))
            minimum = replace(minimum, nfev=minimum.nfev + 1)
            _, jac = self.jacobian(minimum.forward, minimum.result.x)
            # Where the model misfits, its parameters scatter more than the noise says, and the more
            # so the less another round is worth.
            fun, dof = minimum.result.fun, self.table.dof(jac.shape[1])
            misfit = np.sqrt(max(1.0, 2 * fun / dof))
            moved = np.linalg.norm(jac @ (minimum.result.x - before))
            # No minimum is known better than the stop of its search.
            stop = np.sqrt(2 * _GROSS_RTOL * max(fun - self._gross(dof), 0.0))
            settled = bool(moved < max(_SETTLED * misfit * min(misfit, 10.0), stop))
            rounds += 1
            if settled or rounds == (_GROSS_ROUNDS if self.is_gross(minimum) else _FINE_ROUNDS):
                return Correction(minimum, coarse / corrected - 1, own_error, settled)


def _is_mixed(stiffness: GaussianMap) -> bool:
    """Whether a map has hard and soft inclusions."""
    return len({inclusion.weight_pa > 0 for inclusion in stiffness.inclusions}) > 1
