"""Patterns of an effect in the readings: the change by its amplitudes, at each shape.

At the null, beside the effects of the model and without refitting; of a body effect also at the
levels that its advice names.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from identify.effects.base import Effect, EffectParameter, advice, changes_body
from identify.measurement.linearised import Linearised
from identify.measurement.model import MeasurementModel
from identify.measurement.traced_chain import TracedChain

_STEP = 1e-4  # of an amplitude's typical size, for its derivative
_SLACK = 10.0  # of the patterns at an effect's levels, which change compliances by a tenth


@dataclass(frozen=True)
class EffectPattern:
    """Change of the whitened readings by an effect, per unit of its amplitudes.

    Attributes
    ----------
    effect : its effect
    shapes : g candidates of the shape parameters
    columns : (g, m, q) derivative by each amplitude in units of its typical size
    change_m : (g, m, q) the same of the readings as they are, m: whitened, a free map hides part
    """

    effect: Effect
    shapes: Sequence[Mapping[str, float]]
    columns: np.ndarray
    change_m: np.ndarray


def effect_patterns(
    model: MeasurementModel, at: Linearised, effect: Effect, most: int | None = None
) -> EffectPattern:
    """Return the patterns of an effect at its null, beside the effects of the model.

    `most` limits the number of its shape's candidates, evenly over the grid.
    """
    shapes = effect.grid(model.readings, at.state)
    if most is not None and len(shapes) > most:
        shapes = [shapes[i] for i in np.linspace(0, len(shapes) - 1, most).round().astype(int)]
    blocks = list(pattern_blocks(model, at, effect, shapes, np.inf))
    if not blocks:
        none = np.empty((0, len(at.residual), len(effect.amplitudes)))
        return EffectPattern(effect, [], none, none)
    columns = np.concatenate([block.columns for block in blocks])
    change_m = np.concatenate([block.change_m for block in blocks])
    shapes = [shape for block in blocks for shape in block.shapes]
    return EffectPattern(effect, shapes, columns, change_m)


def pattern_blocks(
    model: MeasurementModel,
    at: Linearised,
    effect: Effect,
    shapes: Sequence[Mapping[str, float]],
    most_bytes: float,
) -> Iterator[EffectPattern]:
    """Yield the patterns of candidates of the shape, in blocks of so much memory at most.

    Those at the levels of a body effect come last.
    """
    parameters = {p.name: p for p in effect.bounded(model.readings, at.state)}
    amplitudes = [parameters[p.name] for p in effect.amplitudes]
    null, m = effect.null, len(at.residual)
    traced = None
    if shapes and not changes_body(effect):
        chain = replace(model.chain, effects=[*model.chain.effects, effect])
        absent = {**at.values, effect.name: {**null, **shapes[0]}}
        traced = TracedChain(chain, at.point._replace(values=absent))

    def moved_by(shape: Mapping[str, float], amplitude: EffectParameter) -> np.ndarray:
        step = _STEP if null[amplitude.name] < amplitude.upper else -_STEP
        size = null[amplitude.name] + step * amplitude.typical
        values = {**null, **shape, amplitude.name: size}
        if changes_body(effect):
            dc, de = at.body.change(effect.body(at.state, **values))
            return model.moved_by_body(at, dc, de) / step
        assert traced is not None
        return (traced.with_values(effect.name, values) - traced.predicted_m) / step

    count = int(max(min(most_bytes / (8 * m * len(amplitudes)), len(shapes)), 1))
    for begin in range(0, len(shapes), count):
        part = shapes[begin : begin + count]
        columns = None
        if traced is not None and traced.ends_with(effect.name):
            columns = advice(effect).columns(model.readings, part)
        if columns is not None:
            moved = (columns * [a.typical for a in amplitudes]).swapaxes(1, 2)
        else:
            moved = np.array([[moved_by(shape, a) for a in amplitudes] for shape in part])
        flat = moved.reshape(-1, m)
        rows = at.whitened(flat.T, model.readings.press).T.reshape(moved.shape).swapaxes(1, 2)
        yield EffectPattern(effect, part, rows, moved.swapaxes(1, 2))
    far = _far_patterns(model, at, effect, amplitudes[0], shapes)
    if far:
        moved = np.array([moved for _, moved in far]).T
        rows = at.whitened(moved, model.readings.press).T[:, :, None]
        yield EffectPattern(effect, [s for s, _ in far], rows, moved.T[:, :, None])


def _far_patterns(
    model: MeasurementModel,
    at: Linearised,
    effect: Effect,
    amplitude: EffectParameter,
    shapes: Sequence[Mapping[str, float]],
) -> list[tuple[Mapping[str, float], np.ndarray]]:
    """Return shapes and changes (m,) m of a body effect at its levels, see `Advice`."""
    null, found = effect.null, []
    if not changes_body(effect):
        return found
    for level in advice(effect).levels(at.state):
        for shape in shapes:
            state = effect.body(at.state, **{**null, **shape, amplitude.name: level})
            dc, de = at.body.exact_change(state, _SLACK)
            moved = model.moved_by_body(at, dc, de)
            size = (level - null[amplitude.name]) / amplitude.typical
            found.append((shape, moved / size))
    return found
