"""The checks of the conformance kit; each returns its finding, or raises `Fault`."""

import re
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np

from identify.effects.base import Effect, EffectParameter, Values
from identify.effects.conformance.example_scan import ExampleScan, arrays_of, ragged, trial
from identify.effects.conformance.worked_example import work
from identify.effects.hook import hook_fault

_TEXTS = ("title", "summary", "formula", "source", "gives_away", "cure")
_ENDINGS = {"m": "_m", "s": "_s", "N": "_n", "Hz": "_hz", "rad": "_rad", "Pa": "_pa", "N/s": "_s"}
_ENDS = ("lower", "upper")


class Fault(Exception):
    """Fault of an effect, in one line."""


_TOGETHER = 64  # patterns whose products with all others are made at once


def described(effect: Effect, case: ExampleScan) -> str:
    """Demand name, summary, formula, source and so on."""
    name = getattr(effect, "name", None)
    if not isinstance(name, str) or not re.fullmatch(r"[a-z][a-z0-9_]*", name):
        raise Fault(f"name is {name!r}, expected small letters, digits and _")
    missing = [t for t in _TEXTS if not str(getattr(effect, t, "") or "").strip()]
    if missing:
        raise Fault(f"no {', '.join(missing)}")
    return f"'{effect.name}'"


def parameters(effect: Effect, case: ExampleScan) -> str:
    """Demand units, bounds and sizes of every parameter."""
    found = getattr(effect, "parameters", ())
    names = [p.name for p in found]
    if not found or found[0].null is None:
        raise Fault("no amplitude: the first parameter needs a null value")
    if len(set(names)) < len(names):
        raise Fault(f"parameters of equal name: {names}")
    kinds = [p.null is None for p in found]
    if kinds != sorted(kinds):
        raise Fault("shape parameters (null None) stand before amplitudes")
    for p in found:
        _sound(p)
    bounded = effect.bounded(case.readings, case.state)
    if [p.name for p in bounded] != names:
        raise Fault(f"bounded() returns {[p.name for p in bounded]}, expected {names}")
    for p in bounded:
        _sound(p, fixed=True)
    return ", ".join(names)


def _sound(p: EffectParameter, fixed: bool = False) -> None:
    if not p.unit.strip() or not p.meaning.strip():
        raise Fault(f"{p.name} has no unit or no meaning")
    ending = _ENDINGS.get(p.unit)
    if ending and not p.name.endswith(ending):
        raise Fault(f"{p.name} is in {p.unit}: its name should end with {ending}")
    numbers = [p.lower, p.upper, p.typical, *([] if p.null is None else [p.null])]
    if not np.all(np.isfinite(numbers)):
        raise Fault(f"{p.name} has a bound or size that is not finite: {numbers}")
    # A body may leave no room on one side: Poisson's ratio at its largest.
    if not p.lower < p.upper or (p.null is not None and not p.lower <= p.null <= p.upper):
        raise Fault(f"{p.name}: null {p.null} is not between {p.lower} and {p.upper}")
    if not p.typical > 0:
        raise Fault(f"{p.name}: typical size {p.typical} is not positive")
    if p.null is None and not fixed and not p.lower <= p.typical <= p.upper:
        raise Fault(f"{p.name}: typical {p.typical} is not between {p.lower} and {p.upper}")
    if p.log and (p.null is not None or p.lower <= 0):
        raise Fault(f"{p.name}: only a positive shape parameter can be sought as a logarithm")


def hook(effect: Effect, case: ExampleScan) -> str:
    """Demand one hook that takes the effect's parameters by name."""
    fault = hook_fault(type(effect))
    if fault:
        raise Fault(fault)
    return f"{effect.hooks[0]}()"


def examples(effect: Effect, case: ExampleScan) -> str:
    """Do the worked examples."""
    if not effect.examples:
        raise Fault("no worked example")
    names = {p.name for p in effect.parameters}
    accuracy = case.settings.example
    for number, example in enumerate(effect.examples, 1):
        if set(example.values) != names:
            raise Fault(f"example {number} gives {sorted(example.values)}, not {sorted(names)}")
        if all(example.values[p.name] == p.null for p in effect.amplitudes):
            raise Fault(f"example {number} is at the null, where nothing happens")
        for name, got in work(effect, example).items():
            wanted = np.atleast_1d(example.expected[name])
            close = np.shape(got) == wanted.shape and np.allclose(
                got, wanted, rtol=accuracy, atol=accuracy * float(np.abs(wanted).max())
            )
            if not close:
                raise Fault(f"example {number}: {name} is {got.tolist()}, not {wanted.tolist()}")
    return f"{len(effect.examples)} reproduced"


def testable(effect: Effect, case: ExampleScan) -> str:
    """Demand a reason from a scan without the needs of the effect."""
    reason = effect.untestable(case.readings)
    if reason:
        raise Fault(f"a scan with everything is refused: {reason}")
    for need in effect.needs:
        if not effect.untestable(case.lacking(need).readings):
            raise Fault(f"needs {need}, but accepts a scan without")
    if "time" not in effect.needs:
        effect.grid(case.without_time().readings, case.state)
        case.without_time().out(effect, _typical(effect, case))
    return f"needs {', '.join(effect.needs) or 'nothing special'}"


# ---- the hook ----------------------------------------------------------------------------


def identity(effect: Effect, case: ExampleScan) -> str:
    """Set the amplitudes to their null: nothing may happen."""
    worst = 0.0
    for scan in _scans(effect, case):
        plain = scan.plain(effect)
        for shape in _shapes(effect, scan):
            change = scan.out(effect, {**shape, **effect.null}) - plain
            worst = max(worst, float(np.abs(change).max() / np.abs(plain).max()))
    if not worst <= case.settings.rounding:
        raise Fault(f"changes readings by {worst:.1e} of the largest, expected rounding only")
    return f"off by {worst:.0e} of the largest number"


def repeatable(effect: Effect, case: ExampleScan) -> str:
    """Do the same twice."""
    values = _typical(effect, case)
    first, second = case.out(effect, values), case.out(effect, values)
    if not np.array_equal(first, second):
        raise Fault(f"a second call differs by up to {np.abs(first - second).max():.1e}")
    return "bit for bit"


def untouched(effect: Effect, case: ExampleScan) -> str:
    """Look for writing to the input of the hook."""
    before = {name: array.copy() for name, array in arrays_of(case)}
    values = _typical(effect, case)
    kept = dict(values)
    out = case.out(effect, values)
    changed = [k for k, v in arrays_of(case) if k in before and not np.array_equal(v, before[k])]
    for name, array in arrays_of(case):  # for the checks that follow
        if name in changed:
            array[...] = before[name]
    if changed or values != kept:
        raise Fault(f"writes to {', '.join(changed) or 'the values'}")
    if effect.link != "body" and any(out is array for _, array in arrays_of(case)):
        raise Fault("returns its input away from the null, or writes into it")
    return "inputs are as before"


def finite(effect: Effect, case: ExampleScan) -> str:
    """Go to all bounds: numbers must be finite and of the right shape."""
    tried = 0
    for scan in _scans(effect, case):
        for values in _corners(effect, scan):
            out = scan.out(effect, values)
            if np.shape(out) != np.shape(scan.plain(effect)):
                wanted = np.shape(scan.plain(effect))
                raise Fault(f"returns shape {np.shape(out)}, expected {wanted}")
            if not np.all(np.isfinite(out)):
                raise Fault(f"{np.sum(~np.isfinite(out))} numbers are not finite at {_say(values)}")
            tried += 1
    return f"{tried} combinations"


def moving(effect: Effect, case: ExampleScan) -> str:
    """Move every parameter by half of its typical size: some reading must follow."""
    typical, plain = _typical(effect, case), case.plain(effect)
    least = np.inf
    for p in effect.bounded(case.readings, case.state):
        room = p.upper - typical[p.name]
        step = min(0.5 * p.typical, room) if room > 0 else -0.5 * p.typical
        change = case.out(effect, {**typical, p.name: typical[p.name] + step})
        moved = float(np.abs(change - case.out(effect, typical)).max() / np.abs(plain).max())
        if not moved > case.settings.least_change:
            raise Fault(f"{p.name} moves no reading: {step:.2g} {p.unit} change it by {moved:.0e}")
        least = min(least, moved)
    return f"by {least:.1e} of the largest and more"


def steady(effect: Effect, case: ExampleScan) -> str:
    """Add very little force: no reading may jump."""
    if effect.link == "body":
        return "not asked of a body"
    nudge = 1e-7 * case.readings.largest_force_n
    force = case.readings.force_n + nudge
    near = replace(
        case,
        readings=replace(case.readings, force_n=force),
        travel_m=case.pressing.compliance_m_per_n * force,
    )
    worst = 0.0
    for values in _corners(effect, case):
        out = case.out(effect, values)
        jump = float(np.abs(near.out(effect, values) - out).max() / np.abs(out).max())
        if not jump < 1e-3:
            raise Fault(f"force + 1e-7 changes a reading by {jump:.1e} at {_say(values)}")
        worst = max(worst, jump)
    return f"1e-7 of the force changes a reading by {worst:.0e} at most"


# ---- the grid, the words -----------------------------------------------------------------


def grid(effect: Effect, case: ExampleScan) -> str:
    """Demand candidates of the shape parameters within their bounds."""
    candidates = effect.grid(case.readings, case.state)
    if not candidates:
        raise Fault("grid() returns no candidate; without shape parameters it returns [{}]")
    names = {p.name for p in effect.shapes}
    bounded = {p.name: p for p in effect.bounded(case.readings, case.state)}
    for candidate in candidates:
        if set(candidate) != names:
            raise Fault(f"a candidate has {sorted(candidate)}, expected {sorted(names)}")
        for name, value in candidate.items():
            p = bounded[name]
            if not p.lower <= value <= p.upper:
                raise Fault(
                    f"candidate {name} = {value:.3g} is not in {p.lower:.3g}..{p.upper:.3g}"
                )
    return f"{len(candidates)}"


def dense(effect: Effect, case: ExampleScan) -> str:
    """Compare the patterns of neighbouring candidates."""
    candidates = effect.grid(case.readings, case.state)
    if len(candidates) < 2:
        return "one candidate"
    patterns = np.array([_pattern(effect, case, candidate) for candidate in candidates])
    if len(effect.shapes) == 1:
        near = _likeness(np.array([b.T @ a for a, b in pairwise(patterns)]))
    else:
        near = _best_neighbours(patterns)
    least, gaps = case.settings.near, case.settings.gaps
    far = np.flatnonzero(near < least)
    if len(far) > gaps * len(near):
        raise Fault(
            f"{len(far)} of {len(near)} neighbours are alike by less than {least} (cosine), the "
            f"first after {_say(candidates[int(far[0])])}: take a finer grid"
        )
    return f"cosine {np.quantile(near, gaps):.2f} and up"


def evident(effect: Effect, case: ExampleScan) -> str:
    """Read the evidence: a sentence with numbers."""
    sentence = ""
    for values in (_typical(effect, case, -1.0), _typical(effect, case)):
        for scan in _scans(effect, case):
            sentence = effect.evidence(values, scan.readings)
            if not isinstance(sentence, str) or not re.search(r"\d", sentence):
                raise Fault(f"evidence() has no number: {sentence!r}")
            if not sentence.strip().endswith(".") or re.search(r"\bnan\b|\binf\b", sentence):
                raise Fault(f"evidence() is no sentence: {sentence!r}")
    return sentence


def _scans(effect: Effect, case: ExampleScan) -> Iterator[ExampleScan]:
    """Yield the example scan, one with rows lost, and one without time for a timeless effect."""
    yield case
    yield ragged(trial(2, start_s=1.7e9))
    if "time" not in effect.needs:
        yield case.without_time()


def _shapes(effect: Effect, scan: ExampleScan) -> list[Values]:
    candidates = effect.grid(scan.readings, scan.state)
    step = max(1, len(candidates) // scan.settings.candidates)
    return [*candidates[::step], candidates[-1]]


def _typical(effect: Effect, scan: ExampleScan, sign: float = 1.0) -> dict[str, float]:
    """Typical values, of the given sign if there is room for it; shapes from mid-grid."""
    candidates = effect.grid(scan.readings, scan.state)
    values = dict(candidates[len(candidates) // 2])
    for p in effect.bounded(scan.readings, scan.state):
        if p.null is not None:
            size = p.null + sign * p.typical
            values[p.name] = float(np.clip(size, p.lower, p.upper))
            if values[p.name] == p.null:  # no room on this side
                values[p.name] = float(np.clip(p.null - sign * p.typical, p.lower, p.upper))
    return values


def _corners(effect: Effect, scan: ExampleScan) -> Iterator[dict[str, float]]:
    """Typical values and bounds of every amplitude, with shapes at their bounds and on the grid."""
    bounded = effect.bounded(scan.readings, scan.state)
    ends = [{p.name: getattr(p, end) for p in bounded if p.null is None} for end in _ENDS]
    for shape in [*_shapes(effect, scan), *ends]:
        for sign in (-1.0, 1.0):
            yield {**_typical(effect, scan, sign), **shape}
        for p in bounded:
            if p.null is not None:
                for end in _ENDS:
                    yield {**effect.null, **shape, p.name: getattr(p, end)}


def _pattern(effect: Effect, case: ExampleScan, shape: Values) -> np.ndarray:
    """Orthonormal columns: change by small amplitudes, less the part of one softer body."""
    null, plain = {**shape, **effect.null}, case.plain(effect)
    columns = [
        case.out(effect, {**null, p.name: null[p.name] + 1e-3 * p.typical}) - case.out(effect, null)
        for p in effect.bounded(case.readings, case.state)
        if p.null is not None
    ]
    softer = plain / np.linalg.norm(plain)
    left = [c - softer * (softer @ c) for c in columns]
    return np.linalg.qr(np.column_stack(left))[0]


def _likeness(both: np.ndarray) -> np.ndarray:
    """Smallest cosine between spans whose directions have the products `both` (..., r, r)."""
    if both.shape[-1] != 2:
        return np.linalg.svd(both, compute_uv=False).min(axis=-1)
    half = 0.5 * np.sum(both**2, axis=(-2, -1))  # in closed form: a grid has millions of pairs
    det = both[..., 0, 0] * both[..., 1, 1] - both[..., 0, 1] * both[..., 1, 0]
    return np.sqrt(np.maximum(half - np.sqrt(np.maximum(half**2 - det**2, 0.0)), 0.0))


def _best_neighbours(patterns: np.ndarray) -> np.ndarray:
    """Likeness of each pattern (g, m, r) to the one most like it, (g,)."""
    count, _, rank = patterns.shape
    rows = np.concatenate(patterns.swapaxes(1, 2))
    best = np.empty(count)
    for start in range(0, count, _TOGETHER):
        some = np.arange(start, min(start + _TOGETHER, count))
        both = rows[rank * some[0] : rank * (some[-1] + 1)] @ rows.T
        both = both.reshape(len(some), rank, count, rank).swapaxes(1, 2)
        alike = np.abs(both[..., 0, 0]) if rank == 1 else _likeness(both)
        alike[some - start, some] = 0.0
        best[some] = alike.max(axis=1)
    return best


def _say(values: Values) -> str:
    return ", ".join(f"{name} {value:.3g}" for name, value in values.items())
