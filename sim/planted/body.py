"""Hidden effects of the body's build: another modulus field, in the truth's own mesh."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sim.body.true_body import HiddenBody
from sim.body.true_map import Inclusion
from sim.planted.bench import Bench
from sim.planted.effect import HiddenEffect


class ExtraInclusion(HiddenEffect):
    """A second hard spot."""

    name, category = "extra_inclusion", "structured"
    law = "E + weight exp(-|p - centre|^2/(2 radius^2))"
    amplitude, typical, limit = "weight_pa", 6000.0, 2e5

    def draw(self, bench: Bench, rng: np.random.Generator) -> dict[str, float]:
        """Draw a place at least 25 mm beside those that are known."""
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

    def body(self, body, values):
        """Put it into the map."""
        centre = (values["x_m"], values["y_m"], values["z_m"])
        extra = Inclusion(values["weight_pa"], centre, values["radius_m"])
        truth = replace(body.truth, inclusions=(*body.truth.inclusions, extra))
        return replace(body, truth=truth)


class InclusionEdge(HiddenEffect):
    """The map's first inclusion is a ball with a blurred edge, as a phantom's may be."""

    name, category = "inclusion_edge", "compliance"
    law = "ball with the part share of the mean square radius, blurred by a Gaussian of the rest"
    amplitude, typical, limit = "share", 0.3, 0.85

    def body(self, body, values):
        """Give it an edge."""
        return _first_inclusion(body, ball_share=values["share"])


class InclusionStretch(HiddenEffect):
    """The map's first inclusion is long, not round."""

    name, category = "inclusion_stretch", "structured"
    law = "longer by stretch than wide and high, along one horizontal direction; volume kept"
    amplitude, typical, limit = "stretch", 0.5, 3.0

    def draw(self, bench: Bench, rng: np.random.Generator) -> dict[str, float]:
        """Draw the direction."""
        return {"angle_rad": float(rng.uniform(0, np.pi))}

    def body(self, body, values):
        """Stretch it."""
        return _first_inclusion(body, stretch=values["stretch"], angle_rad=values["angle_rad"])


class SideGradient(HiddenEffect):
    """The whole body is stiffer on one side than on the other."""

    name, category = "side_gradient", "structured"
    law = "E exp(g s), s from one side to the other"
    amplitude, typical, limit = "gradient", 0.2, 4.0

    def draw(self, bench: Bench, rng: np.random.Generator) -> dict[str, float]:
        """Draw the direction."""
        return {"angle_rad": float(rng.uniform(0, 2 * np.pi))}

    def body(self, body, values):
        """Grade the modulus."""
        return replace(body, side_gradient=values["gradient"], side_angle_rad=values["angle_rad"])


class BodyShift(HiddenEffect):
    """The body lies beside the place that the study states."""

    name, category = "body_shift", "structured"
    law = "body moved by distance in one horizontal direction, presses and inclusions not"
    amplitude, typical, limit = "distance_m", 1e-3, 1.8e-3  # wide tips stand 2 mm from the edge

    def draw(self, bench: Bench, rng: np.random.Generator) -> dict[str, float]:
        """Draw the direction."""
        return {"angle_rad": float(rng.uniform(0, 2 * np.pi))}

    def body(self, body, values):
        """Move it."""
        angle, (x, y) = values["angle_rad"], body.shift_m
        x, y = (
            old + values["distance_m"] * float(along)
            for old, along in zip((x, y), (np.cos(angle), np.sin(angle)), strict=True)
        )
        return replace(body, shift_m=(x, y))


class StiffnessGradient(HiddenEffect):
    """The body is stiffer (or softer) towards the top."""

    name, category = "stiffness_gradient", "compliance"
    law = "E exp(g (z/h - 1/2))"
    amplitude, typical, limit = "gradient", 0.2, 4.0
    two_sided = True

    def body(self, body, values):
        """Grade the modulus."""
        return replace(body, gradient=body.gradient + values["gradient"])


class SkinLayer(HiddenEffect):
    """A stiffer skin, meshed with a layer of cells of its own."""

    name, category = "skin_layer", "compliance"
    law = "E (1 + excess) in the top layer"
    amplitude, typical, limit = "excess", 0.5, 20.0

    def draw(self, bench: Bench, rng: np.random.Generator) -> dict[str, float]:
        """Draw the thickness, 1 to 2.5 mm."""
        return {"thickness_m": float(rng.uniform(0.001, 0.0025))}

    def body(self, body, values):
        """Add the skin; at excess 0 too, so that with and without share a mesh."""
        return replace(
            body,
            skin_thickness_m=values["thickness_m"],
            skin_factor=body.skin_factor * (1 + values["excess"]),
        )


class PoissonRatio(HiddenEffect):
    """The body is less incompressible than the study says."""

    name, category = "poisson_ratio", "compliance"
    law = "nu - deficit"
    amplitude, typical, limit = "deficit", 0.02, 0.3

    def body(self, body, values):
        """Lower Poisson's ratio."""
        return replace(body, poisson_ratio=body.poisson_ratio - values["deficit"])


class Anisotropy(HiddenEffect):
    """Fibres in one direction of the horizontal plane, the same everywhere."""

    name, category = "anisotropy", "compliance"
    law = "energy + (share E/2) (a . strain . a)^2"
    amplitude, typical, limit = "share", 0.3, 20.0

    def draw(self, bench: Bench, rng: np.random.Generator) -> dict[str, float]:
        """Draw the direction."""
        return {"angle_rad": float(rng.uniform(0, np.pi))}

    def body(self, body, values):
        """Lay the fibres."""
        return replace(body, fibre_share=values["share"], fibre_angle_rad=values["angle_rad"])


class BaseCompliance(HiddenEffect):
    """The base gives way across its plane, like a thin soft layer below."""

    name, category = "base_compliance", "compliance"
    law = "u_n = s t_n under the base"
    amplitude, typical, limit = "normal_m_per_pa", 2e-7, 1e-5

    def body(self, body, values):
        """Put springs under the base."""
        return replace(body, base_normal_m_per_pa=values["normal_m_per_pa"])


class BaseSliding(HiddenEffect):
    """The base slips along its plane against a tangential resistance."""

    name, category = "base_sliding", "compliance"
    law = "u_t = s t_t under the base"
    amplitude, typical, limit = "tangential_m_per_pa", 5e-7, 1e-4

    def body(self, body, values):
        """Let the base slip."""
        return replace(body, base_tangential_m_per_pa=values["tangential_m_per_pa"])


class RigidTip(HiddenEffect):
    """The flat tip is held upright and keeps the surface under it level."""

    name, category = "rigid_tip", "compliance"
    law = "C + share (C_upright - C)"
    amplitude, typical, limit = "share", 1.0, 1.0

    def contact(self, bench, travel_m, values):
        """Mix the compliances under a level tip in."""
        ratio = bench.compliance(upright=True) / bench.compliance()
        return travel_m * (1 + values["share"] * (ratio - 1))[:, None]


class MeshError(HiddenEffect):
    """The compliances carry the error of a coarse mesh, several times over."""

    name, category = "mesh_error", "compliance"
    law = "C + share (C_coarse - C)"
    amplitude, typical, limit = "share", 2.0, 40.0

    def contact(self, bench, travel_m, values):
        """Mix the coarse mesh's compliances in."""
        ratio = bench.compliance(converged=False) / bench.compliance()
        return travel_m * (1 + values["share"] * (ratio - 1))[:, None]


def _first_inclusion(body: HiddenBody, **changes: float) -> HiddenBody:
    first, *others = body.truth.inclusions
    inclusions = (replace(first, **changes), *others)
    return replace(body, truth=replace(body.truth, inclusions=inclusions))
