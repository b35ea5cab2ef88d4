"""Check of a free form: it contains the effects that it says are special cases of it."""

from collections.abc import Iterator, Mapping

import numpy as np

from identify.catalogue.catalogue import CATALOGUE
from identify.effects.base import Effect, EffectParameter, Values
from identify.effects.conformance.checks import Fault
from identify.effects.conformance.example_scan import ExampleScan

_ALIKE = 0.98  # cosine between a special case and its nearest copy by the free form


def contains_its_special_cases(effect: Effect, case: ExampleScan) -> str:
    """Rebuild each built-in effect of `contains` by the free form, for `check_effect`.

    Raises
    ------
    Fault
        The free form cannot take the shape of a special case.
    """
    built_in = {one.name: one for one in CATALOGUE}
    relative = built_in.get(effect.family)
    if relative is not None and relative.link != effect.link:
        raise Fault(
            f"family '{effect.family}' acts on the {relative.link}, the effect on the "
            f"{effect.link}: they are different causes"
        )
    known = [built_in[name] for name in effect.contains if name in built_in]
    found = []
    for simple in known:
        shapes = simple.grid(case.readings, case.state)
        best = _cosine(effect, case, _columns(simple, case, shapes[len(shapes) // 2])[:, 0])
        if best < _ALIKE:
            raise Fault(
                f"contains '{simple.name}', but its nearest pattern has a cosine of {best:.3f} with"
                " it; leave it out of `contains`, or widen bounds and grid"
            )
        found.append(f"{simple.name} {best:.4f}")
    return f"cosines: {', '.join(found)}" if found else "contains no built-in effect"


def _cosine(effect: Effect, case: ExampleScan, wanted: np.ndarray) -> float:
    """Cosine between a pattern (m,) and the span of the effect's, the best of its shapes."""
    wanted = wanted / np.linalg.norm(wanted)
    best, nearest = 0.0, {}
    for shape in effect.grid(case.readings, case.state):
        if (cosine := _along(wanted, _columns(effect, case, shape))) > best:
            best, nearest = cosine, shape
    parameters = {p.name: p for p in effect.bounded(case.readings, case.state)}
    for shape in _towards_bounds(nearest, parameters):
        best = max(best, _along(wanted, _columns(effect, case, shape)))
    return best


def _towards_bounds(shape: Values, parameters: Mapping[str, EffectParameter]) -> Iterator[Values]:
    """Yield the shape with each of its parameters on either bound."""
    for name in shape:
        for end in (parameters[name].lower, parameters[name].upper):
            yield {**shape, name: end}


def _columns(effect: Effect, case: ExampleScan, shape: Values) -> np.ndarray:
    null = effect.null
    plain = case.out(effect, {**null, **shape})
    columns = []
    for p in effect.bounded(case.readings, case.state):
        if p.null is None:
            continue
        step = 1e-3 * p.typical * (1 if p.null < p.upper else -1)
        columns.append((case.out(effect, {**null, **shape, p.name: p.null + step}) - plain) / step)
    return np.column_stack(columns)


def _along(wanted: np.ndarray, columns: np.ndarray) -> float:
    basis, size, _ = np.linalg.svd(columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300),
                                   full_matrices=False)  # fmt: skip
    return float(np.linalg.norm(basis[:, size > 1e-9].T @ wanted))
