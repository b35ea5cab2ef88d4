"""The virtual laboratory: MuJoCo scene, Pinocchio arm, force control, sensors, soft body."""
