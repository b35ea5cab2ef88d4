"""Search for the contact law: effects of contact, response and instrument in the press curves.

Far from the truth a linear score misleads, and one effect may hide another: a ball with a late
first touch looks like a flat tip. A fit with one free compliance per press
(`identify.fit.free_compliance`) is quick, so that all effects are fitted; unless one leaves too
little for a second, all pairs with one form of each cause; the best pair with any effect in the
place of either; and its extensions by a third effect. The best set wins in which every effect earns
its price. Of many presses some, well spread, serve to compare the sets; those near the best are
fitted to all.

The laws themselves are right to a few per cent (a ball pressed in by a good part of its radius, the
modulus under the tip from the press's own compliance). An effect must therefore remove at least 5 %
of the excess misfit; sets that differ by less than 1 % are equivalent, however small the noise
(`ContactLawSettings`).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from identify.effects.base import Effect, Values, advice
from identify.fit.free_compliance import FreeCompliance
from identify.fit.free_compliance_fit import FreeComplianceFit
from identify.fit.settings import CONTACT_LAW, FREE_COMPLIANCE_TRIAL, ContactLawSettings
from identify.measurement.effect_in_model import EffectInModel
from identify.optimize.result import InadmissibleError
from models import well_spread

_MANY = 1.5  # times `ContactLawSettings.searched`: fewer presses are all searched
_STEP = 0.01  # of an amplitude's typical size, for its pattern

Set = tuple[str, ...]


@dataclass(frozen=True)
class ContactLaw:
    """Contact law of the presses, free of any map.

    Attributes
    ----------
    plain : fit with the effects of the study
    found : fit with further effects
    fits : fits of all sets of further effects, by names
    settings : of the search
    """

    plain: FreeComplianceFit
    found: FreeComplianceFit
    fits: dict[Set, FreeComplianceFit]
    settings: ContactLawSettings = CONTACT_LAW

    @property
    def names(self) -> Set:
        """Names of the further effects, empty without any."""
        stated = self.plain.names
        return tuple(name for name in self.found.names if name not in stated)

    @property
    def share(self) -> float:
        """Share of the presses' excess misfit that the effects remove, 0 to 1."""
        left = max(self.found.misfit - self.found.dof, 0.0)
        return float(np.clip(1 - left / self._excess, 0.0, 1.0))

    @property
    def _excess(self) -> float:
        return max(self.plain.misfit - self.plain.dof, 1e-9)

    def criterion(self, fit: FreeComplianceFit) -> float:
        """Misfit in units of that of the best law, and the price of the parameters."""
        return _criterion(fit, _scale(self.fits.values()))

    def candidates(self, name: str) -> list[tuple[str, FreeComplianceFit]]:
        """Equivalent effects in the place of one of those found, best first."""
        rest = set(self.names) - {name}
        best, near = self.criterion(self.found), []
        slack = self.settings.equal * self._excess / _scale(self.fits.values())
        slack = max(self.settings.margin, slack)
        for names, fit in self.fits.items():
            other = set(names) - rest
            if len(names) != len(self.names) or not rest <= set(names) or other == {name}:
                continue
            (alone,) = other
            if self.criterion(fit) < best + slack and name not in _contained(fit, alone):
                near.append((alone, fit))
        return sorted(near, key=lambda pair: self.criterion(pair[1]))


def contact_law(
    presses: FreeCompliance,
    catalogue: Sequence[Effect],
    stated: Sequence[EffectInModel] = (),
    say: Callable[[str], None] = lambda text: None,
    settings: ContactLawSettings = CONTACT_LAW,
) -> ContactLaw:
    """Find the effects of contact, response and instrument in the press curves.

    Parameters
    ----------
    catalogue : effects that may be found; those of the body act on compliances and are not seen
    stated : effects of the study
    say : called with the present task, in words
    """
    plain, count = presses.fit(stated), presses.readings.presses
    if count < _MANY * settings.searched:
        fits = _searched(presses, plain, catalogue, say, settings)
    else:
        few = _spread(presses, settings.searched)
        quick = replace(settings, margin=settings.margin * few.readings.presses / count)
        before = few.fit(stated)
        trials = _searched(few, before, catalogue, say, quick)
        fits = {}
        for names in _near(before, trials, quick):
            say(f"fitting all presses alone with {', '.join(names)}")
            parts = trials[names].parts[len(stated) :]
            if (fit := _fitted(presses, plain, parts)) is not None:
                fits[names] = fit
    return ContactLaw(plain, _chosen(plain, fits, settings), fits, settings)


def _spread(presses: FreeCompliance, most: int) -> FreeCompliance:
    """Return so many presses that met resistance, well spread over the surface and the tips."""
    felt, r = np.flatnonzero(presses.felt), presses.readings
    place = r.point_m[r.first[felt]] / max(float(r.between_m.max()), 1e-9)
    tip = np.log(r.radius_m[r.first[felt]])
    some = presses.some(felt[well_spread(np.column_stack([place, tip]), most)])
    return replace(some, settings=FREE_COMPLIANCE_TRIAL)


def _near(
    plain: FreeComplianceFit, fits: Mapping[Set, FreeComplianceFit], settings: ContactLawSettings
) -> list[Set]:
    """Return the sets that may be chosen on all presses, or be equivalent there; smallest first."""
    scale = _scale([plain, *fits.values()])
    excess = (plain.misfit - plain.dof) / scale
    near: list[Set] = []
    waiting: list[Set] = []
    best, number = plain, 0
    for size in range(1, settings.most_effects + 1):
        sets = sorted(
            (names for names in fits if len(names) == size),
            key=lambda names: _criterion(fits[names], scale),
        )
        if not sets:
            continue
        top = fits[sets[0]]
        least = settings.perhaps * max(settings.margin, settings.least * excess) * (size - number)
        if _criterion(best, scale) - _criterion(top, scale) <= least:
            waiting.append(sets[0])
            continue
        most = _criterion(top, scale) + max(settings.margin, settings.near * excess)
        close = [n for n in sets[: settings.refitted] if _criterion(fits[n], scale) < most]
        near, waiting = [*near, *waiting, *close], []
        best, number = top, size
    return near


def _searched(
    presses: FreeCompliance,
    plain: FreeComplianceFit,
    catalogue: Sequence[Effect],
    say: Callable[[str], None],
    settings: ContactLawSettings,
) -> dict[Set, FreeComplianceFit]:
    """Fit the sets of effects among which the law is sought, by their names."""
    free = [
        e
        for e in catalogue
        if e.link != "body" and e.name not in plain.names and e.untestable(presses.readings) is None
    ]
    parts = {e.name: presses.part(e, _start(presses, plain, e, settings.shapes)) for e in free}
    fits: dict[Set, FreeComplianceFit] = {}
    seen: set[Set] = set()

    def tried(names: Set) -> None:
        seen.add(names)
        say(f"fitting the presses alone with {', '.join(names)}")
        fit = _fitted(presses, plain, [parts[name] for name in names])
        if fit is not None:
            fits[names] = fit

    def criterion(names: Set) -> float:
        return _criterion(fits[names], _scale([plain, *fits.values()]))

    for name in parts:
        tried((name,))
    if all(_has_room(plain, fit, settings) for fit in fits.values()):
        for names in combinations(_one_form_each(parts, fits, criterion), 2):
            tried(names)
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
        for names in new:
            tried(names)
    return fits


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


def _chosen(
    plain: FreeComplianceFit, fits: dict[Set, FreeComplianceFit], settings: ContactLawSettings
) -> FreeComplianceFit:
    """Smallest set that no larger one beats by more than the margin for each further effect.

    None of them, if even the best leaves structure in too many presses: its gain may then be
    anything that differs from press to press.
    """
    scale = _scale([plain, *fits.values()])
    least = max(settings.margin, settings.least * (plain.misfit - plain.dof) / scale)
    best, number = plain, 0
    for size in range(1, settings.most_effects + 1):
        sets = [fit for names, fit in fits.items() if len(names) == size]
        if not sets:
            continue
        top = min(sets, key=lambda fit: _criterion(fit, scale))
        gain = _criterion(best, scale) - _criterion(top, scale)
        # A rising error is no gain: chi-square also falls where the slope, and the noise, grow
        if gain > least * (size - number) and top.misfit < best.misfit:
            best, number = top, size
    return best if best.noise_share >= settings.noise_share else plain


def _fitted(
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


def _start(presses: FreeCompliance, plain: FreeComplianceFit, effect: Effect, most: int) -> Values:
    """Null of the amplitudes, and the candidate of the shape nearest to the residual."""
    shapes = effect.grid(presses.readings, presses.state)
    if len(shapes) > most:
        chosen = np.linspace(0, len(shapes) - 1, most).round().astype(int)
        shapes = [shapes[i] for i in chosen]
    if len(shapes) == 1:
        return {**shapes[0], **effect.null}
    press, count = plain.press, len(plain.compliance)
    chain = presses.chain([*(part.effect for part in plain.parts), effect])
    modulus = presses.unit_compliance / plain.compliance
    force = presses.readings.force_n
    likeness = []
    for shape in shapes:
        sides = []
        for size in (0.0, _STEP):
            values = {**shape, **effect.null}
            for p in effect.bounded(presses.readings, presses.state):
                if p.null is not None:
                    values[p.name] = p.null + size * p.typical * (-1 if p.upper == p.null else 1)
            both = {**plain.values, effect.name: values}
            sides.append(chain.predict(plain.compliance, modulus, force, both))
        moved = sides[1] - sides[0]
        moved -= force * (np.bincount(press, force * moved, count)
                          / np.bincount(press, force**2, count))[press]  # fmt: skip
        along = plain.weight[press] * moved
        length = float(np.sqrt(moved @ along))
        likeness.append(float(along @ plain.residual_m) / length if length > 0 else -np.inf)
    best = int(np.argmax(likeness if effect.one_sided else np.abs(likeness)))
    return {**shapes[best], **effect.null}


def _contained(fit: FreeComplianceFit, name: str) -> tuple[str, ...]:
    return next(p.effect.contains for p in fit.parts if p.effect.name == name)


def _ordered(names: Set, parts: Mapping[str, EffectInModel]) -> Set:
    return tuple(name for name in parts if name in names)


def _scale(fits) -> float:
    """Misfit per degree of freedom of the best fit, at least 1."""
    return max(1.0, min((fit.misfit / fit.dof for fit in fits), default=1.0))


def _criterion(fit: FreeComplianceFit, scale: float) -> float:
    return fit.misfit / scale + fit.unknowns * float(np.log(len(fit.residual)))
