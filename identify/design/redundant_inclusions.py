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
    """Numbers, from one, of the inclusions without all of which the model does as well.

    Without such an inclusion, everything else fitted again, chi-square rises by less than the price
    of its parameters (Bayesian information criterion). They go one after the other, the least
    missed first: of two inclusions that stand for one, only one is redundant. Tested are those with
    a parameter at its bound, or an uncertain weight. Returns nothing if the model contains an
    inclusion-shape effect.
    """
    if any(name.startswith("inclusion_") for name in fit.effect_names):
        return ()
    kept, redundant = list(range(1, len(fit.map.inclusions) + 1)), []
    while True:
        uncertain = [at for at in range(len(kept)) if _is_uncertain(fit, at + 1, settings)]
        fits = {at: without for at in uncertain if (without := _without(fit, at)) is not None}
        least = min(fits, key=lambda at: fits[at].bic, default=None)
        if least is None or fits[least].bic > fit.bic:
            return tuple(sorted(redundant))
        fit = fits[least]
        redundant.append(kept.pop(least))


def _is_uncertain(fit: FitResult, number: int, settings: ConfounderSettings) -> bool:
    weight = f"inclusion_{number}.weight_pa"
    held = any(name.startswith(f"inclusion_{number}.") for name in fit.at_bound)
    return held or settings.sure_sigmas * fit.std.get(weight, 0.0) > abs(fit.values[weight])


def _without(fit: FitResult, at: int) -> FitResult | None:
    """Fit again without the inclusion at this index; held parameters stay held."""
    space, found = fit.model.space, fit.map
    kept = [i for i in range(len(found.inclusions)) if i != at]
    stiffness = GaussianMap(found.background_pa, tuple(found.inclusions[i] for i in kept))
    was = {f"inclusion_{new}": f"inclusion_{old + 1}" for new, old in enumerate(kept, start=1)}
    free = []
    for name in stiffness.names:
        inclusion, dot, value = name.partition(".")
        if was.get(inclusion, inclusion) + dot + value in space.names:
            free.append(name)
    fewer = parameter_space(stiffness, fit.model.mechanics.coarse.mesh.box_m, free)
    return try_fit(replace(fit.model, space=fewer), stiffness, rounds=0)
