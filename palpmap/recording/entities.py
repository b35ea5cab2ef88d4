"""Entity paths, timelines and parts of a recording.

The recorder writes these paths, the layout shows them, and the summary looks for them.
"""

from palpmap.units import scale, unit_of

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
        The entity is for the true value instead of the estimate.

    Examples
    --------
    >>> parameter_entity("inclusion_1.weight_pa")
    ('fit/modulus_kpa/inclusion_1.weight', 0.001)
    >>> parameter_entity("inclusion_1.x_m", true=True)
    ('fit/length_mm/inclusion_1.x.true', 1000.0)
    """
    ending = ".true" if true else ""
    factor, shown = scale(unit_of(name))
    folder = {"kPa": MODULI, "mm": LENGTHS}.get(shown)
    if folder is None:
        return f"{OTHERS}/{name}{ending}", factor
    return f"{folder}/{name.rpartition('_')[0]}{ending}", factor
