"""All effects that the laboratory can hide."""

from __future__ import annotations

from difflib import get_close_matches

from models.errors import InputError
from sim.planted.body import (
    Anisotropy,
    BaseCompliance,
    BaseSliding,
    BodyShift,
    ExtraInclusion,
    InclusionEdge,
    InclusionStretch,
    MeshError,
    PoissonRatio,
    RigidTip,
    SideGradient,
    SkinLayer,
    StiffnessGradient,
)
from sim.planted.contact import FiniteStrain, SphericalTip, StrainStiffening
from sim.planted.effect import HiddenEffect
from sim.planted.instrument import (
    Breathing,
    ContactOffset,
    DisplacementDrift,
    ForceBias,
    ForceDrift,
    ForceSaturation,
    SensitivityDrift,
    SurfaceTilt,
    ToolCompliance,
)
from sim.planted.outside_catalogue import (
    CoarseEncoder,
    CoolingBody,
    CreepingInclusion,
    LateForce,
    SlippedPresses,
    StickSlip,
    StickyTip,
    TwoCreepTimes,
)
from sim.planted.response import Hysteresis, Preconditioning, Viscoelasticity

HIDDEN: tuple[HiddenEffect, ...] = (
    Viscoelasticity(),
    FiniteStrain(),
    StrainStiffening(),
    Anisotropy(),
    SkinLayer(),
    ExtraInclusion(),
    StiffnessGradient(),
    PoissonRatio(),
    Preconditioning(),
    Hysteresis(),
    RigidTip(),
    SphericalTip(),
    BaseCompliance(),
    BaseSliding(),
    ToolCompliance(),
    ForceBias(),
    ForceDrift(),
    SensitivityDrift(),
    ForceSaturation(),
    ContactOffset(),
    SurfaceTilt(),
    DisplacementDrift(),
    Breathing(),
    MeshError(),
    InclusionEdge(),
    InclusionStretch(),
    SideGradient(),
    BodyShift(),
    LateForce(),
    CreepingInclusion(),
    SlippedPresses(),
    CoolingBody(),
    StickSlip(),
    CoarseEncoder(),
    StickyTip(),
    TwoCreepTimes(),
)

INSIDERS = tuple(effect.name for effect in HIDDEN if effect.category != "outsider")
OUTSIDERS = tuple(effect.name for effect in HIDDEN if effect.category == "outsider")


def hidden_effect(name: str) -> HiddenEffect:
    """Return the hidden effect of a name.

    Raises
    ------
    InputError
        An unknown name; the nearest right one is said.
    """
    for effect in HIDDEN:
        if effect.name == name:
            return effect
    known = [*INSIDERS, *OUTSIDERS]
    near = get_close_matches(name, known, 1)
    hint = f"; the nearest right one is '{near[0]}'" if near else ""
    raise InputError(f"the laboratory cannot hide '{name}'{hint}; it knows {', '.join(known)}")
