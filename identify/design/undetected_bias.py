"""How far an effect that a scan does not show may have moved the parameters found from it.

No interval counts this: an interval is of the noise, under the model as it stands. Per parameter,
over the effects of a catalogue that the model does not have,

    max |bias|,    of the effect at its detection limit (or at its largest possible size, where that
                   is not seen), or at 3 % of the signal if that is less,

for one effect at a time. Below the limit the bias is to first order, at it the map is fitted where
the effect takes it far (see `identify.design.detection_limits`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from identify.design.detection_limits import SHARE, Limit


@dataclass(frozen=True)
class UndetectedBias:
    """The largest shift of one parameter by an effect that the scan does not show.

    Attributes
    ----------
    shift : in the parameter's unit, not negative
    effect : which effect does that
    share : its size, rms over the signal's
    """

    shift: float
    effect: str
    share: float


def undetected_biases(limits: Sequence[Limit]) -> Mapping[str, UndetectedBias]:
    """Return the largest shift of each parameter, by name; none where no effect has a limit.

    Parameters
    ----------
    limits : of the effects that the fitted model does not have
    """
    found: dict[str, UndetectedBias] = {}
    for limit in limits:
        unseen_up_to = limit.smallest_share or limit.largest_share
        if unseen_up_to is None:
            continue
        share = min(unseen_up_to, SHARE)
        for name, bias in limit.map_bias.items():
            shift = abs(bias) * share / SHARE
            if name not in found or shift > found[name].shift:
                found[name] = UndetectedBias(shift, limit.name, share)
    return found
