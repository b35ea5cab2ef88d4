"""The body moves up and down on its own, and each press counts from its own touch."""

from identify.catalogue.breathing import Breathing
from identify.effects.base import WorkedExample


class BreathingFromTouch(Breathing):
    """One sine over the whole scan, zeroed at the first touch of each press."""

    name = "breathing_from_touch"
    family = "breathing"
    title = "Breathing, counted from each touch"
    order = 101
    counted_from = "touch"
    summary = (
        "The body rises and falls on its own, and each press counts its travel from where it met "
        "the surface. Only the motion since first touch shows."
    )
    formula = (
        "d = u + m(t) - m(t_touch),  m = sine sin(2 pi f t) + cosine cos(2 pi f t),  t since the "
        "scan's first reading"
    )
    latex = (
        r"d = u + m(t) - m(t_{\text{touch}}), \quad m = \text{sine} \cdot \sin(2\pi f t) + "
        r"\text{cosine} \cdot \cos(2\pi f t)"
    )
    gives_away = "the misfit swings with the clock and grows from each touch on"
    examples = (
        WorkedExample(
            "0.1 mm at 0.25 Hz, touch one second before the first reading: the sine was -0.1 mm "
            "there, so that 0.1 mm is added at the first reading and 0.2 mm a second later.",
            {"sine_m": 1e-4, "cosine_m": 0.0, "frequency_hz": 0.25},
            {"time_s": (5.0, 6.0, 7.0, 8.0), "force_n": (0.1, 0.2, 0.3, 0.4), "travel_m": 1e-3},
            {"displacement_m": (1.1e-3, 1.2e-3, 1.1e-3, 1e-3)},
        ),
    )
