"""The body as the measurement model sees it: state, compliances, discretization error."""

from identify.body.chosen_presses import ChosenMechanics
from identify.body.compliance import compliance
from identify.body.discretization_error import MODEL_ERROR
from identify.body.mechanics import BodyMechanics
from identify.body.response import BodyResponse
from identify.body.state import BodyState, ChangedMap

__all__ = [
    "MODEL_ERROR", "BodyMechanics", "BodyResponse", "BodyState", "ChangedMap", "ChosenMechanics",
    "compliance",
]  # fmt: skip
