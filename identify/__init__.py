"""From a Scan to the stiffness map: distribution map, fit, comparison, uncertainty."""

from identify.experiment import (
    FEWEST_PRESSES,
    BodyModel,
    Experiment,
    FieldGuess,
    MapGuess,
    Progress,
    contacts_of,
    different_presses,
    silent,
)
from identify.settings import Settings

__all__ = [
    "FEWEST_PRESSES",
    "BodyModel",
    "Experiment",
    "FieldGuess",
    "MapGuess",
    "Progress",
    "Settings",
    "contacts_of",
    "different_presses",
    "silent",
]
