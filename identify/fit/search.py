"""Minimisation of chi-square under a held correction, with its history."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from identify.fit.settings import FitSettings
from identify.measurement.linearised import Compressed, Linearised
from identify.measurement.model import MeasurementModel
from identify.optimize.gauss_newton import minimize_gauss_newton
from identify.optimize.optimizers import Optimizer
from identify.optimize.result import OptimizeResult


@dataclass(frozen=True)
class FitIteration:
    """One accepted step: all parameters of the map by name, chi-square, rms of residual in m."""

    iteration: int
    parameters: Mapping[str, float]
    chi2: float
    chi2_per_dof: float
    rms_m: float


Point = Compressed | Linearised
Progress = Callable[[FitIteration], None]


class Search:
    """Minimises chi-square, counts evaluations, and keeps the accepted steps.

    Attributes
    ----------
    settings : accuracy and limits
    optimizer : None takes Gauss-Newton with the longest sensible steps
    progress : called with each accepted step
    spent : evaluations of the finite element models so far
    history : accepted steps so far
    is_final : the tolerances are those of a record; they are not while it is sought
    """

    def __init__(
        self,
        settings: FitSettings,
        optimizer: Optimizer | None = None,
        progress: Progress | None = None,
    ) -> None:
        self.settings, self.optimizer, self.progress = settings, optimizer, progress
        self.spent = 0
        self.history: list[FitIteration] = []
        self._slack, self.is_final = settings.slack, False
        self._latest: tuple[MeasurementModel, bytes, Point] | None = None
        self._reported: tuple[MeasurementModel, bytes] | None = None

    def continue_from(self, other: Search) -> None:
        """Take over the history of another search, and report it."""
        self.history, self._reported = list(other.history), other._reported
        if self.progress:
            for step in self.history:
                self.progress(step)

    def finish(self) -> None:
        """Take the tolerances of a record from here on."""
        self.is_final, self._latest = True, None
        self._loosen(1.0)

    def finished(
        self, model: MeasurementModel, result: OptimizeResult, radius: float = np.inf
    ) -> tuple[OptimizeResult, Point]:
        """Return the minimum at the end of a search, by the tolerances of a record if it is one."""
        if not self.settings.confirmed or self.is_final:
            return result, self.evaluate(model, result.x)
        self.finish()
        return self.minimum(model, result.x, radius)

    def evaluate(self, model: MeasurementModel, u: np.ndarray) -> Point:
        """Return the model at scaled coordinates u (k,), the last one from memory."""
        known = self._latest
        if known is None or known[0] is not model or known[1] != u.tobytes():
            self.spent += 1
            known = self._latest = (model, u.tobytes(), model.evaluate(u, self._slack))
        return known[2]

    def linearise(self, model: MeasurementModel, u: np.ndarray) -> Linearised:
        """Return the model at scaled coordinates u (k,), reading by reading.

        By the full model, unless the settings say otherwise.
        """
        if self.settings.confirmed:
            return model.linearise(u)
        at = self.evaluate(model, u)
        return at if isinstance(at, Linearised) else model.linearise(u, self._slack)

    def corrected(self, model: MeasurementModel, u: np.ndarray) -> MeasurementModel:
        """Return the model carried to the finer one at scaled coordinates u (k,)."""
        self.spent += 1
        return model.corrected(u, self._slack)

    def gross(self, model: MeasurementModel) -> float:
        """Half of chi-square from which on a misfit is gross."""
        dof = max(len(model.displacement_m) - len(model.names), 1)
        return 0.5 * dof * self.settings.gross_misfit**2

    def minimum(
        self,
        model: MeasurementModel,
        u: np.ndarray,
        radius: float = np.inf,
        held: int | None = None,
    ) -> tuple[OptimizeResult, Point]:
        """Minimise from scaled coordinates u (k,); the result's `x` is (k,) too.

        Parameters
        ----------
        radius : distance that no coordinate of the map goes beyond
        held : position of an unknown that stays where it is
        """
        s, mapped = self.settings, len(model.space.free)
        low, high = (bound.copy() for bound in model.bounds)
        low[:mapped] = np.maximum(low[:mapped], u[:mapped] - radius)
        high[:mapped] = np.minimum(high[:mapped], u[:mapped] + radius)
        sought = np.arange(len(u)) != (-1 if held is None else held)
        usual = self.gross(model)
        chi2 = self.evaluate(model, u).chi2
        above, rtol = (usual, s.gross_rtol) if 0.5 * chi2 > usual else (0.0, s.rtol)
        reach = 0.0
        if s.target is not None and chi2 > s.target:
            above, rtol, reach = 0.5 * s.target, s.of_gap, s.reach
        self._loosen(chi2 / len(model.displacement_m))
        rms: dict[bytes, float] = {}

        def whole(x: np.ndarray) -> np.ndarray:
            place = u.copy()
            place[sought] = x
            return place

        def residuals(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            at = self.evaluate(model, whole(x))
            rms[x.tobytes()] = at.rms_m
            return at.residual, -at.jacobian[:, sought]

        optimizer = self.optimizer or partial(
            minimize_gauss_newton,
            max_step=model.unknowns.longest_step(u)[sought],
            enough=0.5 * s.enough,
            reach=reach,
        )
        result = optimizer(
            residuals,
            u[sought],
            bounds=(low[sought], high[sought]),
            ftol=s.ftol,
            rtol=rtol,
            above=above,
            max_evaluations=s.max_evaluations,
            callback=lambda x, fun: self._accept(model, whole(x), 2 * fun, rms[x.tobytes()]),
        )
        result = replace(result, x=whole(result.x))
        return result, self.evaluate(model, result.x)

    def _loosen(self, chi2_per_reading: float) -> None:
        """Let reduced bases err by a share of the misfit where it exceeds the noise."""
        s = self.settings
        misfit = float(min(np.sqrt(max(chi2_per_reading, 1.0)), s.most_misfit_slack))
        self._slack = 1.0 if self.is_final else misfit * s.slack

    def _accept(self, model: MeasurementModel, u: np.ndarray, chi2: float, rms_m: float) -> None:
        """Keep a step, unless a search goes on from where the last one ended."""
        if self._reported is not None:
            before, place = self._reported
            if before is model and place == u.tobytes():
                return
        self._reported = (model, u.tobytes())
        stiffness = model.map(u)
        values = dict(zip(stiffness.names, stiffness.values.tolist(), strict=True))
        dof = max(len(model.displacement_m) - len(u), 1)
        self.history.append(FitIteration(len(self.history), values, chi2, chi2 / dof, rms_m))
        if self.progress:
            self.progress(self.history[-1])
