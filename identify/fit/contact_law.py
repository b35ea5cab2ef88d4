"""Which effects of contact, response and instrument the presses call for by themselves.

Far from the truth a linear score misleads, and one effect may hide another: a ball whose first
touch is declared late looks like a flat tip. A fit of the presses by themselves (`press_wise`)
takes milliseconds, so that all effects and all pairs of them are fitted, and then what a third
adds; the best set is taken whose every member earns its price.

The laws themselves are right to a few per cent (a ball pressed in by a good part of its radius, the
modulus under the tip from the press's own compliance). So an effect must take `_LEAST` of what the
presses have too much, and two sets within `_ROUGH` of it are as good as each other, however small
the noise.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from identify.effects.base import Effect, Values
from identify.fit.free_compliance import FreeCompliance, FreeComplianceFit
from identify.measurement.model import EffectInModel
from identify.optimize.result import InadmissibleError

GROSS = 9.0  # chi-square per degree of freedom of the presses by themselves: three times the noise
MARGIN = 10.0  # in chi-square, after the price of parameters and in units of what remains
GOOD = 0.8  # share of the presses from which on a law is theirs
_MOST = 3  # effects in a law
_LEAST, _ROUGH = 0.05, 0.01  # of the excess misfit of the presses
_SHAPES = 12  # candidates of a shape that are tried
_SMALL = 0.01  # of an amplitude's typical size

Set = tuple[str, ...]


@dataclass(frozen=True)
class ContactLaw:
    """What the presses show by themselves.

    Attributes
    ----------
    plain : with the effects that the study has
    found : with those that were found besides
    fits : all sets of effects that were fitted, beside the study's, by names
    """

    plain: FreeComplianceFit
    found: FreeComplianceFit
    fits: dict[Set, FreeComplianceFit]

    @property
    def names(self) -> Set:
        """Names of the effects that were found, none where the presses call for none."""
        had = self.plain.names
        return tuple(name for name in self.found.names if name not in had)

    @property
    def share(self) -> float:
        """Share of the presses' excess misfit that the effects take away, 0 to 1."""
        left = max(self.found.misfit - self.found.dof, 0.0)
        return float(np.clip(1 - left / self._excess, 0.0, 1.0))

    @property
    def _excess(self) -> float:
        return max(self.plain.misfit - self.plain.dof, 1e-9)

    def criterion(self, fit: FreeComplianceFit) -> float:
        """Misfit in units of what the best law leaves, and the price of the parameters."""
        return _criterion(fit, _scale(self.fits.values()))

    def candidates(self, name: str) -> list[tuple[str, FreeComplianceFit]]:
        """Effects that do as well in the place of one of those found, best first."""
        rest = set(self.names) - {name}
        best, near = self.criterion(self.found), []
        slack = max(MARGIN, _ROUGH * self._excess / _scale(self.fits.values()))
        for names, fit in self.fits.items():
            other = set(names) - rest
            if len(names) != len(self.names) or not rest <= set(names) or other == {name}:
                continue
            (own,) = other
            if self.criterion(fit) < best + slack and name not in _contained(fit, own):
                near.append((own, fit))
        return sorted(near, key=lambda pair: self.criterion(pair[1]))


def contact_law(
    presses: FreeCompliance,
    catalogue: Sequence[Effect],
    had: Sequence[EffectInModel] = (),
    say: Callable[[str], None] = lambda text: None,
) -> ContactLaw:
    """Find the effects that the presses call for by themselves.

    Parameters
    ----------
    catalogue : effects that may be found; those of the body are not seen by presses alone
    had : effects that the study has
    say : called with what is being done
    """
    plain = presses.fit(had)
    known = {part.effect.name for part in had}
    free = [
        e
        for e in catalogue
        if e.link != "body" and e.name not in known and e.untestable(presses.readings) is None
    ]
    parts = {e.name: presses.part(e, _start(presses, plain, e)) for e in free}
    fits: dict[Set, FreeComplianceFit] = {}

    def tried(names: Set) -> None:
        say(f"fitting the presses by themselves with {', '.join(names)}")
        fit = _fitted(presses, plain, [parts[name] for name in names])
        if fit is not None:
            fits[names] = fit

    for size in (1, 2):
        for names in combinations(parts, size):
            tried(names)
    while fits:
        best = min(fits, key=lambda names: _criterion(fits[names], _scale([plain, *fits.values()])))
        wider = [_ordered((*best, name), parts) for name in parts if name not in best]
        new = [names for names in wider if names not in fits and len(names) <= _MOST]
        if len(best) < 2 or not new:
            break
        for names in new:
            tried(names)
        if not any(names in fits for names in new):
            break
    return ContactLaw(plain, _chosen(plain, fits), fits)


def _chosen(plain: FreeComplianceFit, fits: dict[Set, FreeComplianceFit]) -> FreeComplianceFit:
    """Smallest set that no larger one beats by more than the margin for each effect more.

    None of them, where even the best leaves more than noise in too many presses: what it takes away
    may then be anything that differs from press to press.
    """
    scale = _scale([plain, *fits.values()])
    least = max(MARGIN, _LEAST * (plain.misfit - plain.dof) / scale)
    best, number = plain, 0
    for size in range(1, _MOST + 1):
        own = [fit for names, fit in fits.items() if len(names) == size]
        if not own:
            continue
        top = min(own, key=lambda fit: _criterion(fit, scale))
        gain = _criterion(best, scale) - _criterion(top, scale)
        # A rising error is no gain: chi-square also falls where the slope, and the noise, grow
        if gain > least * (size - number) and top.misfit < best.misfit:
            best, number = top, size
    return best if best.noise_share >= GOOD else plain


def _fitted(
    presses: FreeCompliance, plain: FreeComplianceFit, parts: Sequence[EffectInModel]
) -> FreeComplianceFit | None:
    """Fit the study's effects and some more; None where that cannot be, or stops at a bound."""
    chain = presses.chain([part.effect for part in (*plain.parts, *parts)])
    if any(part.effect.redundant(chain.profile, chain.nonlinear) for part in parts):
        return None
    try:
        with np.errstate(over="ignore", invalid="ignore"):  # a step too far is turned back
            fit = presses.fit((*plain.parts, *parts), plain.compliance)
    except InadmissibleError:
        return None
    doubtful = any(p.effect.doubt(fit.values[p.effect.name], presses.readings) for p in parts)
    return None if fit.at_bound or doubtful or not np.isfinite(fit.misfit) else fit


def _start(presses: FreeCompliance, plain: FreeComplianceFit, effect: Effect) -> Values:
    """Null of the amplitudes, and the candidate of the shape that the residual likes best."""
    shapes = effect.grid(presses.readings, presses.state)
    if len(shapes) > _SHAPES:
        chosen = np.linspace(0, len(shapes) - 1, _SHAPES).round().astype(int)
        shapes = [shapes[i] for i in chosen]
    if len(shapes) == 1:
        return {**shapes[0], **effect.null}
    press, count = plain.press, len(plain.compliance)
    chain = presses.chain([*(part.effect for part in plain.parts), effect])
    modulus = presses.unit_compliance / plain.compliance
    force = presses.readings.force_n
    liked = []
    for shape in shapes:
        sides = []
        for size in (0.0, _SMALL):
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
        # Residuals of the plain fit are whitened; what is liked is the same in metres
        liked.append(float(along @ plain.residual_m) / length if length > 0 else -np.inf)
    best = int(np.argmax(liked if effect.one_sided else np.abs(liked)))
    return {**shapes[best], **effect.null}


def _contained(fit: FreeComplianceFit, name: str) -> tuple[str, ...]:
    return next(p.effect.contains for p in fit.parts if p.effect.name == name)


def _ordered(names: Set, parts: dict[str, EffectInModel]) -> Set:
    return tuple(name for name in parts if name in names)


def _scale(fits) -> float:
    """Misfit per degree of freedom of the best fit, at least 1."""
    return max(1.0, min((fit.misfit / fit.dof for fit in fits), default=1.0))


def _criterion(fit: FreeComplianceFit, scale: float) -> float:
    return fit.misfit / scale + fit.unknowns * float(np.log(len(fit.residual)))
