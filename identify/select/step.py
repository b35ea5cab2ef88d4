"""One step of the ladder of models: a fit, its analysis and diagnosis, and when it leads astray."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from identify.effects.base import Effect
from identify.fit.cross_validation import CrossValidation, cross_validate
from identify.fit.result import FitResult
from identify.measurement.shared_error import correlated
from identify.residual.compare import compare_residual
from identify.residual.comparison import Comparison
from identify.residual.whitened import Whitened, shared_errors, whitened, within_bounds
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


def is_worthwhile(before: FitResult, after: FitResult, least: float) -> bool:
    """Whether a fit takes at least a share of the excess; any does without an excess."""
    return before.chi2 - after.chi2 >= least * (before.chi2 - before.dof)


def hides_lead(before: Step, after: Step, settings: SelectionSettings) -> bool:
    """Whether a step takes away a simple law of the residual, and not what follows that law.

    The law is the lead to the cause: as if the force lagged, say. The cause takes what follows it;
    imitations take a tenth each until nothing of the lead is left.
    """
    law, excess = before.comparison.law, before.fit.chi2 - before.fit.dof
    if law is None or after.comparison.law is not None or after.comparison.is_noise:
        return False
    return before.fit.chi2 - after.fit.chi2 < settings.of_lead * law.share * excess


def foretells_worse(before: Step, after: Step, settings: SelectionSettings) -> bool:
    """Compare the error of presses left out: true if it rises beyond what an effect may.

    An imitation of an unknown cause follows the presses that it has seen. Beside a free map,
    presses are foretold by their neighbours, whatever the effects, unless the map has lost them.
    """
    free = after.fit.field is not None
    most = settings.foretold_rise_beside_field if free else settings.foretold_rise
    return after.cross_validation.rms_m > most * before.cross_validation.rms_m


def replaces_map(before: FitResult, after: FitResult) -> bool:
    """Whether an effect beside a free map has taken the place of the compliances.

    The map gives way until its prior is cheap, and meets the presses worse: with a stiffening of
    free shape a liver's misfit rose by 2 %, and the error of an ordinary press from 7 to 120 %.
    """
    if before.field is None or after.field is None or after.chi2 < before.chi2:
        return False
    return after.field.ordinary_error > before.field.ordinary_error


def whitened_fit(fit: FitResult, scan: Scan) -> Whitened:
    """Return the whitened residual of a joint fit for `compare_residual`."""
    if fit.field is not None:
        return whitened(fit, scan)
    press = fit.model.readings.press
    # The comparison knows the noise alone, not an error of the map (`press_error`)
    inside = fit.at.jacobian[:, within_bounds(fit)]
    absorbed = correlated(inside, fit.at.common_errors, 0 * press)
    absorbed = correlated(absorbed, fit.at.shared_errors, press)
    model = fit.model
    shared, shared_m = shared_errors(
        model.noise, model.readings, model.displacement_m, fit.at.sigma_m
    )
    return Whitened(
        scan=scan.used(),
        residual_m=fit.residual_m,
        sigma_m=fit.at.sigma_m.copy(),
        force_n=fit.at.latent_force_n.copy(),
        absorbed=absorbed,
        noise_estimated=fit.model.noise.estimated,
        shared_m=shared_m,
        shared=shared,
    )
