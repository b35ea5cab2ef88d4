"""What a scan can see of each effect, what it would take it for, and what ignoring it would do.

All from the derivatives at the present fit, for this scan or for one that is only planned:

    smallest amplitude seen    5 / |A_perp|   (5 standard errors, after the map took its share),
                               A the effect's own move of the readings at about that amplitude
    confused with              effects whose A_perp has a cosine above 0.9 with its own
    bias of the map            (G'G)^-1 G'A a: what the fitted map takes for the effect

Source: the same algebra as the score test, see `identify.score`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fem import Contacts, PalpationModel
from fem.contact import PressedSurface
from identify.body_mechanics import BodyMechanics
from identify.diagnosis import ALIKE
from identify.effects.effect import Effect, EffectParameter
from identify.joint_fit import JointFit
from identify.measurement_chain import Chain
from identify.measurement_model import Linearised, MeasurementModel
from identify.optimize_result import InadmissibleError
from identify.scan_design import Design, Presses, presses_of, readings_of
from identify.score import beyond, effect_patterns, fitted_basis

SIGMAS = 5.0
SHARE = 0.03  # of the signal: the size at which a bias of the map is stated
_SAMPLE = 12  # candidates of a grid that are looked at
_NOTHING = 1e-5
_UNMOVED = 1e-9  # of what the amplitudes together move: beyond rounding, nothing
_TRIES = 3  # at the amplitude whose own pattern is 5 standard errors long
_EXACT = 0.05  # of that length
_FAR = 0.5  # of the signal: beyond it, what the linear pattern says is good enough


@dataclass(frozen=True)
class Limit:
    """What a scan can see of one effect.

    Attributes
    ----------
    name : of the effect
    smallest_share : of the signal's rms that 5 standard errors are; None where nothing is seen
    sizes : amplitudes at that size, by parameter, in their units
    visible : share of the pattern that the map leaves
    confused_with : effects that look the same to this scan
    map_bias : by parameter, in its unit, what ignoring the effect at 3 % of the signal does
    untestable : why the scan cannot show it at all, or None
    """

    name: str
    smallest_share: float | None
    sizes: Mapping[str, float]
    visible: float
    confused_with: tuple[str, ...]
    map_bias: Mapping[str, float]
    untestable: str | None = None


@dataclass(frozen=True)
class _Seen:
    """The pattern of an effect at one candidate of its shape, in one direction."""

    shape: Mapping[str, float]
    share: float  # of the signal at one standard error
    sizes: np.ndarray
    visible: float
    basis: np.ndarray
    bias: np.ndarray


def detection_limits(
    fit: JointFit, catalogue: Sequence[Effect], at: Linearised | None = None
) -> tuple[Limit, ...]:
    """Return the limits of every effect of a catalogue that the model does not have.

    Parameters
    ----------
    at : the model's linearisation; default the fit's own
    """
    return limits_at(fit.model, at or fit.at, fit.u, catalogue)


def limits_at(
    model: MeasurementModel, at: Linearised, u: np.ndarray, catalogue: Sequence[Effect]
) -> tuple[Limit, ...]:
    """Return the limits of a model linearised at scaled unknowns u (k,)."""
    signal = float(np.sqrt(np.mean(at.predicted_m**2)))
    fitted = fitted_basis(at)
    normal = np.linalg.pinv(at.jacobian, rcond=1e-10)
    seen: dict[str, _Seen | str] = {}
    for effect in catalogue:
        if effect.name not in model.has:
            own = _seen(model, at, effect, fitted, normal, signal)
            if isinstance(own, _Seen) and own.share * SIGMAS < _FAR:
                own = _at_its_size(model, at, effect, own, fitted, normal)
            seen[effect.name] = own
    bases = {n: s.basis for n, s in seen.items() if isinstance(s, _Seen) and s.share < np.inf}
    slope = model.slope(u)
    limits = []
    for effect in catalogue:
        own = seen.get(effect.name)
        if own is None:
            continue
        if isinstance(own, str):
            limits.append(Limit(effect.name, None, {}, 0.0, (), {}, own))
            continue
        alike = [
            (float(np.linalg.norm(own.basis @ other)), name)
            for name, other in bases.items()
            if name != effect.name and effect.name in bases
        ]
        factor = SHARE / own.share if own.share > 0 else 0.0
        typical = [
            p.typical for p in effect.bounded(model.readings, at.state) if p.null is not None
        ]
        sizes = SIGMAS * own.sizes * typical
        limits.append(
            Limit(
                effect.name,
                SIGMAS * own.share if np.isfinite(own.share) else None,
                dict(zip((p.name for p in effect.amplitudes), sizes.tolist(), strict=True)),
                own.visible,
                tuple(name for cosine, name in sorted(alike, reverse=True) if cosine > ALIKE),
                dict(zip(model.names, (factor * own.bias * slope).tolist(), strict=True)),
            )
        )
    return tuple(limits)


def _seen(
    model: MeasurementModel,
    at: Linearised,
    effect: Effect,
    fitted: np.ndarray,
    normal: np.ndarray,
    signal: float,
) -> _Seen | str:
    """Return the typical candidate's pattern, or why there is none."""
    chain = model.chain
    reason = effect.untestable(model.readings) or effect.redundant(chain.profile, chain.nonlinear)
    if reason is not None:
        return reason
    try:
        pattern = effect_patterns(model, at, effect, _SAMPLE)
    except InadmissibleError as error:
        return str(error)
    if not pattern.shapes:
        return "the scan leaves no candidate of its shape to be told from another effect"
    left, _, visible = beyond(pattern, fitted)
    candidates, unmoved = [], False
    for g in range(len(left)):
        # The direction of the amplitudes that shows least
        _, singular, right = np.linalg.svd(left[g], full_matrices=False)
        if singular[0] == 0:
            continue
        least = float(np.linalg.norm(pattern.columns[g] @ right[-1]))
        if least <= _UNMOVED * float(np.linalg.norm(pattern.columns[g])):
            unmoved = True
            continue
        weakest = right[-1] / max(singular[-1], 1e-300)
        column = pattern.columns[g] @ weakest
        share = float(np.sqrt(np.mean((column * at.sigma_m) ** 2))) / signal
        if visible[g] < _NOTHING or not np.isfinite(weakest).all():
            share = np.inf
        along = left[g] @ weakest
        basis = along / max(float(np.linalg.norm(along)), 1e-300)
        candidates.append(
            _Seen(pattern.shapes[g], share, weakest, float(visible[g]), basis, normal @ column)
        )
    if not candidates and unmoved:
        names = " and ".join(p.name for p in effect.amplitudes)
        return f"a combination of its {names} moves no reading of this scan"
    if not candidates:
        return "the scan does not show it at all"
    candidates.sort(key=lambda s: s.share)
    middle = candidates[len(candidates) // 2]
    return middle if np.isfinite(middle.share) else "the stiffness map absorbs it entirely"


def _at_its_size(
    model: MeasurementModel,
    at: Linearised,
    effect: Effect,
    own: _Seen,
    fitted: np.ndarray,
    normal: np.ndarray,
) -> _Seen:
    """Return the pattern at the amplitude at which it is `SIGMAS` long, as the effect's law has it.

    A skin's share falls off and a Poisson's ratio's grows with its size: the derivative at the null
    alone may be wrong by a factor of two.
    """
    parameters = {p.name: p for p in effect.bounded(model.readings, at.state)}
    amplitudes = [parameters[p.name] for p in effect.amplitudes]
    signal = float(np.sqrt(np.mean(at.predicted_m**2)))
    sizes = SIGMAS * _inward(own.sizes, amplitudes)
    found = own
    for _ in range(_TRIES):
        nulls = np.array([p.null for p in amplitudes], float)
        typical = np.array([p.typical for p in amplitudes])
        low, high = (np.array([getattr(p, end) for p in amplitudes]) for end in ("lower", "upper"))
        values = np.clip(nulls + sizes * typical, low, high)
        named = dict(zip((p.name for p in amplitudes), values.tolist(), strict=True))
        try:
            moved = _moved(model, at, effect, {**effect.null, **own.shape, **named})
        except InadmissibleError:
            return found
        left = moved - fitted @ (fitted.T @ moved)
        length = float(np.linalg.norm(left))
        if not np.isfinite(length) or length < _NOTHING:
            return found
        found = replace(
            own,
            share=float(np.sqrt(np.mean((moved * at.sigma_m) ** 2))) / signal / length,
            sizes=(values - nulls) / typical / length,
            basis=left / length,
            bias=normal @ moved / length,
        )
        if abs(length / SIGMAS - 1) < _EXACT or not np.allclose(values, nulls + sizes * typical):
            return found
        sizes = sizes * float(np.clip(SIGMAS / length, 0.25, 4.0))
    return found


def _inward(sizes: np.ndarray, amplitudes: Sequence[EffectParameter]) -> np.ndarray:
    """Turn a direction of amplitudes to the side on which their bounds leave most room."""
    rooms = []
    for sign in (1.0, -1.0):
        room = []
        for size, p in zip(sign * sizes, amplitudes, strict=True):
            end = p.upper if size > 0 else p.lower
            room.append(abs(end - (p.null or 0.0)) / p.typical / max(abs(size), 1e-300))
        rooms.append(min(room))
    return sizes if rooms[0] >= rooms[1] else -sizes


def _moved(
    model: MeasurementModel, at: Linearised, effect: Effect, values: Mapping[str, float]
) -> np.ndarray:
    """Return what an effect of these values moves the whitened readings by, (m,)."""
    own, force = model.chain, at.latent_force_n
    c, e = at.body.compliance, at.body.local_modulus
    base = own.predict(c, e, force, at.values)
    if effect.link == "body":
        dc, de = at.body.exact_change(effect.body(at.state, values))
        moved = own.predict(c + dc, e + de, force, at.values)
    else:
        effects = [*own.effects, effect]
        chain = Chain(own.readings, effects, own.radius_m, own.profile, own.poisson_ratio)
        moved = chain.predict(c, e, force, {**at.values, effect.name: values})
    return at.whitened(moved - base, own.readings.press)


def planned(
    fit: JointFit, design: Design, further: bool = False
) -> tuple[MeasurementModel, Linearised]:
    """Return the model of a planned scan, and its linearisation at a fit's estimate.

    `further` says that it is made after the present one, not in its place.
    """
    present = fit.model.readings
    timed = present.time_s is not None
    readings = readings_of(design.presses, timed, present if further else None)
    mechanics = _mechanics(fit, design)
    model = replace(
        fit.model,
        readings=readings,
        displacement_m=np.zeros(len(readings)),
        mechanics=mechanics,
    )
    model = replace(model, displacement_m=model.linearise(fit.u).predicted_m)
    # Anew: with noise in both columns the best estimate of the force follows the displacement
    at = model.linearise(fit.u)
    return model, replace(at, residual=np.zeros(len(readings)))


def that_fit(fit: JointFit, designs: Iterable[Design]) -> tuple[Design, ...]:
    """Return the designs without the presses whose tip would hang over the body's edge."""
    surface = PressedSurface(fit.model.mechanics.coarse.mesh)
    found = []
    for design in designs:
        fits = surface.bears(_contacts(fit, design.presses))
        if fits.all():
            found.append(design)
        elif fits.any():
            left_out = f" (without the {np.sum(~fits)} places too near an edge for the tip)"
            presses = design.presses.taken(np.flatnonzero(fits))
            found.append(replace(design, change=design.change + left_out, presses=presses))
    return tuple(found)


def _contacts(fit: JointFit, presses: Presses) -> Contacts:
    present = fit.model.mechanics.coarse.contacts
    # A sphere's patch is not its radius
    scale = present.radius_m / presses_of(fit.model.readings).radius_m
    return Contacts(
        presses.point_m,
        presses.direction,
        presses.radius_m * float(np.median(scale)),
        present.profile,
    )


def _mechanics(fit: JointFit, design: Design) -> BodyMechanics:
    """Return the body pressed as a design does; the present presses keep their models."""
    own, present = fit.model.mechanics, presses_of(fit.model.readings)
    presses = design.presses
    same = len(presses) == len(present) and all(
        np.array_equal(getattr(presses, name), getattr(present, name))
        for name in ("point_m", "direction", "radius_m")
    )
    if same:
        return own
    coarse, contacts = own.coarse, _contacts(fit, presses)

    def at_poisson_ratio(nu: float) -> PalpationModel:
        return PalpationModel(coarse.mesh, nu, contacts, support=coarse.support)

    other = BodyMechanics(at_poisson_ratio(own.poisson_ratio), None, at_poisson_ratio)
    other = other.corrected(fit.map, fit.at.state)
    # The meshes err in what is far from the tip, which is the same length under any tip
    now = fit.at.body.compliance
    apart = np.linalg.norm(presses.point_m[:, None] - present.point_m, axis=2)
    error = (own.model_error * now)[apart.argmin(axis=1)]
    return replace(other, model_error=error / other.evaluate(fit.map, fit.at.state).compliance)


@dataclass(frozen=True)
class Improvement:
    """A planned scan, and how much smaller an effect it would see; ratio below 1 is better."""

    design: Design
    limits: tuple[Limit, ...]


def improvements(
    fit: JointFit,
    catalogue: Sequence[Effect],
    designs: Sequence[Design],
    progress: Callable[[str], None] | None = None,
) -> tuple[Improvement, ...]:
    """Return the limits of planned scans, in the order of the designs."""
    found = []
    for design in designs:
        if progress:
            progress(f"planning a scan {design.change}")
        model, at = planned(fit, design)
        found.append(Improvement(design, limits_at(model, at, fit.u, catalogue)))
    return tuple(found)
