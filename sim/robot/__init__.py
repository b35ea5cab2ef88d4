"""The arm: simulation, kinematics, force control, coupling of contact and body."""

from sim.robot.laboratory import Placement, build_laboratory
from sim.robot.mechanism import Mechanism, Mechanisms

__all__ = ["Mechanism", "Mechanisms", "Placement", "build_laboratory"]
