"""The start of an effect of one's own, where no effect of the catalogue explains a residual."""

from dataclasses import dataclass
from pathlib import Path
from string import Template

from identify.residual import Comparison
from models import replaced

OWN_EFFECT = "own_effect.py"


@dataclass(frozen=True)
class _Pattern:
    """A pattern of the reading: its words, code, and an example that can be followed by hand."""

    along: str
    parameter: str
    unit: str
    size: float
    code: str
    needs: str
    says: str
    value: float
    inputs: str
    expected: str


_SPEED = """speed = np.zeros(len(readings))
        for press in range(readings.presses):
            rows = readings.press == press
            speed[rows] = np.gradient(travel_m[rows], readings.timed_s[rows])
        pattern = speed"""
_SIGN = 'pattern = 1.0 * (readings.phase == "load") - (readings.phase == "unload")'
_WITHIN = "pattern = readings.timed_s - readings.timed_s[readings.first][readings.press]"
_SLOPE = "pattern = readings.point_m[:, 0] - readings.point_m[:, 0].mean()"

PATTERNS = {
    "speed": _Pattern(
        "the speed of the tip", "lag_s", "s", 0.01, _SPEED, '"time",',
        "0.1 s at a speed of 1 mm/s: 0.1 mm.", 0.1,
        '"time_s": (0.0, 1.0), "travel_m": (1e-3, 2e-3)', "(1.1e-3, 2.1e-3)",
    ),
    "direction": _Pattern(
        "the direction of the tip", "offset_m", "m", 1e-4, _SIGN, '"unloading",',
        "0.1 mm, added on the way down, taken off on the way up.", 1e-4,
        '"phase": ("load", "unload"), "travel_m": 1e-3', "(1.1e-3, 0.9e-3)",
    ),
    "time": _Pattern(
        "the time within a press", "rate_m_per_s", "m/s", 1e-4, _WITHIN, '"time",',
        "0.1 mm/s: 0.1 mm after 1 s.", 1e-4,
        '"time_s": (0.0, 1.0), "travel_m": 1e-3', "(1e-3, 1.1e-3)",
    ),
    "force": _Pattern(
        "the square of the force", "travel_m_per_n2", "m/N2", 1e-3, "pattern = force_n**2",
        '"several forces",', "1 mm/N2 at 0.1 N and 0.2 N: 0.01 mm and 0.04 mm.", 1e-3,
        '"force_n": (0.1, 0.2), "travel_m": 1e-3', "(1.01e-3, 1.04e-3)",
    ),
    "order": _Pattern(
        "the order of pressing", "step_m", "m", 1e-5, "pattern = readings.order[readings.press]",
        '"several presses",', "0.1 mm a press: none at the first, 0.1 mm at the second.", 1e-4,
        '"press": (0.0, 1.0), "travel_m": 1e-3', "(1e-3, 1.1e-3)",
    ),
    "place": _Pattern(
        "the place along x", "slope", "1", 1e-3, _SLOPE, '"several presses",',
        "1 %, places 0.02 m apart: 0.01 m from their mean, 0.1 mm.", 0.01,
        '"press": (0.0, 1.0), "point_m": ((0.0, 0.0, 0.0), (0.02, 0.0, 0.0)), "travel_m": 1e-3',
        "(0.9e-3, 1.1e-3)",
    ),
}  # fmt: skip
_LIKE = {
    "share_of_travel": "direction",
    "phase": "direction",
    "session": "order",
    "press": "place",
}

_FILE = Template('''"""An effect of my own: replace the pattern and all words by yours."""

import numpy as np

from palpmap import Effect, EffectParameter, WorkedExample


class OwnEffect(Effect):
    name, title = "own_effect", "An effect of my own"
    summary = "The displacement changes with $along. Say here what happens, and when."
    formula = "d = u + $parameter x pattern,  pattern: $along"
    source = "my own observation"
    gives_away = "the residual follows $along"
    cure = "Say here how an experiment avoids it."
    parameters = (
        EffectParameter("$parameter", "$unit", "size", 0.0, $low, $high, $size),
    )
    needs = ($needs)
    examples = (
        WorkedExample(
            "$says",
            {"$parameter": $value},
            {$inputs},
            {"displacement_m": $expected},
        ),
    )

    def reading(self, readings, force_n, travel_m, *, $parameter):
        $code
        return travel_m + $parameter * np.asarray(pattern)
''')


def pattern_of(residual: Comparison) -> str:
    """Return the name of the pattern nearest to the main direction of a residual."""
    name = residual.law.name if residual.law else residual.varies_with or "force"
    return name if name in PATTERNS else _LIKE.get(name, "force")


def write_own_effect(pattern: str, path: Path) -> None:
    """Write an effect file with a pattern of `pattern_of`; a file that is there stays."""
    if path.exists():
        return
    known = PATTERNS[pattern]
    bound = 1000 * known.size
    text = _FILE.substitute(vars(known), low=-bound, high=bound)
    with replaced(path) as beside:
        beside.write_text(text, encoding="utf-8")
