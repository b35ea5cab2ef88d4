"""Inclusions that end in an edge, not in a Gaussian's slope."""

from dataclasses import replace
from types import MappingProxyType

from identify.body.state import BodyState
from identify.effects.base import Advice, Effect, EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings


class InclusionEdge(Advice, Effect):
    """A flatter top and a steeper flank of all inclusions of the map, their integral kept."""

    name = "inclusion_edge"
    title = "Edge of the inclusions"
    summary = (
        "The hard or soft spots are bodies with an edge, as a ball in a phantom is, and no smooth "
        "Gaussians. The map then misses their depth, size and stiffness."
    )
    formula = "exp(-q/2) -> exp(-(q/s^2)^(n/2) / 2), q = distance^2/radius^2, edge = 1 - 2/n"
    latex = (
        r"\begin{array}{l} e^{-q/2} \to \exp\left(-\tfrac{1}{2} \left(q / s^2\right)^{n/2}\right) "
        r"\\ q = |\mathbf{r} - \mathbf{c}|^2 / \text{radius}^2, \quad \text{edge} = 1 - 2/n "
        r"\end{array}"
    )
    source = "generalised normal distribution: S. Nadarajah, J. Appl. Stat. 32 (2005) 685-694"
    gives_away = "presses over an inclusion and those around it misfit with opposite signs"
    cure = "None is needed: the edge belongs to the body. Keep the effect in the study."
    parameters = (
        EffectParameter(
            "edge", "1", "0: Gaussian, 1: even ball", 0.0, -0.5, 0.9, 0.3, natural="upper"
        ),
    )  # at 0.9 it is an even ball for the finite elements
    needs = ("several presses",)
    # a ball that is fitted as a Gaussian may end far too narrow, too hard and too shallow
    refitted_from = MappingProxyType({"edge": 0.6})
    examples = (
        WorkedExample(
            "0.8 and a radius of 10 mm: 99.2 % of the weight 10 mm away, nothing at 20 mm.",
            {"edge": 0.8},
            {"point_m": ((0.010, 0.0, 0.0), (0.020, 0.0, 0.0))},
            {"inclusion": (0.9916, 1.8e-4)},
        ),
    )

    def body(self, state: BodyState, *, edge: float) -> BodyState:
        """Give the inclusions an edge."""
        shape = state.inclusion_shape
        return state.changed(inclusion_shape=replace(shape, edge=shape.edge + edge))

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say the shape of the inclusions."""
        edge = values["edge"]
        if edge < 0:
            return (
                f"The map's inclusions are more pointed than Gaussians (edge {edge:.2f}, 0 is the "
                "Gaussian)."
            )
        if edge < 0.5:
            return (
                f"The map's inclusions are flatter at the top than Gaussians, and steeper at the "
                f"flank (edge {edge:.2f}; 0 is the Gaussian, 1 the even ball)."
            )
        return (
            f"The map's inclusions are more like even balls than Gaussians (edge {edge:.2f}; 0 is "
            "the Gaussian, 1 the ball, of 1.55 times the map's radius)."
        )
