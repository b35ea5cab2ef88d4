"""Numbers as a reader sees them: kPa for Pa, mm for m, mN for N; a value, its error, its interval.

The sentences of `identify` write their own lengths and forces (`identify.effects.units`,
`identify.residual.statement`); palpmap takes these from here.
"""

import numpy as np

from identify.effects import percent
from identify.residual import length as length_in_words

_SHOWN = {
    "Pa": (1e-3, "kPa"), "m": (1e3, "mm"), "N": (1e3, "mN"), "m/N": (1e3, "mm/N"),
    "m/Pa": (1e6, "mm/kPa"), "1": (1.0, ""), "": (1.0, ""),
}  # fmt: skip
_OF_MAP = ("background", "inclusion_", "mean_")
_ENDINGS = {"_pa": "Pa", "_m": "m"}
_LEAST_P = 1e-12
_WIDTH_95 = 2 * 1.96  # standard errors
_MOST_PLACES = 8


def scale(unit: str) -> tuple[float, str]:
    """Return the factor to the unit that is shown, and that unit.

    >>> scale("Pa"), scale("N/s")
    ((0.001, 'kPa'), (1.0, 'N/s'))
    """
    return _SHOWN.get(unit, (1.0, unit))


def unit_of(name: str) -> str:
    """Return the unit of a map's parameter, which its name ends with.

    >>> unit_of("inclusion_1.weight_pa"), unit_of("viscoelasticity.g")
    ('Pa', '1')
    """
    return next((unit for ending, unit in _ENDINGS.items() if name.endswith(ending)), "1")


def is_of_map(name: str) -> bool:
    """Return True for a parameter of a map, False for one of an effect.

    >>> is_of_map("inclusion_2.radius_m"), is_of_map("skin_layer.share")
    (True, False)
    """
    return name.startswith(_OF_MAP)


def plain_name(name: str) -> str:
    """Return a map's parameter in words; an effect's keeps the name that a study file gives it.

    >>> plain_name("inclusion_2.radius_m"), plain_name("background_pa"), plain_name("skin.share")
    ('inclusion 2 radius', 'background', 'skin.share')
    >>> plain_name("unknown_session_share.c1")
    'unknown_session_share, amplitude 1'
    """
    if name.startswith("unknown_"):
        return name.replace(".c", ", amplitude ")
    if not is_of_map(name):
        return name
    return name.removesuffix("_pa").removesuffix("_m").replace("_", " ").replace(".", " ")


def quantity(value: float, unit: str, std: float = 0.0) -> str:
    """Return a value with its unit: four digits, a length two decimals of a mm.

    With a standard error it has the digits that this leaves (rule of the Particle Data Group).

    >>> quantity(6012.3, "Pa"), quantity(0.0123, "m"), quantity(1.234e-4, "m"), quantity(0.67, "1")
    ('6.012 kPa', '12.30 mm', '0.123 mm', '0.67')
    >>> quantity(6000.0, "Pa", 17.0), quantity(31350.0, "Pa", 2700.0), quantity(9e5, "Pa", 2.4e5)
    ('6.000 kPa', '31.4 kPa', '900 kPa')
    """
    return _with_unit(_digits(value, unit, std), unit)


def with_error(value: float, std: float, unit: str) -> str:
    """Return a value with its standard error, alone where that is zero.

    >>> with_error(6012.3, 123.0, "Pa"), with_error(9e5, 2.43e5, "Pa"), with_error(0.02, 0.0, "m")
    ('6.01 ± 0.12 kPa', '900 ± 243 kPa', '20.00 mm')
    >>> with_error(0.6712, 0.077, "1")
    '0.67 ± 0.08'
    """
    if not std > 0:
        return quantity(value, unit)
    return _with_unit(f"{_digits(value, unit, std)} ± {_digits(std, unit, std)}", unit)


def interval(low: float, high: float, unit: str) -> str:
    """Return a 95 % interval, with the digits of its standard error.

    >>> interval(4960.0, 5080.0, "Pa"), interval(-1e-18, 0.02, "m")
    ('4.960 to 5.080 kPa', '0 to 20 mm')
    """
    std = (high - low) / _WIDTH_95
    return _with_unit(f"{_digits(low, unit, std)} to {_digits(high, unit, std)}", unit)


def spread(value: float, unit: str) -> str:
    """Return a size that goes to both sides.

    >>> spread(321.0, "Pa"), spread(243e3, "Pa")
    ('± 0.32 kPa', '± 243 kPa')
    """
    return _with_unit(f"± {_two_digits(value, unit)}", unit)


def shift(value: float, unit: str) -> str:
    """Return a change in the shown unit, without its name: two digits, or more before the point.

    >>> shift(-154e3, "Pa"), shift(1.234e-3, "m"), shift(1e-6, "m")
    ('-154', '+1.2', '0')
    """
    return "0" if abs(scale(unit)[0] * value) < 0.005 else _two_digits(value, unit, "+")


def rms(metres: float) -> str:
    """Return the size of a residual, in µm or mm.

    >>> rms(3.82e-5), rms(1.23e-3)
    ('38 µm', '1.23 mm')
    """
    return length_in_words(metres, signed=False)


def shared_errors(touch_m: float | None, lag_s: float | None) -> str:
    """Return the standard deviations of first touch and lag, as far as they are stated.

    >>> shared_errors(7.8e-5, 2.4e-3), shared_errors(0.0, None)
    (', depth of first touch 78 µm, lag between force and pose 2.4 ms', '')
    """
    touch = f", depth of first touch {rms(touch_m)}" if touch_m else ""
    return touch + (f", lag between force and pose {1e3 * lag_s:.2g} ms" if lag_s else "")


def p_value(p: float) -> str:
    """Return a p-value with two digits.

    >>> p_value(0.0123), p_value(1e-20)
    ('0.012', '< 1e-12')
    """
    return f"< {_LEAST_P:g}" if p < _LEAST_P else f"{p:.2g}"


def duration(seconds: float) -> str:
    """Return a duration in minutes, below 90 s in seconds.

    >>> duration(90.0), duration(41.4)
    ('1.5 min', '41 s')
    """
    return f"{seconds / 60:.2g} min" if seconds >= 90 else f"{seconds:.0f} s"


def _digits(value: float, unit: str, std: float = 0.0) -> str:
    shown = scale(unit)[0] * value
    if 0 < std < np.inf:
        error = scale(unit)[0] * std
        power = int(np.floor(np.log10(error)))
        places = (error < 3.55 * 10.0**power) - power  # two digits of a small one, else one
        return f"{shown:z.{min(max(places, 0), _MOST_PLACES)}f}"
    if unit == "m":
        return f"{shown:.2f}" if abs(shown) >= 1 else f"{shown:.3g}"
    text = f"{shown:.4g}"
    return f"{float(text):.0f}" if "e+" in text else text


def _two_digits(value: float, unit: str, sign: str = "") -> str:
    """Return two digits in the shown unit, or more before the point."""
    shown = scale(unit)[0] * value
    return f"{shown:{sign}.0f}" if abs(shown) >= 10 else f"{shown:{sign}.2g}"


def _with_unit(text: str, unit: str) -> str:
    return f"{text} {scale(unit)[1]}".rstrip()


__all__ = [
    "duration", "interval", "p_value", "percent", "plain_name", "quantity", "rms", "scale",
    "shared_errors", "shift", "spread", "unit_of", "with_error",
]  # fmt: skip
