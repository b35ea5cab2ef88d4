"""The tables of an explanation's report, as HTML: ladder, rivals, candidates, parameters."""

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import numpy as np

from identify.effects.units import percent
from identify.residual.statement import length
from identify.select.accepted_effect import AcceptedEffect
from identify.select.forward_selection import Explanation
from palpmap.report.html import table
from palpmap.result.explain_words import CANDIDATES, interval, rung_labels, unseen_shift
from palpmap.result.finding import Finding
from palpmap.result.truth import matched
from palpmap.study.frame import frame_shift_m
from palpmap.units import plain_name, quantity, shift, unit_of

_ORDER = ("supported", "helps", "indistinguishable", "not_seen", "untestable")
_LEAST_P = 1e-12
_NOTHING_M = 5e-8  # rms below which an effect is none
_MOSTLY = 0.5
_SMALL_M = 1e-3


def ladder_table(explained: Explanation) -> str:
    """Return the ladder: errors and chi-square at every rung."""
    rows = [
        (
            label.replace("\n", ", "),
            length(rung.fit.rms_m, signed=False),
            length(rung.cross_validation.rms_m, signed=False),
            "" if high is None else length(high, signed=False),
            length(rung.comparison.expected_rms_m, signed=False),
            f"{rung.fit.chi2_per_dof:.3g}",
        )
        for label, rung in zip(rung_labels(explained), explained.ladder, strict=True)
        for high in (rung.cross_validation.high_rms_m,)
    ]
    head = (
        "Model", "Error (rms)", "Cross-validation", "At forces left out", "Noise alone",
        "Chi-square / dof",
    )  # fmt: skip
    return table(head, rows)


def rival_table(addition: AcceptedEffect) -> str:
    """Return the effects that were refitted at a step, best first."""
    best = addition.candidates[0].criterion
    rows = [
        (
            rival.name,
            f"{rival.chi2:.0f}",
            "best" if rival.criterion == best else f"+{rival.criterion - best:.0f}",
            "as good" if rival.name in addition.equivalents[1:] else "",
        )
        for rival in addition.candidates
    ]
    head = ("Refitted with the map", "Chi-square", "Behind the best, parameters priced", "")
    return table(head, rows) if len(rows) > 1 else ""


def candidate_table(record: Mapping[str, Any]) -> str:
    """Return all candidates with what the scan says of them."""
    known = sorted(record["candidates"], key=lambda c: (_ORDER.index(c["verdict"]), -c["score"]))
    rows = []
    for c in known:
        verdict = c["verdict"]
        kind = {"supported": "good", "indistinguishable": "bad", "helps": "bad"}.get(verdict, "")
        word = escape(CANDIDATES[verdict])
        tested = c["untestable"] is None
        confused = ", ".join(c["confused_with"])
        says = c["evidence"] if verdict != "not_seen" else _unseen(c)
        if confused and verdict != "untestable":
            says += f" Looks like: {confused}."
        rows.append(
            [
                escape(c["name"]),
                f'<span class="{kind}">{word}</span>' if kind else word,
                percent(c["explained_fraction"]) if tested else "",
                chance(c["p_value"]) if tested else "",
                escape(says),
            ]
        )
    head = ("Effect", "Verdict", "Share of the unexplained", "p-value", "Why")
    return table(head, rows, numeric=False, raw=True)


def _unseen(candidate: Mapping[str, Any]) -> str:
    """Say what size it would have; its own sentence of evidence would claim what is noise."""
    size, visible = candidate["rms_m"], candidate["visible"]
    if size < _NOTHING_M:
        return "No more than noise: the best fit of it is none."
    text = f"No more than noise (at best {length(size, signed=False)} rms"
    if visible < _MOSTLY:
        text += f", of which the map can imitate all but {percent(visible)}"
    return f"{text})."


def chance(p: float) -> str:
    """Return a p-value as a reader needs it, as HTML."""
    return f"&lt; {_LEAST_P:g}" if p < _LEAST_P else f"{p:.2g}"


def parameter_table(finding: Finding, explained: Explanation, record: Mapping[str, Any]) -> str:
    """Return the parameters before and after, with the truth where it is known."""
    first, last = explained.ladder[0].fit, explained.final.fit
    true = {} if finding.truth is None else matched(last.map, finding.truth)
    stepped, shifts = len(explained.ladder) > 1, record.get("unseen_shifts")
    rows = []
    for name, p in record["parameters"].items():
        moved = frame_shift_m(name, finding.origin_m)
        row = [escape(plain_name(name) if name in last.map.names else name)]
        if stepped:
            known = name in first.values
            row.append(_with_error(first.values[name] + moved, first.std.get(name, 0.0), p["unit"])
                       if known else "")  # fmt: skip
        bound = ' <span class="bad">at its bound</span>' if p["at_bound"] else ""
        row.append(_with_interval(p) + bound)
        if shifts:
            row.append(escape(unseen_shift(name, record, named=True)))
        if true:
            row += _against(name, true, first, last, moved, stepped)
        rows.append(row)
    now = "After" if stepped else "Found"
    head = ["Parameter", *(["Before"] if stepped else []), f"{now}, 95 % interval"]
    if shifts:
        head.append("Unseen effect")
    if true:
        head += ["True", *(["Off before"] if stepped else []), "Off after" if stepped else "Off"]
    return table(head, rows, raw=True)


def _against(
    name: str, true: Mapping[str, float], first: Any, last: Any, moved: float, stepped: bool
) -> list[str]:
    if name not in true:
        return [""] * (3 if stepped else 2)
    unit = "Pa" if name.endswith("_pa") else "m"
    cells = [escape(quantity(true[name] + moved, unit))]
    for fit in (first, last) if stepped else (last,):
        std = fit.std.get(name, 0.0)
        off = (fit.values[name] - true[name]) / std if std > 0 else np.nan
        kind = "bad" if abs(off) > 3 else "good"
        cells.append(f'<span class="{kind}">{off:+.1f} s.e.</span>' if np.isfinite(off) else "")
    return cells


def _with_interval(p: Mapping[str, Any]) -> str:
    """Return a parameter's value and its 95 % interval."""
    text = _with_error(p["value"], 0.0, p["unit"])
    if not p["std"]:
        return text
    return f"{text} ({interval(p)})"


def _with_error(value: float, std: float, unit: str) -> str:
    unit = "" if unit == "1" else unit
    scale = {"Pa": 1e-3, "m": 1e3}.get(unit, 1.0)
    text = quantity(value, unit)
    if unit == "m" and abs(value) < _SMALL_M:
        text = f"{1e3 * value:.3g} mm"
    return escape(text + (f" ± {scale * std:.2g}" if std > 0 else ""))


def next_press_table(presses: Sequence[Mapping[str, Any]]) -> str:
    """Return the scans that would tell an ambiguous group apart, the one to make first."""
    rows = [
        (
            str(p.get("change", "")),
            str(p.get("why", "")),
            str(p.get("presses", "")),
            f"{p['duration_s'] / 60:.2g}" if _is_number(p.get("duration_s")) else "",
            f"{p['discrimination']:.3g}" if _is_number(p.get("discrimination")) else "",
            str(p.get("program", "") or ""),
        )
        for p in presses
    ]
    head = ("Change", "Why", "Presses", "Minutes", "Expected chi-square", "Press program")
    return table(head, rows, numeric=False)


def detection_table(limits: Sequence[Mapping[str, Any]]) -> str:
    """Return how small each effect may be to be seen, and what it would do to the map unseen."""
    names = list(dict.fromkeys(n for e in limits for n in e.get("map_bias") or {}))
    head = ["Effect", "Seen from", "Confused with"]
    head += [f"{plain_name(n)}, {'kPa' if n.endswith('_pa') else 'mm'}" for n in names]
    rows = []
    for e in limits:
        share, bias = e.get("smallest_share"), e.get("map_bias") or {}
        rows.append(
            [
                str(e.get("name", "")),
                percent(share) if share is not None else "never",
                str(e.get("untestable") or "") or ", ".join(e.get("confused_with") or ()),
                *(shift(bias[n], unit_of(n)) if _is_number(bias.get(n)) else "" for n in names),
            ]
        )
    return table(head, rows, numeric=False)


def _is_number(value: Any) -> bool:
    return (
        isinstance(value, int | float) and not isinstance(value, bool) and bool(np.isfinite(value))
    )
