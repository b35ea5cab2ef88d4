"""A measurement chain whose links are kept, so that one changed effect costs its own part only."""

import numpy as np

from identify.effects.base import Values
from identify.measurement.chain import Chain, OperatingPoint


class TracedChain:
    """A chain at one body and its forces, the output of each link kept.

    Another value of one effect then costs no more than the links from that effect on.
    """

    def __init__(self, chain: Chain, at: OperatingPoint) -> None:
        self._chain, self._at = chain, at
        force_n, values = at.force_n, at.values
        self._forces = [force_n]
        for effect in chain._forces:
            force_n = effect.force(chain.readings, force_n, **values[effect.name])
            self._forces.append(force_n)
        self._travels = [chain._from_touch(at._replace(force_n=force_n))]
        for name, hook in chain._later:
            travel = hook(chain.readings, force_n, self._travels[-1], **values[name])
            self._travels.append(travel)

    @property
    def predicted_m(self) -> np.ndarray:
        """Displacement (m,)."""
        return self._travels[-1]

    def ends_with(self, name: str) -> bool:
        """Return True if no link follows that of an effect."""
        return bool(self._chain._later) and self._chain._later[-1][0] == name

    def with_values(self, name: str, own: Values) -> np.ndarray:
        """Displacement (m,) with other values of one effect."""
        chain, values = self._chain, {**self._at.values, name: own}
        begun = next((i for i, (n, _) in enumerate(chain._later) if n == name), None)
        if begun is not None:
            force_n, travel = self._forces[-1], self._travels[begun]
        else:
            first = next((i for i, e in enumerate(chain._forces) if e.name == name), None)
            force_n = self._forces[-1 if first is None else first]
            for effect in [] if first is None else chain._forces[first:]:
                force_n = effect.force(chain.readings, force_n, **values[effect.name])
            travel = chain._from_touch(self._at._replace(force_n=force_n, values=values))
        for later, hook in chain._later[begun or 0 :]:
            travel = hook(chain.readings, force_n, travel, **values[later])
        return travel
