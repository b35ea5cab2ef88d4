"""Motion of the arm: planner, clearance, paths, scripted motions."""

from sim.motion.scan_plan import ScanPlan, program_plan
from sim.motion.settings import ScanSettings

__all__ = ["ScanPlan", "ScanSettings", "program_plan"]
