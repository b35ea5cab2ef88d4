"""The text beside the pictures: legend, and result so far."""

from collections.abc import Collection, Mapping

from palpmap import units
from palpmap.recording import entities as parts
from palpmap.report.draw import markdown
from palpmap.result.tables import Table, number

_SEEN = {
    "robot": (
        "**Scene**: the arm touches the body, ramps to its set force, holds, unloads and goes on. "
        "The body is drawn with its computed deformation, to scale; the arrow is the contact "
        "force, white dots are presses made. Below: force and travel of the tip against time."
    ),
    "truth": "**Truth**: Young's modulus that the virtual body has; white circle: inclusion.",
    "fit": (
        "**Found**: the present estimate, on the colour scale of the truth where there is one; "
        "orange circles: inclusions. Below: parameters (pale: true values) and misfit "
        "(log10 of the rms in µm and of chi-square per degree of freedom)."
    ),
    "presses": "**Each press**: displacement as measured (dots) and as modelled (crosses).",
    "comparison": (
        "**Residual**: measured minus modelled displacement, painted where the press was; red "
        "gave way more than modelled, blue less. Noise looks like confetti; patches mean that the "
        "model misses something."
    ),
}

_TIMELINES = (
    f"**Timelines** (choose below): `{parts.SIM_TIME}` plays the scan, then the iterations, one "
    f"second each; `{parts.PRESS}` shows each press at its largest force; `{parts.ITERATION}` "
    "shows the fit step by step, where force, travel and presses have no place."
)


def story(
    name: str,
    present: Collection[str],
    found: Mapping[str, float],
    true: Mapping[str, float],
) -> str:
    """Markdown text of a recording.

    Parameters
    ----------
    name : of the run
    present : names of parts that there are
    found, true : parameters in SI units by name; empty where there are none
    """
    lines = [f"### {name}", ""]
    if found:
        lines += [markdown(_table(found, true)), ""]
    for part, text in _SEEN.items():
        if part in present:
            lines += [text, ""]
    return "\n".join([*lines, _TIMELINES])


def _table(found: Mapping[str, float], true: Mapping[str, float]) -> Table:
    rows = (
        (
            units.plain_name(name),
            units.quantity(value, units.unit_of(name)),
            units.quantity(true[name], units.unit_of(name)) if name in true else "",
        )
        for name, value in found.items()
    )
    return Table.of(("parameter", number("found"), number("true")), rows)
