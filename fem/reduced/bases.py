"""Reduced bases of a search: the last ones that served, each around its own solutions."""

from __future__ import annotations

import numpy as np

from fem.palpation.model import PalpationModel, Response
from fem.reduced.model import MOST, MOST_OF_FIBRES, Body, ReducedModel
from fem.reduced.response import ReducedResponse
from fem.reduced.snapshot import law_of, modulus_samples

FAR = 3e-3  # relative bound beyond which a solution begins a basis of its own
FAR_LAW = 0.3  # ... beside springs or a skin, whose bounds are wide before their second solution
_BASES = 3  # the last ones that served
_BYTES = 64e6  # of a basis's energies


class ReducedBases:
    """Reduced models of one palpation model around the maps of a search, grown as it goes.

    A solution joins the basis that came nearest to it, or begins one of its own. Springs, skins and
    fibres have bases of their own.

    Parameters
    ----------
    full : the model
    bases, most_bytes : largest number of bases, and memory of the energies of one
    """

    def __init__(
        self, full: PalpationModel, bases: int = _BASES, most_bytes: float = _BYTES
    ) -> None:
        self.full, self._kept = full, bases
        by_pair = 4.0 * len(full.contacts) * len(full.points_m)
        self._most = min(int((np.sqrt(1 + 8 * most_bytes / by_pair) - 1) / 2), MOST)
        self._bases: list[tuple[tuple[bool, ...], ReducedModel]] = []  # the last that served last
        self._nearest: tuple[float, ReducedModel] | None = None

    def evaluate(self, body: Body, tolerance: float) -> ReducedResponse | None:
        """Return the compliances for a body as `PalpationModel.evaluate` does, or None.

        Parameters
        ----------
        tolerance : of the bound of their relative error
        """
        self._nearest = None
        material = self.full.material(body.modulus_pa, body.fibres, body.skin)
        kind = law_of(material, self.full.held(material, body.support_compliance)[1]).kind
        for entry in reversed(self._bases):
            if entry[0] != kind:
                continue
            basis = entry[1]
            response = basis.evaluate(body)
            if response is None:
                return None
            if response.error <= tolerance:
                self._bases.remove(entry)
                self._bases.append(entry)
                basis.served = True
                return response
            if self._nearest is None or response.error < self._nearest[0]:
                self._nearest = response.error, basis
        return None

    def add(self, response: Response, plain: Response | None = None) -> None:
        """Take the full solution for the body that was evaluated last.

        `plain` : that without springs, skin and fibres at this modulus, which joins a new basis; of
        a body without them it may be the same one
        """
        material = response._material
        law = law_of(material, response._springs)
        if self._most < 2 or modulus_samples(material) is None or not law.is_reducible:
            return
        kind = law.kind
        far = FAR_LAW if any(kind) else FAR
        if self._nearest is not None and self._nearest[0] <= far:
            self._nearest[1].add(response)
            return
        own = [entry for entry in self._bases if entry[0] == kind]
        if len(own) == (1 if any(kind) else self._kept):
            idle = [entry for entry in own if not entry[1].served]
            self._bases.remove((idle or own)[0])
        most = min(self._most, MOST_OF_FIBRES) if law.share else self._most
        basis = ReducedModel(self.full, most, fibres=bool(law.share))
        if plain is not None and plain is not response:
            basis.add(plain)
        basis.add(response)
        if len(basis):  # a body without least energy begins none
            self._bases.append((kind, basis))
