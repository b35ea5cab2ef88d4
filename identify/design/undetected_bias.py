"""Bias of the estimates by an undetected effect.

An interval does not contain this bias: it is that of the noise, under the present model. Per
parameter, over the effects of a catalogue beyond those of the model,

    max |bias|,    of the effect at its detection limit (or at its largest possible size, if even
                   that is not seen), or at 3 % of the signal if that is less,

for one effect at a time. Below the limit the bias is to first order; at the limit the map is fitted
if the bias is large (see `identify.design.detection_limits`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from identify.design.detection_limits import Limit
from identify.design.settings import DETECTION, DetectionSettings


@dataclass(frozen=True)
class UndetectedBias:
    """The largest shift of one parameter by an undetected effect.

    Attributes
    ----------
    shift : in the parameter's unit, not negative
    effect : its cause
    share : its size, rms over the signal's
    """

    shift: float
    effect: str
    share: float


def undetected_biases(
    limits: Sequence[Limit], settings: DetectionSettings = DETECTION
) -> Mapping[str, UndetectedBias]:
    """Return the largest shift of each parameter, by name; empty if no effect has a limit.

    Parameters
    ----------
    limits : of effects beyond those of the fitted model
    """
    found: dict[str, UndetectedBias] = {}
    for limit in limits:
        unseen_up_to = limit.smallest_share or limit.largest_share
        if unseen_up_to is None:
            continue
        share = min(unseen_up_to, settings.bias_share)
        for name, bias in limit.map_bias.items():
            shift = abs(bias) * share / settings.bias_share
            if name not in found or shift > found[name].shift:
                found[name] = UndetectedBias(shift, limit.name, share)
    return found
