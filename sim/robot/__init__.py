"""The arm: simulation, kinematics, force control, coupling of contact and body."""

from sim.robot.laboratory import Placement, build_laboratory

__all__ = ["Placement", "build_laboratory"]
