"""Inclusions of a map that the readings do not ask for."""

from __future__ import annotations

from dataclasses import replace

from identify.fit.joint_fit import try_fit
from identify.fit.result import FitResult
from identify.map.gaussian_map import GaussianMap
from identify.map.parameters import parameter_space

_SURE = 5.0  # standard errors of its weight: such an inclusion is there


def redundant_inclusions(fit: FitResult) -> tuple[int, ...]:
    """Numbers, from one, of the inclusions without which the model does as well.

    Without such an inclusion, everything else fitted again, chi-square rises by less than what its
    free numbers cost (Bayesian information criterion). Looked at are those with a number at its
    bound, or a weight that is not sure. None are where an effect tells the inclusions' shape.
    """
    if any(name.startswith("inclusion_") for name in fit.effect_names):
        return ()
    return tuple(
        number
        for number in range(1, len(fit.map.inclusions) + 1)
        if _is_doubtful(fit, number) and _is_unseen(fit, number)
    )


def _is_doubtful(fit: FitResult, number: int) -> bool:
    weight = f"inclusion_{number}.weight_pa"
    held = any(name.startswith(f"inclusion_{number}.") for name in fit.at_bound)
    return held or _SURE * fit.std.get(weight, 0.0) > abs(fit.values[weight])


def _is_unseen(fit: FitResult, number: int) -> bool:
    space, found = fit.model.space, fit.map
    kept = [i for i in range(1, len(found.inclusions) + 1) if i != number]
    stiffness = GaussianMap(found.background_pa, tuple(found.inclusions[i - 1] for i in kept))
    was = {f"inclusion_{new}": f"inclusion_{old}" for new, old in enumerate(kept, start=1)}
    free = []
    for name in stiffness.names:
        inclusion, dot, value = name.partition(".")
        if was.get(inclusion, inclusion) + dot + value in space.names:
            free.append(name)
    fewer = parameter_space(stiffness, fit.model.mechanics.coarse.mesh.box_m, free)
    without = try_fit(replace(fit.model, space=fewer), stiffness, rounds=0)
    return without is not None and without.bic <= fit.bic
