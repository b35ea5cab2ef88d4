"""The palpation model: compliance of each press and its derivatives by the modulus."""

from fem.palpation.fibres import fibre_weights
from fem.palpation.response import Response
from fem.palpation.richardson import RefinedResponse, remaining_error
from fem.palpation.rigid_punch import by_contact_radius, shape_gain, travel_under

__all__ = [
    "RefinedResponse",
    "Response",
    "by_contact_radius",
    "fibre_weights",
    "remaining_error",
    "shape_gain",
    "travel_under",
]
