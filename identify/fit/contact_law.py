"""Search for the contact law: effects of contact, response and instrument in the press curves.

Far from the truth a linear score misleads, and one effect may hide another: a ball with a late
first touch looks like a flat tip. A fit with one free compliance per press
(`identify.fit.free_compliance`) is quick, so that all effects are fitted; unless one leaves too
little for a second, all pairs with one form of each cause; the best pair with any effect in the
place of either; and its extensions by a third effect. These fits are rough, and of many presses to
some, well spread; the sets near the best are then fitted to the end, and to all. The best set wins
in which every effect earns its price.

The laws themselves are right to a few per cent (a ball pressed in by a good part of its radius, the
modulus under the tip from the press's own compliance). An effect must therefore remove at least 5 %
of the excess misfit; sets that differ by less than 1 % are equivalent, however small the noise
(`ContactLawSettings`).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from identify.effects.base import Effect
from identify.fit.contact_law_sets import (
    Set,
    criterion_of,
    fit_set,
    leading_sets,
    misfit_scale,
    search_sets,
    sharpened,
    simplest,
    simplest_forms,
    split_sets,
    step_words,
    well_spread_presses,
)
from identify.fit.free_compliance import FreeCompliance
from identify.fit.free_compliance_fit import (
    FreeComplianceFit,
    causes,
    contained,
    is_calm,
    is_no_law,
    one_of_contact,
)
from identify.fit.settings import CONTACT_LAW, FREE_COMPLIANCE_TRIAL, ContactLawSettings
from identify.measurement.effect_in_model import EffectInModel

_MANY = 1.5  # times `ContactLawSettings.searched`: fewer presses all serve to compare the sets


@dataclass(frozen=True)
class ContactLaw:
    """Contact law of the presses, free of any map.

    Attributes
    ----------
    plain : fit with the effects of the study
    found : fit with further effects
    fits : fits of all sets of further effects, by names
    settings : of the search
    partial : set that takes most of the excess misfit where none leaves noise in enough presses;
        no law of all presses, which may have one each
    ranked : sets that lead in the rough fits
    """

    plain: FreeComplianceFit
    found: FreeComplianceFit
    fits: dict[Set, FreeComplianceFit]
    settings: ContactLawSettings = CONTACT_LAW
    partial: FreeComplianceFit | None = None
    ranked: tuple[Set, ...] = ()

    @property
    def names(self) -> Set:
        """Names of the further effects, empty without any."""
        stated = self.plain.names
        return tuple(name for name in self.found.names if name not in stated)

    @property
    def leading(self) -> tuple[Set, ...]:
        """Sets that a search without a few of the presses tries."""
        return tuple(dict.fromkeys((*self.fits, *self.ranked)))

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
        return criterion_of(fit, misfit_scale(self.fits.values()))

    def range_of(self, name: str) -> dict[str, tuple[float, float]]:
        """How far each parameter of an effect found moves, down and up, by other laws of contact.

        Laws with one effect of the contact more or fewer that explain nearly as much: where
        structure is left, they are as credible (`ContactLawSettings.unsure`).
        """
        most = self.found.misfit + self.settings.unsure * self._excess
        moved = {key: [0.0] for key in self.found.values[name]}
        for names, fit in self.fits.items():
            other = set(names) ^ set(self.names)
            if name in names and fit.misfit < most and one_of_contact((fit, self.found), other):
                for key, value in self.found.values[name].items():
                    moved[key].append(fit.values[name][key] - value)
        return {key: (min(shifts), max(shifts)) for key, shifts in moved.items()}

    def candidates(self, name: str) -> list[tuple[str, FreeComplianceFit]]:
        """Equivalent effects in the place of one of those found, best first."""
        rest = set(self.names) - {name}
        best, near = self.criterion(self.found), []
        slack = self.settings.equal * self._excess / misfit_scale(self.fits.values())
        slack = max(self.settings.margin, slack)
        for names, fit in self.fits.items():
            other = set(names) - rest
            if len(names) != len(self.names) or not rest <= set(names) or other == {name}:
                continue
            (alone,) = other
            as_good = self.criterion(fit) < best + slack and not self._refutes(fit)
            if as_good and name not in contained(fit, alone):
                near.append((alone, fit))
        return sorted(near, key=lambda pair: self.criterion(pair[1]))

    @property
    def refuted(self) -> tuple[Set, ...]:
        """Sets that do as well for the curves, under which presses of one place differ."""
        most = self.found.misfit + _slack(self.plain, self.settings)
        return tuple(n for n, fit in self.fits.items() if fit.misfit < most and self._refutes(fit))

    def _refutes(self, fit: FreeComplianceFit) -> bool:
        """Return True where presses of one place are alike under the law found, not under a fit."""
        worse = min(fit.total - self.found.total, fit.between - self.found.between)
        return self.found.is_of_places and worse > _slack(self.plain, self.settings)

    def splits(self, name: str) -> list[tuple[Set, FreeComplianceFit]]:
        """Pairs of effects in the place of one that do as well with no more numbers, best first."""
        (own,) = (p.effect for p in self.found.parts if p.effect.name == name)
        rest = set(self.names) - {name}
        most = self.criterion(self.found) + self.settings.margin
        pairs = [
            (tuple(n for n in names if n not in rest), fit)
            for names, fit in self.fits.items()
            if len(names) == len(self.names) + 1 and rest < set(names)
            and own.family in names and name not in names
            and fit.unknowns <= self.found.unknowns and self.criterion(fit) < most
            and not self._refutes(fit)
        ]  # fmt: skip
        return sorted(pairs, key=lambda pair: self.criterion(pair[1]))


def contact_law(
    presses: FreeCompliance,
    catalogue: Sequence[Effect],
    stated: Sequence[EffectInModel] = (),
    say: Callable[[str], None] = lambda text: None,
    settings: ContactLawSettings = CONTACT_LAW,
    tried: Sequence[Set] = (),
) -> ContactLaw:
    """Find the effects of contact, response and instrument in the press curves.

    Parameters
    ----------
    catalogue : effects that may be found; those of the body act on compliances and are not seen
    stated : effects of the study
    say : called with the present task, in words
    tried : sets to try, all without any: those that lead with a few presses more
    """
    plain, count = presses.fit(stated), presses.readings.presses
    many = count >= _MANY * settings.searched
    few = well_spread_presses(presses, settings.searched) if many else presses
    few = replace(few, settings=FREE_COMPLIANCE_TRIAL)
    quick = replace(settings, margin=settings.margin * few.readings.presses / count)
    before = few.fit(stated)
    trials, fits = search_sets(few, before, catalogue, say, quick, tried), {}
    ranked = leading_sets(before, trials, quick)

    def fitted(sets: Sequence[Set]) -> None:
        for number, names in enumerate(sets, start=1):
            say(step_words("all presses", names, number, len(sets)))
            # Few presses have narrower bounds: a jump near the scan's ends, a reach
            parts = [presses.part(p.effect, p.start) for p in trials[names].parts[len(stated) :]]
            if (fit := fit_set(presses, plain, parts)) is not None:
                fits[names] = sharpened(presses, plain, fit, settings.shapes)

    fitted(_near(before, trials, quick))
    best = _best(plain, fits, settings)
    if best.noise_share >= settings.noise_share:
        own = set(best.names) - set(plain.names)
        fitted([n for n in trials if n not in fits
                and one_of_contact((trials[n], best), own ^ set(n))])  # fmt: skip
    best = _best(plain, fits, settings)
    if best is plain or best.noise_share >= settings.noise_share:
        fits = {**split_sets(presses, plain, best, catalogue, say, settings), **fits}
        best, fits = _told_by_places(presses, plain, best, fits, settings)
        return ContactLaw(plain, best, fits, settings, None, ranked)
    law = ContactLaw(plain, plain, fits, settings, None, ranked)
    # Where presses have laws of their own, a form of several numbers follows their differences
    found = best.parts[len(stated) :]
    if (simple := simplest_forms(presses, found, catalogue)) and (
        fit := fit_set(presses, plain, simple)
    ):
        fits[fit.names[len(stated) :]] = fit
    alike = [fit for fit in fits.values() if len(fit.names) == len(best.names)]
    best = simplest(best, alike, settings.unsure * law._excess, settings)
    share = replace(law, found=best).share
    return replace(law, partial=best) if share > settings.most_of else law


def _slack(plain: FreeComplianceFit, settings: ContactLawSettings) -> float:
    """Return the misfit within which laws are equal."""
    return max(settings.margin, settings.equal * max(plain.misfit - plain.dof, 0.0))


def _told_by_places(
    presses: FreeCompliance,
    plain: FreeComplianceFit,
    best: FreeComplianceFit,
    fits: Mapping[Set, FreeComplianceFit],
    settings: ContactLawSettings,
) -> tuple[FreeComplianceFit, dict[Set, FreeComplianceFit]]:
    """Compare the presses of each place under the laws that do as well for the curves.

    A place has one compliance. Presses that have it under one law refute the laws without it.
    """
    slack = _slack(plain, settings)
    told = {
        names: presses.compared(fit)
        for names, fit in fits.items()
        if best.names != plain.names and fit.misfit < best.misfit + slack
    }
    best = next((fit for fit in told.values() if fit.names == best.names), best)
    first = min(
        (f for f in told.values() if f.is_of_places
         and (f.unknowns <= best.unknowns or len(f.names) == len(best.names))),
        key=lambda fit: fit.total, default=best,
    )  # fmt: skip
    if first.total < best.total - slack:
        best = first
    return best, {**fits, **told}


def _near(
    plain: FreeComplianceFit, fits: Mapping[Set, FreeComplianceFit], settings: ContactLawSettings
) -> list[Set]:
    """Return the sets that may be chosen on all presses, or be equivalent there; smallest first."""
    scale = misfit_scale([plain, *fits.values()])
    excess = (plain.misfit - plain.dof) / scale
    near: list[Set] = []
    waiting: list[Set] = []
    best, number = plain, 0
    for size in range(1, settings.most_effects + 1):
        sets = sorted(
            (names for names in fits if len(names) == size),
            key=lambda names: criterion_of(fits[names], scale),
        )
        if not sets:
            continue
        top = fits[sets[0]]
        least = settings.perhaps * max(settings.margin, settings.least * excess) * (size - number)
        if criterion_of(best, scale) - criterion_of(top, scale) <= least:
            waiting.append(sets[0])
            continue
        most = criterion_of(top, scale) + max(settings.margin, settings.near * excess)
        if is_no_law(top, settings):  # nor are its equals
            most = -np.inf
            waiting += sets[: settings.refitted_partial]
        close = [n for n in sets[: settings.refitted] if criterion_of(fits[n], scale) < most]
        textbook = _textbook(fits[sets[0]], [fits[n] for n in sets], plain, settings)
        close += [n for n in sets if any(fits[n] is fit for fit in textbook) and n not in close][
            : settings.refitted_partial
        ]
        near, waiting = [*near, *waiting, *close], []
        best, number = top, size
    return near


def _best(
    plain: FreeComplianceFit, fits: Mapping[Set, FreeComplianceFit], settings: ContactLawSettings
) -> FreeComplianceFit:
    """Smallest set that no larger one beats by more than the margin for each further effect.

    Of its size it is the best one, or simpler forms of the same causes that do as well, or a
    textbook law of another cause that does nearly as well as a free form. It is the law of none if
    it leaves structure in too many presses: its gain may then be what differs between presses.
    """
    scale = misfit_scale([plain, *fits.values()])
    least = max(settings.margin, settings.least * (plain.misfit - plain.dof) / scale)
    best, number = plain, 0
    for size in range(1, settings.most_effects + 1):
        sets = [fit for names, fit in fits.items() if len(names) == size]
        if not sets:
            continue
        top = min(sets, key=lambda fit: criterion_of(fit, scale))
        top = simplest(top, sets, settings.equal * max(plain.misfit - plain.dof, 0.0), settings)
        top = min(
            _textbook(top, sets, plain, settings),
            key=lambda fit: criterion_of(fit, scale),
            default=top,
        )
        gain = criterion_of(best, scale) - criterion_of(top, scale)
        # A rising error is no gain: chi-square also falls where the slope, and the noise, grow
        if gain > least * (size - number) and top.misfit < best.misfit:
            best, number = top, size
    return best


def _textbook(
    top: FreeComplianceFit,
    sets: Sequence[FreeComplianceFit],
    plain: FreeComplianceFit,
    settings: ContactLawSettings,
) -> list[FreeComplianceFit]:
    """Return the sets with a textbook law in the place of a free form that do nearly as well.

    A free curve also takes what the laws err by: beside a ball that was declared flat, a stiffening
    of four numbers took 5 % more of the excess misfit than the ball of one. The law is of another
    cause, and as many presses are noise; the free form stays a candidate. Where it leaves noise,
    and the textbook law does not, the laws do not err.
    """
    free = {p.effect.name for p in top.parts if p.effect.name != p.effect.family}
    known = set(causes(top))
    if not free:
        return []
    most = top.misfit + settings.unsure * max(plain.misfit - plain.dof, 0.0)
    near = []
    for fit in sets:
        new = [p.effect for p in fit.parts if p.effect.name not in top.names]
        if (
            len(new) == 1
            and new[0].name == new[0].family
            and new[0].family not in known
            and set(top.names) - set(fit.names) <= free
            and fit.unknowns < top.unknowns
            and fit.misfit <= most
            and fit.noise_share >= top.noise_share - settings.fewer
            and (is_calm(fit, settings) or not is_calm(top, settings))
        ):
            near.append(fit)
    return near
