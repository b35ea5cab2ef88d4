"""One step of the ladder of models: a fit, and what its residual calls for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from identify.effects.base import Effect
from identify.fit.cross_validation import CrossValidation, cross_validate
from identify.fit.result import FitResult
from identify.measurement.model import correlated
from identify.residual.compare import compare_residual
from identify.residual.comparison import Comparison
from identify.residual.whitened import Whitened
from identify.select.diagnosis import Diagnosis, diagnose
from models.scan import Scan


@dataclass(frozen=True)
class Step:
    """One step of the ladder: a model, how well it does, and what its residual calls for."""

    fit: FitResult
    comparison: Comparison
    cross_validation: CrossValidation
    diagnosis: Diagnosis


def step_of(
    fit: FitResult,
    scan: Scan,
    catalogue: Sequence[Effect],
    seed: int,
    say: Callable[[str], None],
) -> Step:
    """Judge a fit: its residual, its predictions, and what it lacks."""
    say("judging what is left")
    comparison = compare_residual(whitened_fit(fit, scan))
    diagnosis = diagnose(fit, catalogue, seed=seed, progress=lambda name: say(f"scoring {name}"))
    return Step(fit, comparison, cross_validate(fit), diagnosis)


def whitened_fit(fit: FitResult, scan: Scan) -> Whitened:
    """Return the residual of a joint fit in the form in which `compare` judges it."""
    return Whitened(
        scan=scan.used(),
        residual_m=fit.residual_m,
        sigma_m=fit.at.sigma_m.copy(),
        force_n=fit.at.latent_force_n.copy(),
        # The comparison knows the noise alone, not an error of the map (`press_error`)
        absorbed=correlated(fit.at.jacobian, fit.at.own, fit.model.readings.press).copy(),
        noise_estimated=fit.model.noise.estimated,
    )
