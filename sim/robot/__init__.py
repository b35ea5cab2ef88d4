"""The arm: simulation, kinematics, force control, coupling of contact and body."""

from sim.robot.laboratory import build_laboratory

__all__ = ["build_laboratory"]
