"""All tuning numbers of the analysis, in one record.

A number is a setting if another value would be defensible and would change a result: levels and
thresholds of decisions, sample sizes, limits of searches, accuracies. Machine tolerances, steps of
difference quotients, sizes of caches and constants of published methods stay with their code, and
the grids of an effect belong to the effect.
"""

import json
from dataclasses import asdict, dataclass
from typing import Any

from identify.body.settings import BODY, BodySettings
from identify.design.settings import (
    CONFOUNDERS,
    DETECTION,
    PLAN,
    ConfounderSettings,
    DetectionSettings,
    PlanSettings,
)
from identify.fit.settings import (
    FREE_COMPLIANCE,
    SEARCH,
    FitSettings,
    FreeComplianceSettings,
)
from identify.measurement.settings import (
    LATENT_FORCE,
    NOISE,
    LatentForceSettings,
    NoiseSettings,
)
from identify.select.settings import SELECTION, START, SelectionSettings, StartSettings


@dataclass(frozen=True)
class Settings:
    """Settings of all algorithms.

    Attributes
    ----------
    noise, latent_force : of the measurement model
    body : of the finite element models behind it
    start : of the first fit, with those of a map alone and of the contact law
    search : of map and effects
    free_compliance : of the fit without a map
    selection : of the effects, with those of residual analysis, diagnosis and cross-validation
    detection, confounders, plan : of detection limits, confounders and planned scans
    """

    noise: NoiseSettings = NOISE
    latent_force: LatentForceSettings = LATENT_FORCE
    body: BodySettings = BODY
    start: StartSettings = START
    search: FitSettings = SEARCH
    free_compliance: FreeComplianceSettings = FREE_COMPLIANCE
    selection: SelectionSettings = SELECTION
    detection: DetectionSettings = DETECTION
    confounders: ConfounderSettings = CONFOUNDERS
    plan: PlanSettings = PLAN

    def to_dict(self) -> dict[str, Any]:
        """Return all numbers as in JSON, by algorithm and name."""
        return json.loads(json.dumps(asdict(self)))
