"""Motion of the arm: planner, clearance, paths, scripted motions; the surface it moves over."""

from sim.motion.body_surface import BodySurface
from sim.motion.depth_check import beyond_limits, lowered
from sim.motion.planned_motion import Motion, Refusal, refuse
from sim.motion.planner import plan_motion
from sim.motion.scan_plan import ScanPlan, program_plan
from sim.motion.scene import plan_scene
from sim.motion.settings import ScanSettings
from sim.motion.tip import Tip, read_tips

__all__ = [
    "BodySurface",
    "Motion",
    "Refusal",
    "ScanPlan",
    "ScanSettings",
    "Tip",
    "beyond_limits",
    "lowered",
    "plan_motion",
    "plan_scene",
    "program_plan",
    "read_tips",
    "refuse",
]
