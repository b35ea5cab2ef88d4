"""Check of the patterns that an effect gives for many shapes at once (`Advice.columns`)."""

import numpy as np

from identify.effects.base import Effect, advice
from identify.effects.conformance.checks import Fault
from identify.effects.conformance.example_scan import ExampleScan

_ACCURACY = 1e-6  # of the largest derivative: an effect that adds to the travel is linear


def columns(effect: Effect, case: ExampleScan) -> str:
    """Compare the columns with the hook's own change of the readings."""
    shapes = effect.grid(case.readings, case.state)
    shapes = [shapes[i] for i in np.unique(np.linspace(0, len(shapes) - 1, 7).round().astype(int))]
    given = advice(effect).columns(case.readings, shapes)
    if given is None:
        return "one shape at a time"
    wanted = (len(shapes), len(case.readings.press), len(effect.amplitudes))
    if np.shape(given) != wanted:
        raise Fault(f"columns() returns shape {np.shape(given)}, expected {wanted}")
    for shape, found in zip(shapes, given, strict=True):
        still = case.out(effect, {**effect.null, **shape})
        for amplitude, column in zip(effect.amplitudes, found.T, strict=True):
            size = effect.null[amplitude.name] + amplitude.typical
            moved = {**effect.null, **shape, amplitude.name: size}
            change = (case.out(effect, moved) - still) / amplitude.typical
            if not np.abs(change - column).max() <= _ACCURACY * np.abs(column).max():
                raise Fault(f"columns() is not what {amplitude.name} changes at {shape}")
    return f"{len(shapes)} shapes as the hook has them"
