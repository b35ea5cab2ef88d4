"""Design of scans: detection limits, undetected bias, next presses."""

from identify.design.assessment import Assessment, assess
from identify.design.detection_limits import Limit, detection_limits
from identify.design.geometry_confounders import GeometryConfounder
from identify.design.likeliest_body import likeliest_body
from identify.design.next_presses import Proposal
from identify.design.other_map import OtherMap, other_map
from identify.design.predicted_limits import BetterScans, better_scans
from identify.design.scan_variants import Design, Presses
from identify.design.settings import DETECTION
from identify.design.undetected_bias import UndetectedBias

__all__ = [
    "DETECTION",
    "Assessment",
    "BetterScans",
    "Design",
    "GeometryConfounder",
    "Limit",
    "OtherMap",
    "Presses",
    "Proposal",
    "UndetectedBias",
    "assess",
    "better_scans",
    "detection_limits",
    "likeliest_body",
    "other_map",
]
