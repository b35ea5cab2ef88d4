"""The body moves along a wave that is no sine, and each press counts from its own touch."""

from identify.catalogue.breathing_harmonics import BreathingHarmonics
from identify.effects.base import WorkedExample


class BreathingHarmonicsFromTouch(BreathingHarmonics):
    """The same, zeroed at the first touch of each press."""

    name = "breathing_harmonics_from_touch"
    family = "breathing"
    title = "Breathing with harmonics, counted from each touch"
    order = 103
    counted_from = "touch"
    summary = (
        "The body rises and falls on its own, along a wave that is not a sine, and each press "
        "counts its travel from where it met the surface. Only the motion since touch shows."
    )
    formula = (
        "d = u + m(t) - m(t_touch),  m = sum over n = 1, 2, 3 of sine_n sin(2 pi n f t) + cosine_n "
        "cos(2 pi n f t)"
    )
    latex = (
        r"d = u + m(t) - m(t_{\text{touch}}), \quad m = \sum_{n=1}^{3} \text{sine}_n "
        r"\sin(2\pi n f t) + \text{cosine}_n \cos(2\pi n f t)"
    )
    gives_away = "the misfit swings with the clock, not along a sine, and grows from each touch on"
    examples = (
        WorkedExample(
            "As breathing_harmonics, touch one second before the first reading: the wave was at "
            "0.15 mm less than nothing there, which is added to all readings.",
            BreathingHarmonics.examples[0].values,
            {"time_s": (5.0, 6.0, 7.0, 8.0), "force_n": (0.1, 0.2, 0.3, 0.4), "travel_m": 1e-3},
            {"displacement_m": (1.2e-3, 1.2e-3, 1.2e-3, 1.0e-3)},
        ),
    )
