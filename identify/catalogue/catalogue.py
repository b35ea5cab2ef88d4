"""The built-in effects, in the order of the chain: body, contact, response, instrument."""

from identify.catalogue.anisotropy import Anisotropy
from identify.catalogue.backlash import Backlash
from identify.catalogue.base_compliance import BaseCompliance
from identify.catalogue.base_sliding import BaseSliding
from identify.catalogue.body_shift import BodyShift
from identify.catalogue.breathing import Breathing
from identify.catalogue.breathing_drifting import BreathingDrifting
from identify.catalogue.breathing_from_touch import BreathingFromTouch
from identify.catalogue.breathing_harmonics import BreathingHarmonics
from identify.catalogue.breathing_harmonics_from_touch import BreathingHarmonicsFromTouch
from identify.catalogue.contact_offset import ContactOffset
from identify.catalogue.creep_recovery import CreepRecovery
from identify.catalogue.curved_surface import CurvedSurface
from identify.catalogue.displacement_drift import DisplacementDrift
from identify.catalogue.displacement_jump import DisplacementJump
from identify.catalogue.displacement_wander import DisplacementWander
from identify.catalogue.extra_inclusion import ExtraInclusion
from identify.catalogue.filtered_force import FilteredForce
from identify.catalogue.finite_strain import FiniteStrain
from identify.catalogue.force_bias import ForceBias
from identify.catalogue.force_drift import ForceDrift
from identify.catalogue.force_jump import ForceJump
from identify.catalogue.force_saturation import ForceSaturation
from identify.catalogue.force_wander import ForceWander
from identify.catalogue.force_warm_up import ForceWarmUp
from identify.catalogue.free_loop import FreeLoop
from identify.catalogue.free_preconditioning import FreePreconditioning
from identify.catalogue.free_saturation import FreeSaturation
from identify.catalogue.free_stiffening import FreeStiffening
from identify.catalogue.guide_friction import GuideFriction
from identify.catalogue.hysteresis import Hysteresis
from identify.catalogue.inclusion_edge import InclusionEdge
from identify.catalogue.inclusion_stretch import InclusionStretch
from identify.catalogue.local_creep import LocalCreep
from identify.catalogue.mesh_error import MeshError
from identify.catalogue.play import Play
from identify.catalogue.poisson_ratio import PoissonRatio
from identify.catalogue.power_law_creep import PowerLawCreep
from identify.catalogue.preconditioning import Preconditioning
from identify.catalogue.preconditioning_nearby import PreconditioningNearby
from identify.catalogue.rigid_tip import RigidTip
from identify.catalogue.sensitivity_drift import SensitivityDrift
from identify.catalogue.sensitivity_wander import SensitivityWander
from identify.catalogue.several_plays import SeveralPlays
from identify.catalogue.side_creep import SideCreep
from identify.catalogue.side_gradient import SideGradient
from identify.catalogue.skin_layer import SkinLayer
from identify.catalogue.spherical_tip import SphericalTip
from identify.catalogue.stiffness_gradient import StiffnessGradient
from identify.catalogue.strain_stiffening import StrainStiffening
from identify.catalogue.surface_bump import SurfaceBump
from identify.catalogue.surface_tilt import SurfaceTilt
from identify.catalogue.time_lag import TimeLag
from identify.catalogue.tool_compliance import ToolCompliance
from identify.catalogue.touch_threshold import TouchThreshold
from identify.catalogue.two_time_creep import TwoTimeCreep
from identify.catalogue.uneven_surface import UnevenSurface
from identify.catalogue.viscoelasticity import Viscoelasticity
from identify.effects.base import Effect
from models import Catalogue

CATALOGUE: Catalogue[Effect] = Catalogue(
    (
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
        FreeStiffening(),
        Viscoelasticity(),
        TwoTimeCreep(),
        PowerLawCreep(),
        LocalCreep(),
        CreepRecovery(),
        SideCreep(),
        Preconditioning(),
        PreconditioningNearby(),
        FreePreconditioning(),
        Hysteresis(),
        Play(),
        FreeLoop(),
        SeveralPlays(),
        TimeLag(),
        FilteredForce(),
        ToolCompliance(),
        ForceBias(),
        GuideFriction(),
        ForceDrift(),
        ForceWarmUp(),
        ForceWander(),
        ForceJump(),
        SensitivityDrift(),
        SensitivityWander(),
        ForceSaturation(),
        FreeSaturation(),
        ContactOffset(),
        Backlash(),
        TouchThreshold(),
        SurfaceTilt(),
        CurvedSurface(),
        UnevenSurface(),
        SurfaceBump(),
        DisplacementDrift(),
        DisplacementWander(),
        DisplacementJump(),
        Breathing(),
        BreathingFromTouch(),
        BreathingHarmonics(),
        BreathingHarmonicsFromTouch(),
        BreathingDrifting(),
    )
)
