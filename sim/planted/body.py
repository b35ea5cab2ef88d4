"""Hidden effects of the body's build: another modulus field, in the truth's own mesh."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sim.body.true_body import HiddenBody
from sim.body.true_map import Inclusion
from sim.planted.bench import Bench
from sim.planted.effect import any_axis, any_direction, on_body, on_contact


def _place_beside_others(bench: Bench, rng: np.random.Generator) -> dict[str, float]:
    """Draw a place at least 25 mm beside the inclusions of the map."""
    size = np.array(bench.body.size_m)
    known = [i.centre_m[:2] for i in bench.body.truth.inclusions]
    away = 0.26 * size[0]
    for _ in range(1000):
        x, y = rng.uniform(0.25, 0.75, 2) * size[:2]
        if all(np.hypot(x - a, y - b) > away for a, b in known):
            break
    depth = rng.uniform(0.010, 0.016)
    return {
        "x_m": float(x),
        "y_m": float(y),
        "z_m": float(size[2] - depth),
        "radius_m": float(rng.uniform(0.008, 0.011)),
    }


@on_body("structured", "E + weight exp(-|p - centre|^2/(2 radius^2))", "weight_pa", 6000.0,
         limit=2e5, draw=_place_beside_others)  # fmt: skip
def extra_inclusion(body, values):
    """A second hard spot."""
    centre = (values["x_m"], values["y_m"], values["z_m"])
    extra = Inclusion(values["weight_pa"], centre, values["radius_m"])
    truth = replace(body.truth, inclusions=(*body.truth.inclusions, extra))
    return replace(body, truth=truth)


@on_body("compliance",
         "ball with the part share of the mean square radius, blurred by a Gaussian of the rest",
         "share", 0.3, limit=0.85)  # fmt: skip
def inclusion_edge(body, values):
    """The map's first inclusion is a ball with a blurred edge, as a phantom's may be."""
    return _first_inclusion(body, ball_share=values["share"])


@on_body("structured",
         "longer by stretch than wide and high, along one horizontal direction; volume kept",
         "stretch", 0.5, limit=3.0, draw=any_axis)  # fmt: skip
def inclusion_stretch(body, values):
    """The map's first inclusion is long, not round."""
    return _first_inclusion(body, stretch=values["stretch"], angle_rad=values["angle_rad"])


@on_body("structured", "E exp(g s), s from one side to the other", "gradient", 0.2, limit=4.0,
         draw=any_direction)  # fmt: skip
def side_gradient(body, values):
    """The whole body is stiffer on one side than on the other."""
    return replace(body, side_gradient=values["gradient"], side_angle_rad=values["angle_rad"])


@on_body(
    "structured",
    "body moved by distance in one horizontal direction, presses and inclusions not",
    "distance_m",
    1e-3,
    limit=1.8e-3,  # wide tips stand 2 mm from the edge
    draw=any_direction,
)
def body_shift(body, values):
    """The body lies beside the place that the study states."""
    angle, (x, y) = values["angle_rad"], body.shift_m
    x, y = (
        old + values["distance_m"] * float(along)
        for old, along in zip((x, y), (np.cos(angle), np.sin(angle)), strict=True)
    )
    return replace(body, shift_m=(x, y))


@on_body("compliance", "E exp(g (z/h - 1/2))", "gradient", 0.2, limit=4.0, two_sided=True)
def stiffness_gradient(body, values):
    """The body is stiffer (or softer) towards the top."""
    return replace(body, gradient=body.gradient + values["gradient"])


@on_body("compliance", "E (1 + excess) in the top layer", "excess", 0.5, limit=20.0,
         draw=lambda bench, rng: {"thickness_m": float(rng.uniform(0.001, 0.0025))})  # fmt: skip
def skin_layer(body, values):
    """A stiffer skin, meshed with a layer of cells of its own.

    At excess 0 too, so that with and without share a mesh.
    """
    return replace(
        body,
        skin_thickness_m=values["thickness_m"],
        skin_factor=body.skin_factor * (1 + values["excess"]),
    )


@on_body("compliance", "nu - deficit", "deficit", 0.02, limit=0.3)
def poisson_ratio(body, values):
    """The body is less incompressible than the study says."""
    return replace(body, poisson_ratio=body.poisson_ratio - values["deficit"])


@on_body("compliance", "energy + (share E/2) (a . strain . a)^2", "share", 0.3, limit=20.0,
         draw=any_axis)  # fmt: skip
def anisotropy(body, values):
    """Fibres in one direction of the horizontal plane, the same everywhere."""
    return replace(body, fibre_share=values["share"], fibre_angle_rad=values["angle_rad"])


@on_body("compliance", "u_n = s t_n under the base", "normal_m_per_pa", 2e-7, limit=1e-5)
def base_compliance(body, values):
    """The base gives way across its plane, like a thin soft layer below."""
    return replace(body, base_normal_m_per_pa=values["normal_m_per_pa"])


@on_body("compliance", "u_t = s t_t under the base", "tangential_m_per_pa", 5e-7, limit=1e-4)
def base_sliding(body, values):
    """The base slips along its plane against a tangential resistance."""
    return replace(body, base_tangential_m_per_pa=values["tangential_m_per_pa"])


@on_contact("compliance", "C + share (C_upright - C)", "share", 1.0, limit=1.0)
def rigid_tip(bench, travel_m, values):
    """The flat tip is held upright and keeps the surface under it level."""
    ratio = bench.compliance(upright=True) / bench.compliance()
    return travel_m * (1 + values["share"] * (ratio - 1))[:, None]


@on_contact("compliance", "C + share (C_coarse - C)", "share", 2.0, limit=40.0)
def mesh_error(bench, travel_m, values):
    """The compliances carry the error of a coarse mesh, several times over."""
    ratio = bench.compliance(converged=False) / bench.compliance()
    return travel_m * (1 + values["share"] * (ratio - 1))[:, None]


def _first_inclusion(body: HiddenBody, **changes: float) -> HiddenBody:
    first, *others = body.truth.inclusions
    inclusions = (replace(first, **changes), *others)
    return replace(body, truth=replace(body.truth, inclusions=inclusions))
