"""One step of the ladder of models: a fit, its residual analysis and its diagnosis."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from identify.effects.base import Effect
from identify.fit.cross_validation import CrossValidation, cross_validate
from identify.fit.result import FitResult
from identify.measurement.shared_error import correlated
from identify.residual.compare import compare_residual
from identify.residual.comparison import Comparison
from identify.residual.whitened import Whitened, shared_errors, whitened
from identify.select.diagnosis import Diagnosis, diagnose
from identify.select.settings import SELECTION, SelectionSettings
from models import Scan


@dataclass(frozen=True)
class Step:
    """One step of the ladder: a fit, its residual analysis, cross-validation and diagnosis."""

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
    settings: SelectionSettings = SELECTION,
) -> Step:
    """Analyse a fit: its residual, its predictions and its missing effects."""
    say("analysing the residual")
    comparison = compare_residual(whitened_fit(fit, scan), settings.residual)
    diagnosis = diagnose(
        fit,
        catalogue,
        seed=seed,
        progress=lambda name: say(f"scoring {name}"),
        settings=settings.diagnosis,
    )
    return Step(fit, comparison, cross_validate(fit, settings.cross_validation), diagnosis)


def whitened_fit(fit: FitResult, scan: Scan) -> Whitened:
    """Return the whitened residual of a joint fit for `compare_residual`."""
    if fit.field is not None:
        return whitened(fit, scan)
    press = fit.model.readings.press
    # The comparison knows the noise alone, not an error of the map (`press_error`)
    absorbed = correlated(fit.at.jacobian, fit.at.common_errors, 0 * press)
    absorbed = correlated(absorbed, fit.at.shared_errors, press)
    model = fit.model
    directions, shared_m = shared_errors(model.noise, model.readings, model.displacement_m)
    absorbed = np.hstack([absorbed, directions / fit.at.sigma_m[:, None]])
    return Whitened(
        scan=scan.used(),
        residual_m=fit.residual_m,
        sigma_m=fit.at.sigma_m.copy(),
        force_n=fit.at.latent_force_n.copy(),
        absorbed=absorbed,
        noise_estimated=fit.model.noise.estimated,
        shared_m=shared_m,
    )
