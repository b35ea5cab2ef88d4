"""Fibres in the plane of the surface."""

import math

import numpy as np

from identify.body.state import BodyState
from identify.effects.base import Effect, EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.units import percent

_DIRECTIONS = 16  # over half a turn: neighbours are alike by 0.86, the background projected out


class Anisotropy(Effect):
    """One family of fibres, the same everywhere, with energy beside that of the matrix."""

    name = "anisotropy"
    title = "Fibres (anisotropy)"
    summary = (
        "The body is stiffer along one direction in the plane, as muscle is along its fibres. "
        "The dimple under a tip is then an ellipse, and edges and inclusions act differently "
        "along and across."
    )
    formula = "energy density + (share E / 2) (a . strain . a)^2,  a = (cos angle, sin angle, 0)"
    latex = (
        r"\begin{array}{l} W \to W + \frac{\text{share} \cdot E}{2} \left(\mathbf{a} \cdot "
        r"\boldsymbol{\varepsilon} \, \mathbf{a}\right)^2 \\ \mathbf{a} = (\cos(\text{angle}), \, "
        r"\sin(\text{angle}), \, 0) \end{array}"
    )
    source = (
        "A. J. M. Spencer, Continuum Theory of the Mechanics of Fibre-Reinforced Composites, "
        "Springer 1984"
    )
    gives_away = "places near an edge or an inclusion misfit differently along x than along y"
    cure = "Press close to all four edges, or with a long narrow tip turned by 90 degrees."
    parameters = (
        EffectParameter(
            "fibre_share", "1", "fibre stiffness over the matrix's E", 0.0, -0.9, 50.0, 0.5
        ),
        EffectParameter(
            "angle_rad", "rad", "fibres to the x axis; half a turn is none", None,
            -math.pi / 2, 1.5 * math.pi, math.pi / 4,
        ),
    )  # fmt: skip
    needs = ("several presses",)
    examples = (
        WorkedExample(
            "Fibres half as stiff as the matrix, at 30 degrees.",
            {"fibre_share": 0.5, "angle_rad": math.pi / 6},
            {},
            {"fibre_share": 0.5, "fibre_angle_rad": 0.5235988},
        ),
    )

    def body(self, state: BodyState, *, fibre_share: float, angle_rad: float) -> BodyState:
        """Give the body fibres."""
        return state.changed(fibre_share=fibre_share, fibre_angle_rad=angle_rad)

    def grid(self, readings: Readings, state: BodyState) -> list[Values]:
        """Directions over half a turn, 11 degrees apart; the bounds leave room beyond both ends."""
        angles = np.arange(_DIRECTIONS) * math.pi / _DIRECTIONS
        return [{"angle_rad": float(angle)} for angle in angles]

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say along which direction the body is stiffer."""
        share = values["fibre_share"]
        stiffer = "stiffer" if share >= 0 else "softer"
        angle = math.degrees(values["angle_rad"]) % 180
        return (
            f"The body is {stiffer} along one direction, {angle:.0f} degrees from the x axis: "
            f"fibres there carry {percent(share)} of the matrix's own stiffness."
        )
