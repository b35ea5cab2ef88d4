"""All effects that the laboratory can hide; `HIDDEN["breathing"]` is the one of that name."""

from __future__ import annotations

from models import Catalogue
from sim.planted import body, contact, instrument, jumps, response, surfaces
from sim.planted import outside_catalogue as outside
from sim.planted.effect import HiddenEffect
from sim.planted.foreign_forms import FORMS_OF_THE_BODY
from sim.planted.foreign_readings import FORMS_OF_THE_INSTRUMENT

HIDDEN: Catalogue[HiddenEffect] = Catalogue(
    (
        response.viscoelasticity,
        response.two_time_creep,
        response.power_law_creep,
        jumps.local_creep,
        jumps.side_creep,
        response.creep_recovery,
        contact.finite_strain,
        contact.strain_stiffening,
        contact.free_stiffening,
        body.anisotropy,
        body.skin_layer,
        body.extra_inclusion,
        body.stiffness_gradient,
        body.poisson_ratio,
        response.preconditioning,
        response.preconditioning_nearby,
        response.free_preconditioning,
        response.hysteresis,
        response.play,
        response.several_plays,
        jumps.free_loop,
        jumps.guide_friction,
        jumps.backlash,
        body.rigid_tip,
        contact.spherical_tip,
        body.base_compliance,
        body.base_sliding,
        instrument.tool_compliance,
        instrument.force_bias,
        instrument.force_drift,
        instrument.force_warm_up,
        instrument.force_wander,
        jumps.force_jump,
        instrument.time_lag,
        instrument.filtered_force,
        instrument.sensitivity_drift,
        instrument.sensitivity_wander,
        instrument.force_saturation,
        instrument.free_saturation,
        instrument.contact_offset,
        instrument.surface_tilt,
        surfaces.curved_surface,
        surfaces.uneven_surface,
        surfaces.surface_bump,
        instrument.displacement_drift,
        instrument.displacement_wander,
        jumps.displacement_jump,
        instrument.breathing,
        instrument.breathing_from_touch,
        instrument.breathing_harmonics,
        instrument.breathing_harmonics_from_touch,
        instrument.breathing_drifting,
        body.mesh_error,
        body.inclusion_edge,
        body.inclusion_stretch,
        body.side_gradient,
        body.body_shift,
        outside.outside_creeping_inclusion,
        outside.outside_slipped_presses,
        outside.outside_stick_slip,
        outside.outside_coarse_encoder,
        outside.outside_sticky_tip,
        *FORMS_OF_THE_BODY,
        *FORMS_OF_THE_INSTRUMENT,
        *surfaces.FORMS_OF_THE_SURFACE,
    )
)

INSIDERS = tuple(
    effect.name for effect in HIDDEN if effect.category in ("structured", "compliance")
)
FORMS = tuple(effect.name for effect in HIDDEN if effect.category == "form")
OUTSIDERS = tuple(effect.name for effect in HIDDEN if effect.category == "outsider")
