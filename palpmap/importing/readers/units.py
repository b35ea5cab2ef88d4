"""Units as headers state them, and their factors to SI."""

from __future__ import annotations

import re

import numpy as np

from models import InputError

FORCE = {
    "N": 1.0, "mN": 1e-3, "uN": 1e-6, "kN": 1e3, "g": 9.80665e-3, "gf": 9.80665e-3,
    "kg": 9.80665, "kgf": 9.80665, "kp": 9.80665, "lbf": 4.4482216152605, "lb": 4.4482216152605,
    "ozf": 0.27801385095378,
}  # fmt: skip
LENGTH = {"m": 1.0, "dm": 0.1, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "nm": 1e-9, "in": 0.0254}
TIME = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0}
ANGLE = {"rad": 1.0, "deg": np.pi / 180.0}
DIMENSIONS = {"force": FORCE, "length": LENGTH, "time": TIME, "angle": ANGLE}
NO_UNIT = ("-", "1", "")

_OTHER_SPELLINGS = {
    "newton": "N", "newtons": "N", "n": "N", "millinewton": "mN", "mn": "mN", "kn": "kN",
    "gram": "g", "grams": "g", "gramm": "g", "meter": "m", "meters": "m", "metre": "m",
    "metres": "m", "millimeter": "mm", "millimeters": "mm", "millimetre": "mm",
    "millimetres": "mm", "micron": "um", "microns": "um", "inch": "in", "sec": "s",
    "secs": "s", "second": "s", "seconds": "s", "sek": "s", "msec": "ms", "millisecond": "ms",
    "milliseconds": "ms", "usec": "us", "microseconds": "us", "nsec": "ns", "nanosec": "ns",
    "nanoseconds": "ns", "degree": "deg", "degrees": "deg", "grad": "deg", "radian": "rad",
    "radians": "rad",
}  # fmt: skip
_KNOWN = {name for units in DIMENSIONS.values() for name in units}
_IN_HEADER = (
    re.compile(r"^(?P<name>.+?)\s*[\[({<]\s*(?P<unit>[^\])}>]*)\s*[\])}>]\s*$"),
    re.compile(r"^(?P<name>.+?)\s*/\s*(?P<unit>[^\s/]+)$"),
    re.compile(r"^(?P<name>.+?)(?:\s*,\s*|\s+in\s+|\s+)(?P<unit>[^\s,]+)$"),
    re.compile(r"^(?P<name>.+)_(?P<unit>[^\W_]+)$"),
)

_UNKNOWN_IN_HEADER = re.compile(r"[\[({<]\s*([^\W\d]{2,}|V)\s*[\])}>]$|\s/\s([^\W\d]+)$|_(m?V)$")
"""In brackets, behind a slash, or volts: one letter in brackets is an axis."""


def spelled(text: str) -> str | None:
    """Return a unit's usual name, None where the text is no known unit.

    >>> spelled("Newton"), spelled("µm"), spelled("°"), spelled("volts")
    ('N', 'um', 'deg', None)
    """
    text = text.strip().replace("µ", "u").replace("μ", "u").replace("°", "deg")
    text = _OTHER_SPELLINGS.get(text.lower(), text) if text not in _KNOWN else text
    return text if text in _KNOWN else None


def name_and_unit(header: str) -> tuple[str, str]:
    """Split a header into name and unit; "" where it states none.

    >>> name_and_unit("Fz [mN]"), name_and_unit("time_ms"), name_and_unit("Weg in mm")
    (('Fz', 'mN'), ('time', 'ms'), ('Weg', 'mm'))
    >>> name_and_unit("t/s"), name_and_unit("press"), name_and_unit("pos_x")
    (('t', 's'), ('press', ''), ('pos_x', ''))
    """
    for form in _IN_HEADER:
        if match := form.match(header.strip()):
            unit = spelled(match["unit"])
            if unit is not None:
                return match["name"].strip(), unit
    return header.strip(), ""


def unknown_unit(header: str) -> str:
    """Return the unit that a header states, where it is none of the known ones, else "".

    >>> unknown_unit("Travel[mil]"), unknown_unit("force_V"), unknown_unit("Fz [N]")
    ('mil', 'V', '')
    >>> unknown_unit("pos[0]"), unknown_unit("force (x)"), unknown_unit("force_raw")
    ('', '', '')
    """
    match = _UNKNOWN_IN_HEADER.search(header.strip())
    unit = next(filter(None, match.groups())) if match else ""
    return "" if spelled(unit) else unit


def factor(unit: str, dimension: str, key: str) -> float:
    """Return the factor from a unit to SI.

    Raises
    ------
    InputError
        If the unit is unknown, or of another dimension.
    """
    name = spelled(unit)
    units = DIMENSIONS[dimension]
    if name not in units:
        raise InputError(
            f"key {key}: found the unit '{unit}', expected one of {', '.join(units)} for a "
            f"{dimension}"
        )
    return units[name]
