"""The arm: simulation, kinematics, force control, coupling of contact and body."""
