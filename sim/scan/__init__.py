"""A whole scan by the arm: program, presses, first touch, result."""

from sim.scan.outcome import PressOutcome
from sim.scan.plant_on_robot import RobotPlant, plant_on_robot
from sim.scan.result import Frame, PressResult, PressStatistics, ScanRun
from sim.scan.scan_program import run_scan

__all__ = [
    "Frame",
    "PressOutcome",
    "PressResult",
    "PressStatistics",
    "RobotPlant",
    "ScanRun",
    "plant_on_robot",
    "run_scan",
]
