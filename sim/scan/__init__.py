"""A whole scan by the arm: program, presses, first touch, result; and a robot that goes on."""

from sim.scan.outcome import PressOutcome
from sim.scan.path_log import PathResult
from sim.scan.plant_on_robot import Earlier, RobotPlant, plant_on_robot, refuse_plants
from sim.scan.result import PHASES as SERIES_PHASES
from sim.scan.result import Frame, PressResult, PressStatistics, ScanRun, Series
from sim.scan.session import Session
from sim.scan.whole_scan import run_scan

__all__ = [
    "SERIES_PHASES",
    "Earlier",
    "Frame",
    "PathResult",
    "PressOutcome",
    "PressResult",
    "PressStatistics",
    "RobotPlant",
    "ScanRun",
    "Series",
    "Session",
    "plant_on_robot",
    "refuse_plants",
    "run_scan",
]
