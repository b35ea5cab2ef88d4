"""The scene of a plan: its body, the widest tip, the arm and the obstacles, compiled."""

from models import read_arm
from sim.motion.scan_plan import ScanPlan
from sim.motion.settings import ScanSettings
from sim.robot.laboratory import Laboratory, build_laboratory


def plan_scene(plan: ScanPlan, settings: ScanSettings) -> Laboratory:
    """Compile the scene in which a plan is carried out.

    Raises
    ------
    InputError
        The arm of the settings cannot be read, or the scene cannot be built.
    """
    return build_laboratory(
        plan.widest_m,
        plan.body_size_m,
        plan.body_in_world,
        settings.timestep_s,
        plan.round_tips,
        read_arm(settings.arm),
        settings.obstacles,
    )
