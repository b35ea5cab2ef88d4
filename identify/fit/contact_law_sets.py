"""The sets of effects among which a contact law is sought, fitted to the presses alone."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from identify.effects.base import Effect, Values, advice
from identify.fit.free_compliance import FreeCompliance
from identify.fit.free_compliance_fit import FreeComplianceFit, causes, is_calm
from identify.fit.settings import FREE_COMPLIANCE_TRIAL, ContactLawSettings
from identify.measurement.chain import OperatingPoint
from identify.measurement.effect_in_model import EffectInModel
from identify.optimize.result import InadmissibleError
from models import well_spread

_STEP = 0.01  # of an amplitude's typical size, for its pattern

Set = tuple[str, ...]


def well_spread_presses(presses: FreeCompliance, most: int) -> FreeCompliance:
    """Return so many presses that met resistance, well spread over the surface and the tips."""
    felt, r = np.flatnonzero(presses.felt), presses.readings
    place = r.point_m[r.first[felt]] / max(float(r.between_m.max()), 1e-9)
    tip = np.log(r.radius_m[r.first[felt]])
    return presses.some(felt[well_spread(np.column_stack([place, tip]), most)])


def search_sets(
    presses: FreeCompliance,
    plain: FreeComplianceFit,
    catalogue: Sequence[Effect],
    say: Callable[[str], None],
    settings: ContactLawSettings,
    only: Sequence[Set] = (),
) -> dict[Set, FreeComplianceFit]:
    """Fit the sets of effects among which the law is sought, by their names (`only`: all)."""
    free = [
        e
        for e in catalogue
        if e.link != "body" and e.name not in plain.names and e.untestable(presses.readings) is None
    ]
    parts = {e.name: presses.part(e, _start(presses, plain, e, settings.shapes)) for e in free}
    fits: dict[Set, FreeComplianceFit] = {}
    seen: set[Set] = set()

    def tried(sets: Sequence[Set]) -> None:
        most = len(seen) + len(sets)
        for names in sets:
            seen.add(names)
            say(step_words("the presses", names, len(seen), most))
            fit = fit_set(presses, plain, [parts[name] for name in names])
            if fit is not None:
                fits[names] = fit

    def criterion(names: Set) -> float:
        return criterion_of(fits[names], misfit_scale([plain, *fits.values()]))

    if only := [names for names in only if set(names) <= set(parts)]:
        tried(only)
        return fits
    tried([(name,) for name in parts])
    if all(_has_room(plain, fit, settings) for fit in fits.values()):
        tried(list(combinations(_one_form_each(parts, fits, criterion), 2)))
    while fits:
        best = min(fits, key=criterion)
        if len(best) < 2:
            break
        new = [names for names in _exchanges(best, parts) if names not in seen]
        if not new and len(best) < settings.most_effects:
            if not _has_room(plain, fits[best], settings):
                break
            more = (_ordered((*best, name), parts) for name in parts if name not in best)
            new = [names for names in more if names not in seen]
        if not new:
            break
        tried(new)
    return fits


def leading_sets(
    plain: FreeComplianceFit, fits: Mapping[Set, FreeComplianceFit], settings: ContactLawSettings
) -> tuple[Set, ...]:
    """Return the sets of each size that are nearest to its best one, best first.

    A press that no set meets counts little in any: without a few such presses others hardly lead.
    """
    scale = misfit_scale([plain, *fits.values()])
    slack = max(settings.margin, settings.unsure * (plain.misfit - plain.dof) / scale)
    leading: list[Set] = []
    for size in range(1, settings.most_effects + 1):
        by_value = sorted((criterion_of(fits[n], scale), n) for n in fits if len(n) == size)
        close = [names for value, names in by_value if value <= by_value[0][0] + slack]
        leading += close[: settings.leading]
    return tuple(leading)


def step_words(which: str, names: Set, number: int, most: int) -> str:
    """Return the words of a step of the search, which is told how many sets there are to try.

    >>> step_words("all presses", ("play", "force_bias"), 2, 5)
    'fitting all presses alone with play, force_bias (2 of 5)'
    """
    return f"fitting {which} alone with {', '.join(names)} ({number} of {most})"


def split_sets(
    presses: FreeCompliance,
    plain: FreeComplianceFit,
    found: FreeComplianceFit,
    catalogue: Sequence[Effect],
    say: Callable[[str], None],
    settings: ContactLawSettings,
) -> dict[Set, FreeComplianceFit]:
    """Fit the first form of a found effect's cause beside another effect, in its place.

    With no more numbers: a play seen from its first loading on is nearly a loop and a late touch.
    Those that a rough fit leaves far from the law found are not fitted to the end.
    """
    rough = replace(presses, settings=FREE_COMPLIANCE_TRIAL)
    begun = replace(plain, compliance=found.compliance)
    scale = misfit_scale([found])
    excess = max(plain.misfit - plain.dof, 0.0) / scale
    most = criterion_of(found, scale) + settings.margin + settings.near * excess
    fits: dict[Set, FreeComplianceFit] = {}
    tried = list(_splits(presses, found.parts[len(plain.parts) :], catalogue))
    for number, parts in enumerate(tried, start=1):
        names = tuple(part.effect.name for part in parts)
        say(step_words("the presses", names, number, len(tried)))
        first = fit_set(rough, begun, parts)
        if first is None or criterion_of(first, scale) >= most:
            continue
        near = replace(plain, compliance=first.compliance)
        fit = fit_set(presses, near, first.parts[len(plain.parts) :])
        if fit is not None:
            fits[names] = fit
    return fits


def _splits(
    presses: FreeCompliance, found: Sequence[EffectInModel], catalogue: Sequence[Effect]
) -> Iterator[list[EffectInModel]]:
    """Yield the effects found, in the place of one the first form of its cause and another one."""
    known = {e.name: e for e in catalogue if e.link != "body"}
    taken = {part.effect.family for part in found}
    for part in found:
        first = known.get(part.effect.family)
        if first is None or first.name == part.effect.name:
            continue
        rest = [other for other in found if other is not part]
        room = len(part.effect.parameters) - len(first.parameters)
        for other in known.values():
            untestable = other.untestable(presses.readings) is not None
            if other.family not in taken and len(other.parameters) <= room and not untestable:
                yield [*rest, presses.begun(first, {}), presses.begun(other, {})]


def _one_form_each(
    parts: Mapping[str, EffectInModel],
    fits: Mapping[Set, FreeComplianceFit],
    criterion: Callable[[Set], float],
) -> list[str]:
    """Return one form of each cause: the best alone, or the first where none can be fitted."""
    causes: dict[str, list[str]] = {}
    for name, part in parts.items():
        causes.setdefault(part.effect.family, []).append(name)
    return [
        min((n for n in forms if (n,) in fits), key=lambda n: criterion((n,)), default=forms[0])
        for forms in causes.values()
    ]


def _exchanges(names: Set, parts: Mapping[str, EffectInModel]) -> list[Set]:
    """Return the pairs that differ from a pair in one effect, none of another number of effects."""
    if len(names) != 2:
        return []
    return [
        _ordered((kept, other), parts) for kept in names for other in parts if other not in names
    ]


def _has_room(
    plain: FreeComplianceFit, fit: FreeComplianceFit, settings: ContactLawSettings
) -> bool:
    """Whether a fit's misfit above noise leaves further effects enough to earn their place."""
    noise = fit.dof - settings.noise_sd * np.sqrt(2 * fit.dof)
    return fit.misfit - noise > max(settings.margin, settings.least * (plain.misfit - plain.dof))


def fit_set(
    presses: FreeCompliance, plain: FreeComplianceFit, parts: Sequence[EffectInModel]
) -> FreeComplianceFit | None:
    """Fit the study's effects and further ones; None for an impossible fit or one at a bound."""
    chain = presses.chain([part.effect for part in (*plain.parts, *parts)])
    if any(advice(part.effect).redundant(chain.profile, chain.nonlinear) for part in parts):
        return None
    try:
        with np.errstate(over="ignore", invalid="ignore"):  # a step too far is turned back
            fit = presses.fit((*plain.parts, *parts), plain.compliance)
    except InadmissibleError:
        return None
    doubtful = any(
        advice(p.effect).doubt(fit.values[p.effect.name], presses.readings) for p in parts
    )
    return None if fit.at_bound or doubtful or not np.isfinite(fit.misfit) else fit


def sharpened(
    presses: FreeCompliance, plain: FreeComplianceFit, fit: FreeComplianceFit, most: int
) -> FreeComplianceFit:
    """Fit once more from nearer shapes of a grid, if there are any, and return the better fit.

    No derivative leads to the instant of a jump, which lies between two presses; nor is it among a
    sample of the presses.
    """
    parts = []
    for part in fit.parts[len(plain.parts) :]:
        shapes = part.effect.grid(presses.readings, presses.state)
        if len(shapes) > most and len(shapes[0]) == 1:
            fall = _fall(presses, fit, part.effect.name)
            shape = _nearest_shape(shapes, most, fall)
            if fall(shape) > 0:
                part = replace(part, start={**fit.values[part.effect.name], **shape})
        parts.append(part)
    if parts == list(fit.parts[len(plain.parts) :]):
        return fit
    again = fit_set(presses, plain, parts)
    return fit if again is None or again.misfit >= fit.misfit else again


def _fall(presses: FreeCompliance, fit: FreeComplianceFit, name: str) -> Callable[[Values], float]:
    """Return the fall of a fit's squared residual with another shape of one of its effects."""
    move = _move(presses, fit, [part.effect for part in fit.parts])
    weight = fit.weight[fit.press]

    def fall(shape: Values) -> float:
        moved = move(fit.values, {**fit.values, name: {**fit.values[name], **shape}})
        return float(weight @ (fit.residual_m**2 - (fit.residual_m - moved) ** 2))

    return fall


def _move(
    presses: FreeCompliance, fit: FreeComplianceFit, effects: Sequence[Effect]
) -> Callable[[Mapping[str, Values], Mapping[str, Values]], np.ndarray]:
    """Return the change (m,) between two values of effects, less that of the compliances."""
    press, count = fit.press, len(fit.compliance)
    chain, force = presses.chain(effects), presses.readings.force_n
    modulus = presses.unit_compliance / fit.compliance

    def move(one: Mapping[str, Values], other: Mapping[str, Values]) -> np.ndarray:
        sides = (chain.predict(OperatingPoint(fit.compliance, modulus, force, values))
                 for values in (one, other))  # fmt: skip
        moved = -np.subtract(*sides)
        slope = np.bincount(press, force * moved, count) / np.bincount(press, force**2, count)
        return moved - force * slope[press]

    return move


def _nearest_shape(shapes: Sequence[Values], most: int, score: Callable[[Values], float]) -> Values:
    """Return the shape of the highest score among some, evenly spread.

    Shapes of one number are in order: between the best one's neighbours the search goes on.
    """
    low, high = 0, len(shapes) - 1
    while True:
        chosen = np.unique(np.linspace(low, high, most).round().astype(int))
        best = int(np.argmax([score(shapes[i]) for i in chosen]))
        if high - low < most or len(shapes[0]) > 1:
            return shapes[chosen[best]]
        low, high = chosen[max(best - 1, 0)], chosen[min(best + 1, len(chosen) - 1)]


def _start(presses: FreeCompliance, plain: FreeComplianceFit, effect: Effect, most: int) -> Values:
    """Null of the amplitudes, and the candidate of the shape nearest to the residual."""
    shapes = effect.grid(presses.readings, presses.state)
    if len(shapes) == 1:
        return {**shapes[0], **effect.null}
    move = _move(presses, plain, [*(part.effect for part in plain.parts), effect])
    bounded = effect.bounded(presses.readings, presses.state)

    def likeness(shape: Values) -> float:
        none, values = {**shape, **effect.null}, {**shape, **effect.null}
        for p in bounded:
            if p.null is not None:
                values[p.name] = p.null + _STEP * p.typical * (-1 if p.upper == p.null else 1)
        moved = move({**plain.values, effect.name: none}, {**plain.values, effect.name: values})
        along = plain.weight[plain.press] * moved
        length = float(np.sqrt(moved @ along))
        if length == 0:
            return -np.inf
        found = float(along @ plain.residual_m) / length
        return found if effect.one_sided else abs(found)

    return {**_nearest_shape(shapes, most, likeness), **effect.null}


def _ordered(names: Set, parts: Mapping[str, EffectInModel]) -> Set:
    return tuple(name for name in parts if name in names)


def misfit_scale(fits) -> float:
    """Misfit per degree of freedom of the best fit, at least 1."""
    return max(1.0, min((fit.misfit / fit.dof for fit in fits), default=1.0))


def criterion_of(fit: FreeComplianceFit, scale: float) -> float:
    """Misfit in units of a scale, and the price of the parameters."""
    return fit.misfit / scale + fit.unknowns * float(np.log(len(fit.residual)))


def simplest_forms(
    presses: FreeCompliance, parts: Sequence[EffectInModel], catalogue: Sequence[Effect]
) -> list[EffectInModel]:
    """Return the first forms of the causes of some effects; empty where these are they."""
    known = {effect.name: effect for effect in catalogue}
    first = [known.get(part.effect.family, part.effect) for part in parts]
    if [effect.name for effect in first] == [part.effect.name for part in parts]:
        return []
    return [presses.begun(effect, {}) for effect in first]


def simplest(
    top: FreeComplianceFit,
    sets: Sequence[FreeComplianceFit],
    slack: float,
    settings: ContactLawSettings,
) -> FreeComplianceFit:
    """Return the set with the fewest parameters among those of the causes of one that do as well.

    A form of several numbers follows the error of the laws, too, and beside a map it takes the
    place of the compliances. Where it leaves noise, though, and the simpler one does not, there is
    no such error.
    """
    least = top.noise_share - settings.fewer
    alike = [
        fit
        for fit in sets
        if causes(fit) == causes(top)
        and fit.misfit <= top.misfit + slack
        and fit.noise_share >= least
    ]
    calm = [fit for fit in alike if is_calm(fit, settings)]
    return min(calm or alike, key=lambda fit: (fit.unknowns, fit.misfit))
