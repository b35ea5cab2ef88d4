"""The built-in effects, in the order of the chain: body, contact, response, instrument."""

from __future__ import annotations

import difflib

from identify.catalogue.anisotropy import Anisotropy
from identify.catalogue.base_compliance import BaseCompliance
from identify.catalogue.base_sliding import BaseSliding
from identify.catalogue.body_shift import BodyShift
from identify.catalogue.breathing import Breathing
from identify.catalogue.contact_offset import ContactOffset
from identify.catalogue.displacement_drift import DisplacementDrift
from identify.catalogue.extra_inclusion import ExtraInclusion
from identify.catalogue.finite_strain import FiniteStrain
from identify.catalogue.force_bias import ForceBias
from identify.catalogue.force_drift import ForceDrift
from identify.catalogue.force_saturation import ForceSaturation
from identify.catalogue.hysteresis import Hysteresis
from identify.catalogue.inclusion_edge import InclusionEdge
from identify.catalogue.inclusion_stretch import InclusionStretch
from identify.catalogue.mesh_error import MeshError
from identify.catalogue.poisson_ratio import PoissonRatio
from identify.catalogue.preconditioning import Preconditioning
from identify.catalogue.rigid_tip import RigidTip
from identify.catalogue.sensitivity_drift import SensitivityDrift
from identify.catalogue.side_gradient import SideGradient
from identify.catalogue.skin_layer import SkinLayer
from identify.catalogue.spherical_tip import SphericalTip
from identify.catalogue.stiffness_gradient import StiffnessGradient
from identify.catalogue.strain_stiffening import StrainStiffening
from identify.catalogue.surface_tilt import SurfaceTilt
from identify.catalogue.tool_compliance import ToolCompliance
from identify.catalogue.touch_threshold import TouchThreshold
from identify.catalogue.viscoelasticity import Viscoelasticity
from identify.effects.base import Effect
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
