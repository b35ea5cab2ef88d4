"""The body as the measurement model sees it: state, compliances, discretization error."""

from identify.body.compliance import compliance
from identify.body.discretization_error import MODEL_ERROR
from identify.body.mechanics import BodyMechanics
from identify.body.state import BodyState, ChangedMap

__all__ = ["MODEL_ERROR", "BodyMechanics", "BodyState", "ChangedMap", "compliance"]
