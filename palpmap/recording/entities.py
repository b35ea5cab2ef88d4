"""What a recording is made of: entity paths, timelines, and which part of the story each one tells.

The recorder writes these paths, the layout shows them, and the summary looks for them.
"""

APPLICATION = "palpmap"

SIM_TIME = "sim_time"  # duration; the iterations follow the last press, one second apart
PRESS = "press"  # sequence; each press at its largest force
ITERATION = "iteration"  # sequence

RUN = "run"
ABOUT = "about"
EVENTS = "events"
FIGURES = "figures"

ROBOT = "world/robot"
BODY = "world/body"
SURFACE = "world/body/surface"
FORCE_ARROW = "world/body/force"
PRESSES_MADE = "world/body/presses"

FORCE = "scan/force_n"
TRAVEL = "scan/displacement_mm"

MEASURED = "presses/measured_mm"
MODELLED = "presses/modelled_mm"
RESIDUAL = "presses/residual_um"

TRUE_MAP = "maps/true"
FOUND_MAP = "maps/found"

MODULI = "fit/modulus_kpa"
LENGTHS = "fit/length_mm"
OTHERS = "fit/other"
RMS = "fit/rms_um"
CHI2 = "fit/chi2_per_dof"
MISFIT = "fit/misfit"

RESIDUAL_MAP = "residuals"

PARTS: dict[str, tuple[str, ...]] = {
    "robot": (ROBOT, FORCE, TRAVEL),
    "body": (SURFACE,),
    "presses": (MEASURED,),
    "truth": (TRUE_MAP,),
    "fit": (FOUND_MAP, RMS, CHI2),
    "comparison": (MODELLED, RESIDUAL, RESIDUAL_MAP),
    "events": (EVENTS,),
    "about": (ABOUT,),
}
"""Part of the story -> the entities (or folders of entities) that a whole recording has for it."""


def parameter_entity(name: str, true: bool = False) -> tuple[str, float]:
    """Entity of a parameter and the factor from SI to the unit that its plot shows.

    Parameters
    ----------
    name : str
        Parameter name; the ending says the unit: ``_pa`` is shown in kPa, ``_m`` in mm.
    true : bool
        Whether the entity is for the true value instead of the estimate.

    Examples
    --------
    >>> parameter_entity("inclusion_1.weight_pa")
    ('fit/modulus_kpa/inclusion_1.weight', 0.001)
    >>> parameter_entity("inclusion_1.x_m", true=True)
    ('fit/length_mm/inclusion_1.x.true', 1000.0)
    """
    ending = ".true" if true else ""
    if name.endswith("_pa"):
        return f"{MODULI}/{name.removesuffix('_pa')}{ending}", 1e-3
    if name.endswith("_m"):
        return f"{LENGTHS}/{name.removesuffix('_m')}{ending}", 1e3
    return f"{OTHERS}/{name}{ending}", 1.0
