"""Assumptions of a fit, in sentences for the report."""

from collections.abc import Iterator, Sequence

import numpy as np

from identify.fit import FitResult
from identify.measurement import EffectInModel
from palpmap.study.frame import frame_shift_m
from palpmap.study.study import Study

SMALL_STRAIN = 0.1


def limits_of(
    fit: FitResult, study: Study, displacement_m: np.ndarray, height_m: float
) -> tuple[str, ...]:
    """Return the assumptions of the result in sentences."""
    limits = [
        "The map is a background and Gaussian inclusions; other shapes are only approximated."
        if fit.field is None
        else "The map has any shape that is as smooth as the scan asks; where the scan is blind, "
        "it is the prior's guess.",
        f"Poisson's ratio {study.body.poisson_ratio:g} was given, not found.",
        "The intervals count the noise"
        + ("" if fit.model_error is None or fit.field else " and the mesh's own error")
        + ", not physics that the model leaves out.",
    ]
    deepest = float(np.max(displacement_m))
    share = deepest / height_m
    text = (
        f"The model is linear in the force. The deepest press reaches {1e3 * deepest:.2g} mm, "
        f"{100 * share:.2g} % of the body's height"
    )
    beyond = ", more than small strain bears: expect errors of that order"
    limits.append(text + (beyond if share > SMALL_STRAIN else "") + ".")
    if study.body.shape == "surface":
        limits.append(
            "Meshes of one closed surface differ by about 0.3 % in compliance, as each "
            "cuts the surface's curves elsewhere; small tips on strongly curved places feel the "
            "facets more, up to some percent."
        )
    if study.body.thickness_assumed:
        limits.append("The body's thickness was assumed; moduli and depths scale with it.")
    if study.body.project_points:
        limits.append("A block stands in for a curved body.")
    if study.probe.tip == "sphere":
        limits.append("The tip is a sphere: its contact grows with the force.")
    if fit.discretization_error is not None:
        largest = float(np.max(np.abs(fit.discretization_error)))
        limits.append(
            f"The coarse mesh is off the finer model by up to {100 * largest:.2g} %; this was "
            "corrected, and the error of the finer one "
            + ("widens the intervals." if fit.field is None else "is not counted on its own.")
        )
    else:
        limits.append("No finer model was compared: the mesh's own error is not counted.")
    if fit.noise.estimated:
        limits.append("Noise that the study does not give was estimated from the scan.")
    return tuple(limits)


def starts_beyond(
    effects: Sequence[EffectInModel], study: Study, origin_m: np.ndarray
) -> Iterator[str]:
    """Yield a sentence for each start of a study's effect that is beyond its bounds in the scan.

    Parameters
    ----------
    effects : of the model, whose positions are in the body's frame
    origin_m : (3,) added to a position it gives the scan's frame
    """
    stated = {entry.name: entry.initial for entry in study.effects}
    for part in effects:
        name = part.effect.name
        for p in part.parameters:
            if p.name not in stated.get(name, {}):
                continue
            start, shift = stated[name][p.name], frame_shift_m(f"{name}.{p.name}", origin_m)
            begun = min(max(start, p.lower + shift), p.upper + shift)
            if abs(start - begun) > 1e-9 * abs(start):
                yield (
                    f"The search for {name} began at {p.name} = {begun:.4g}, as the study's "
                    f"{start:.4g} is beyond what this scan bears ({p.lower + shift:.4g} to "
                    f"{p.upper + shift:.4g})."
                )
