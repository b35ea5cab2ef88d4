"""`palpmap reveal`: the sealed answer of a blind trial beside what was found."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from models.errors import InputError
from palpmap import units
from palpmap.blind.score import BlindScore, map_errors, score_blind
from palpmap.blind.seal import FOLDER, unseal
from palpmap.console import Output
from palpmap.run_folder import read_record

if TYPE_CHECKING:
    from rich.console import RenderableType


def run_reveal(*, trial: Path, answer: str | None, output: Output) -> bool:
    """Judge the newest result below a trial's folder, or an answer given by hand.

    Returns
    -------
    bool
        Whether the answer passes, see `palpmap.blind.score`.
    """
    truth = unseal(trial)
    if answer is None:
        path = newest_result(trial)
        result = read_record(path)
    else:
        path, result = None, stated(answer)
    score = score_blind(result, truth)
    rows = map_errors(result, truth)
    record = {
        "schema": 1,
        "category": score.category,
        "outcome": score.outcome,
        "passed": score.passed,
        "reason": score.reason,
        "hidden": truth["effects"],
        "verdict": result["verdict"],
        "added": result["added"],
        "ambiguous": result["ambiguous"],
        "map": rows,
        "result": None if path is None else str(path),
    }
    output.result(record, *reveal_screen(score, result, truth, rows))
    return score.passed


def newest_result(trial: Path) -> Path:
    """Path of the newest result.json below a folder.

    Raises
    ------
    InputError
        There is none.
    """
    found = [path for path in trial.rglob("result.json") if FOLDER not in path.parts]
    if not found:
        raise InputError(
            f"{trial}: found no result.json in it, expected one that `palpmap explain` wrote; run "
            f"palpmap explain {trial / 'study.toml'} --out {trial / 'explained'}, or give your own "
            "answer with --answer"
        )
    return max(found, key=lambda path: path.stat().st_mtime_ns)


def stated(answer: str) -> dict[str, Any]:
    """Return a person's answer in the form of a result: names, none or unexplained.

    >>> stated("none")["verdict"], stated("force_bias, breathing")["added"]
    ('nothing_missing', ['force_bias', 'breathing'])
    """
    names = [name.strip() for name in answer.split(",") if name.strip()]
    if not names:
        raise InputError("found an empty answer, expected names of effects, none or unexplained")
    words = {"none": "nothing_missing", "unexplained": "unexplained"}
    if len(names) > 1 and any(name in words for name in names):
        raise InputError(
            f"--answer: found '{answer}', expected names of effects, or none or unexplained alone"
        )
    if names[0] in words:
        return {"verdict": words[names[0]], "added": [], "ambiguous": []}
    from palpmap.study.study import EFFECTS

    for name in names:
        if name not in EFFECTS:
            raise InputError(
                f"--answer: found '{name}', expected none, unexplained or {', '.join(EFFECTS)}"
            )
    return {"verdict": "explained", "added": names, "ambiguous": []}


def reveal_screen(
    score: BlindScore, result: dict[str, Any], truth: dict[str, Any], rows: list[dict[str, Any]]
) -> "list[RenderableType]":
    """Return one screen: verdict, hidden beside found, map beside truth."""
    from rich import box
    from rich.table import Table

    colour = {"right": "green", "honest": "yellow", "missed": "yellow", "wrong": "red"}
    shown = colour[score.outcome]
    table = Table(box=box.SIMPLE, show_header=False, title="hidden and found", title_justify="left")
    hidden = [
        f"{effect['name']}, {100 * effect['size']:.2g} % of the signal"
        + "".join(f"\n  {name} {value:.4g}" for name, value in effect["values"].items())
        for effect in truth["effects"]
    ]
    table.add_row("hidden", "\n".join(hidden) or "nothing")
    table.add_row("found", ", ".join(result["added"]) or "nothing")
    for group in result["ambiguous"]:
        table.add_row("one of", ", ".join(group))
    table.add_row("verdict", result["verdict"])
    screen: list[RenderableType] = [
        table,
        f"[bold {shown}]{score.outcome}[/]: {score.reason}",
    ]
    if rows:
        found = Table("parameter", "found", "true", "off by", box=box.SIMPLE, title="map",
                      title_justify="left")  # fmt: skip
        for row in rows:
            found.add_row(row["name"], *_shown(row))
        screen.insert(1, found)
    return screen


def _shown(row: dict[str, Any]) -> tuple[str, str, str]:
    """Found, true and the difference."""
    unit = units.unit_of(row["name"])
    off = row["found"] - row["true"]
    much = f"{100 * off / row['true']:+.1f} %" if unit == "Pa" else f"{units.shift(off, unit)} mm"
    if row.get("std"):
        much += f" ({abs(off) / row['std']:.1f} sigma)"
    return units.quantity(row["found"], unit), units.quantity(row["true"], unit), much
