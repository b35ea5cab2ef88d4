"""Inclusions of a fitted map that the readings do not show."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from fem import SolverError
from identify.fit.search import Search
from identify.fit.settings import SEARCH, FitSettings
from identify.map.gaussian_map import GaussianMap
from identify.map.parameters import parameter_space
from identify.measurement.linearised import Linearised
from identify.measurement.model import MeasurementModel
from identify.optimize.gauss_newton import covariance
from identify.optimize.result import InadmissibleError

_SURE = 100.0  # chi-square that no end of a search brings: tolerances are thousandths


def unseen_inclusions(
    model: MeasurementModel, u: np.ndarray, at: Linearised, settings: FitSettings = SEARCH
) -> tuple[int, ...]:
    """Numbers, from one, of the inclusions without all of which the model does as well.

    Without such an inclusion, everything else fitted again, chi-square rises by less than the price
    of its parameters (Bayesian information criterion). They go one after the other, the least
    missed first: of two inclusions that stand for one, only one is unseen. Tested are those with a
    parameter at its bound, or an uncertain weight. Returns nothing of a free map, and where the
    model contains an inclusion-shape effect.

    Parameters
    ----------
    u, at : (k,) scaled estimate, and the model there
    """
    stiffness = model.map(u)
    if not isinstance(stiffness, GaussianMap) or any(
        name.startswith("inclusion_") for name in model.effect_names
    ):
        return ()
    end = _End(model, u, at)
    kept, unseen = list(range(1, len(stiffness.inclusions) + 1)), []
    while True:
        ends = {i: one for i in end.uncertain(settings) if (one := end.without(i, settings))}
        least = min(ends, key=lambda i: ends[i].bic, default=None)
        if least is None or ends[least].bic > end.bic:
            return tuple(sorted(unseen))
        end = ends[least]
        unseen.append(kept.pop(least))


@dataclass(frozen=True, eq=False)
class _End:
    """A minimum: model, scaled coordinates (k,), and the model there."""

    model: MeasurementModel
    u: np.ndarray
    at: Linearised

    @property
    def bic(self) -> float:
        return self.at.chi2 + len(self.u) * float(np.log(len(self.at.residual)))

    def uncertain(self, settings: FitSettings) -> Iterator[int]:
        """Yield the indices of the inclusions at a bound, or with an uncertain weight."""
        deviation = np.sqrt(np.diag(covariance(self.at.jacobian)))
        deviation = deviation * self.model.unknowns.slope(self.u)
        std = dict(zip(self.model.names, deviation.tolist(), strict=True))
        held = self.model.started(self.u).unknowns.at_bound(self.u)
        for i, inclusion in enumerate(self.model.map(self.u).inclusions):
            name = f"inclusion_{i + 1}."
            wide = settings.sure_sigmas * std.get(name + "weight_pa", 0.0)
            if wide > abs(inclusion.weight_pa) or any(one.startswith(name) for one in held):
                yield i

    def without(self, at: int, settings: FitSettings) -> _End | None:
        """Fit again without an inclusion; held parameters stay held. None where that fails."""
        whole, space = self.model.map(self.u), self.model.space
        kept = [i for i in range(len(whole.inclusions)) if i != at]
        stiffness = GaussianMap(whole.background_pa, tuple(whole.inclusions[i] for i in kept))
        was = {f"inclusion_{new}": f"inclusion_{old + 1}" for new, old in enumerate(kept, start=1)}
        free = []
        for name in stiffness.names:
            inclusion, dot, value = name.partition(".")
            if was.get(inclusion, inclusion) + dot + value in space.names:
                free.append(name)
        coarse = self.model.mechanics.coarse
        fewer = parameter_space(stiffness, coarse.mesh.box_m, free, coarse.probed_m)
        model, search = replace(self.model.started(self.u), space=fewer), Search(settings)
        try:
            result, found = search.minimum(model, model.start(stiffness))
            price = len(self.u) * float(np.log(len(self.at.residual)))
            if found.chi2 < self.at.chi2 + price + _SURE:
                result, _ = search.finished(model, result)
            return _End(model, result.x, search.linearise(model, result.x))
        except (InadmissibleError, SolverError):
            return None
