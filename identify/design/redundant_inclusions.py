"""Redundant inclusions of a map."""

from dataclasses import replace

from identify.design.settings import CONFOUNDERS, ConfounderSettings
from identify.fit.joint_fit import try_fit
from identify.fit.result import FitResult
from identify.map.gaussian_map import GaussianMap
from identify.map.parameters import parameter_space


def redundant_inclusions(
    fit: FitResult, settings: ConfounderSettings = CONFOUNDERS
) -> tuple[int, ...]:
    """Numbers, from one, of the inclusions without which the model does as well.

    Without such an inclusion, everything else fitted again, chi-square rises by less than the price
    of its parameters (Bayesian information criterion). Tested are those with a parameter at its
    bound, or an uncertain weight. Returns nothing if the model contains an inclusion-shape effect.
    """
    if any(name.startswith("inclusion_") for name in fit.effect_names):
        return ()
    return tuple(
        number
        for number in range(1, len(fit.map.inclusions) + 1)
        if _is_uncertain(fit, number, settings) and _is_redundant(fit, number)
    )


def _is_uncertain(fit: FitResult, number: int, settings: ConfounderSettings) -> bool:
    weight = f"inclusion_{number}.weight_pa"
    held = any(name.startswith(f"inclusion_{number}.") for name in fit.at_bound)
    return held or settings.sure_sigmas * fit.std.get(weight, 0.0) > abs(fit.values[weight])


def _is_redundant(fit: FitResult, number: int) -> bool:
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
