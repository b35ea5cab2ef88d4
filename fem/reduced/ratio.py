"""Compliances of other models over those of one, in bases of solutions for the same bodies.

A model of another Poisson's ratio, or of the body elsewhere, answers a change of the modulus almost
as the first does: in bases of solutions for the same bodies, both compliances are off by nearly the
same, and most of it cancels in their ratio. With the bounds of both (`fem.reduced.model`),

    ln(C'/C) = ln(C'_low C'_high / (C_low C_high)) / 2 + e,

where e is about the part of ln(C_high/C_low) by which the compliances differ, ln(C'/C), or the
difference of both models' gaps between their bounds, if that is larger, as it is where solutions
too much alike leave little more than rounding: a twentieth of the error of one compliance alone, or
less (`benchmarks/reduced.py`).
"""

from __future__ import annotations

from collections.abc import Callable, Hashable

import numpy as np

from fem.palpation.model import PalpationModel, Response
from fem.reduced.model import Body, ReducedModel
from fem.reduced.response import ReducedResponse

_OFF = 2.0  # times the estimate: errors for another Poisson's ratio reach 2.4 times
# Solutions of the first model, and of each other one; other models, the last ones asked for
_KEPT = (6, 3, 6)
_OF_FIBRES = (3, 2, 4)  # whose strains are kept, and summed nine times


class ReducedRatio:
    """Ratios of compliances near bodies that both models have solved.

    Parameters
    ----------
    own : the model that the others are compared with
    fibres : see `ReducedModel`
    """

    def __init__(self, own: PalpationModel, *, fibres: bool = False) -> None:
        most, self._most, self._models = _OF_FIBRES if fibres else _KEPT
        self._own = ReducedModel(own, most, fibres=fibres)
        self._others: dict[Hashable, ReducedModel] = {}
        self._bodies: dict[Hashable, int] = {}  # numbers of the solutions
        self._latest: tuple[Hashable, ReducedResponse | None] = (None, None)

    def log_at(
        self,
        name: Hashable,
        key: Hashable,
        body: Callable[[PalpationModel], Body],
        tolerance: float,
    ) -> np.ndarray | None:
        """Logarithm (j,) of the ratio, or None where its error exceeds the tolerance.

        Parameters
        ----------
        name : of the other model
        key : of the body, by which it is known again
        body : returns it for a model
        """
        found = self.estimated(name, key, body)
        return found[0] if found is not None and found[1] <= tolerance else None

    def estimated(
        self, name: Hashable, key: Hashable, body: Callable[[PalpationModel], Body]
    ) -> tuple[np.ndarray, float] | None:
        """Logarithm (j,) of the ratio, and about its largest error; None without a solution.

        Parameters as of `log_at`. Far from all solutions neither need be a number.
        """
        model = self._others.get(name)
        if model is None:
            return None
        numbers = tuple(sorted(model.numbers & self._own.numbers))
        if not numbers:
            return None
        if self._latest[0] != (key, numbers):
            found = self._own.evaluate(body(self._own.full), among=numbers, rests=True)
            self._latest = (key, numbers), found
        here = self._latest[1]
        there = model.evaluate(body(model.full), among=numbers, rests=True)
        if here is None or there is None:
            return None
        with np.errstate(all="ignore"):  # far from all solutions a bound may be negative
            gaps = [np.log(one.high / one.compliance) for one in (here, there)]
            log = np.log(there.compliance / here.compliance) + (gaps[1] - gaps[0]) / 2
        error = _OFF * np.maximum(np.abs(gaps[0] * log), np.abs(gaps[1] - gaps[0])).max()
        return log, float(error)

    def model(self, name: Hashable) -> PalpationModel | None:
        """Return the model of that name if it has solutions here, to save making one more."""
        known = self._others.get(name)
        return None if known is None else known.full

    def add(self, name: Hashable, key: Hashable, own: Response, other: Response) -> None:
        """Take solutions of both models for a body."""
        number = self._bodies.get(key)
        if number not in self._own.numbers:
            number = self._own.add(own)
        model = self._others.pop(name, None) or ReducedModel(
            other.model, self._most, fibres=self._own.fibres
        )
        self._others[name] = model  # the last one asked for
        while len(self._others) > self._models:
            del self._others[next(iter(self._others))]
        if number is not None and number not in model.numbers:
            self._bodies = {k: n for k, n in self._bodies.items() if n in self._own.numbers}
            self._bodies[key] = number
            for old in model.numbers - self._own.numbers:
                model.drop(old)
            model.add(other, number)
