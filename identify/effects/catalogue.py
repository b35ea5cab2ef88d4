"""The built-in effects, in the order of the chain: body, contact, response, instrument."""

from __future__ import annotations

import difflib

from identify.effects.anisotropy import Anisotropy
from identify.effects.base_compliance import BaseCompliance
from identify.effects.base_sliding import BaseSliding
from identify.effects.body_shift import BodyShift
from identify.effects.breathing import Breathing
from identify.effects.contact_offset import ContactOffset
from identify.effects.displacement_drift import DisplacementDrift
from identify.effects.effect import Effect
from identify.effects.extra_inclusion import ExtraInclusion
from identify.effects.finite_strain import FiniteStrain
from identify.effects.force_bias import ForceBias
from identify.effects.force_drift import ForceDrift
from identify.effects.force_saturation import ForceSaturation
from identify.effects.hysteresis import Hysteresis
from identify.effects.inclusion_edge import InclusionEdge
from identify.effects.inclusion_stretch import InclusionStretch
from identify.effects.mesh_error import MeshError
from identify.effects.poisson_ratio import PoissonRatio
from identify.effects.preconditioning import Preconditioning
from identify.effects.rigid_tip import RigidTip
from identify.effects.sensitivity_drift import SensitivityDrift
from identify.effects.side_gradient import SideGradient
from identify.effects.skin_layer import SkinLayer
from identify.effects.spherical_tip import SphericalTip
from identify.effects.stiffness_gradient import StiffnessGradient
from identify.effects.strain_stiffening import StrainStiffening
from identify.effects.surface_tilt import SurfaceTilt
from identify.effects.tool_compliance import ToolCompliance
from identify.effects.touch_threshold import TouchThreshold
from identify.effects.viscoelasticity import Viscoelasticity
from models.errors import InputError

CATALOGUE: tuple[Effect, ...] = (
    ExtraInclusion(),
    InclusionEdge(),
    InclusionStretch(),
    StiffnessGradient(),
    SideGradient(),
    SkinLayer(),
    Anisotropy(),
    PoissonRatio(),
    BaseCompliance(),
    BaseSliding(),
    BodyShift(),
    MeshError(),
    RigidTip(),
    SphericalTip(),
    FiniteStrain(),
    StrainStiffening(),
    Viscoelasticity(),
    Preconditioning(),
    Hysteresis(),
    ToolCompliance(),
    ForceBias(),
    ForceDrift(),
    SensitivityDrift(),
    ForceSaturation(),
    ContactOffset(),
    TouchThreshold(),
    SurfaceTilt(),
    DisplacementDrift(),
    Breathing(),
)


_PLACES = {effect.name: place for place, effect in enumerate(CATALOGUE)}


def place_in_catalogue(effect: Effect) -> int:
    """Return where an effect acts among others; a user's own after all built-in ones."""
    return _PLACES.get(effect.name, len(CATALOGUE))


def effect_named(name: str) -> Effect:
    """Return the built-in effect of this name.

    Raises
    ------
    InputError
        There is none; says the nearest right name, or all of them.
    """
    names = {effect.name: effect for effect in CATALOGUE}
    if name in names:
        return names[name]
    near = difflib.get_close_matches(name.lower().replace("-", "_"), names, n=1, cutoff=0.5)
    hint = f"did you mean '{near[0]}'?" if near else f"there are: {', '.join(names)}"
    raise InputError(f"no effect is called '{name}'; {hint}")
