"""The residual for the tests: parameters projected out, scaled, with all directions."""

from dataclasses import dataclass

import numpy as np

from identify.residual.directions import DIMENSIONS, common
from identify.residual.hypothesis_tests import extended, orthonormal, project_out
from identify.residual.per_press import bad_presses
from identify.residual.settings import RESIDUAL, ResidualSettings
from identify.residual.whitened import Whitened
from models import InputError


@dataclass(frozen=True)
class ResidualView:
    """Input of all tests, computed once.

    Attributes
    ----------
    residual : (m,)
        Whitened residual without its part along the fitted parameters, in units of `scale`.
    absorbed, beyond, smooth : (m, .)
        Orthonormal bases: the fitted parameters; these with an offset and a gain common to all
        readings; these with all smooth patterns.
    directions, untestable : dict
        Directions of each dimension; the reason against a test of the others.
    bad : list of int
        Indices of outlying presses, beyond all smooth patterns.
    chi2, dof : float, int
        Of the unscaled residual; of the fit, where that has its own (`Whitened.size`).
    scatter, scale : float
        Reading-to-reading scatter in units of the noise given; the larger of it and 1 where it is
        surely larger, else 1.
    settings : ResidualSettings
        Of the tests.
    """

    w: Whitened
    residual: np.ndarray
    absorbed: np.ndarray
    beyond: np.ndarray
    smooth: np.ndarray
    directions: dict[str, np.ndarray]
    untestable: dict[str, str]
    bad: list[int]
    chi2: float
    dof: int
    scatter: float
    scale: float
    settings: ResidualSettings = RESIDUAL

    def nuisance(self, name: str) -> np.ndarray:
        """Return the nuisance of a dimension's test: a common offset belongs to the force."""
        return self.absorbed if name == "force" else self.beyond


def residual_view(w: Whitened, settings: ResidualSettings = RESIDUAL) -> ResidualView:
    """Project, scale and lay out the directions of a whitened residual."""
    absorbed = orthonormal(w.apart(w.absorbed))
    dof = len(w.residual_m) - absorbed.shape[1]
    if dof < 1:
        raise InputError(
            f"{len(w.residual_m)} readings cannot be compared with a model of "
            f"{absorbed.shape[1]} parameters; take more readings or fix parameters"
        )
    residual = project_out(absorbed, w.whitened)
    scatter, certain = reading_scatter(w, settings)
    scale = scatter if certain and scatter > 1 else 1.0
    beyond = extended(absorbed, w.apart(common(w)))
    directions, untestable = {}, {}
    for dimension in DIMENSIONS:
        result = dimension.directions(w, settings)
        if isinstance(result, str):
            untestable[dimension.name] = result
        else:
            directions[dimension.name] = w.apart(result)
    chi2 = float(residual @ residual)
    if w.size is not None:
        chi2, dof = w.size
    smooth = extended(beyond, np.hstack([np.zeros((len(beyond), 0)), *directions.values()]))
    return ResidualView(
        w=w,
        residual=residual / scale,
        absorbed=absorbed,
        beyond=beyond,
        smooth=smooth,
        directions=directions,
        untestable=untestable,
        bad=bad_presses(w, smooth, scale, settings),
        chi2=chi2,
        dof=dof,
        scatter=scatter,
        scale=scale,
        settings=settings,
    )


def reading_scatter(w: Whitened, settings: ResidualSettings = RESIDUAL) -> tuple[float, bool]:
    """Reading-to-reading scatter in units of the noise, and True for one that is surely not 1.

    From second differences within presses, which contain noise, but no slow misfit of the model.
    """
    inner = w.follows.copy()
    inner[:-1] &= w.follows[1:]
    inner[-1:] = False
    at = np.flatnonzero(inner)
    if len(at) < settings.least_differences:
        return 1.0, False
    r = w.whitened
    variance = float(np.mean((r[at - 1] - 2 * r[at] + r[at + 1]) ** 2) / 6)
    # Variance of that estimate for white noise: 2 (1 + 2 (4/6)^2 + 2 (1/6)^2) / n = 35/9/n.
    deviation = (variance - 1) / np.sqrt(35 / 9 / len(at))
    return float(np.sqrt(variance)), abs(deviation) > settings.scatter_sigmas
