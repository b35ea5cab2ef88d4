"""From a Scan to the stiffness map: distribution map, fit, comparison, uncertainty."""

from identify.measurement.experiment import (
    FEWEST_PRESSES,
    BodyModel,
    FieldGuess,
    MapGuess,
    PlacedExperiment,
    Progress,
    contacts_of,
    different_presses,
    silent,
)
from identify.settings import Settings

__all__ = [
    "FEWEST_PRESSES",
    "BodyModel",
    "FieldGuess",
    "MapGuess",
    "PlacedExperiment",
    "Progress",
    "Settings",
    "contacts_of",
    "different_presses",
    "silent",
]
