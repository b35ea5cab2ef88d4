"""`palpmap reveal`: the sealed answer of a blind trial beside the finding."""

from pathlib import Path
from typing import TYPE_CHECKING

from identify.select import Verdict
from models import InputError
from palpmap import units
from palpmap.blind.records import AnswerRecord, MapErrorRecord, RevealRecord
from palpmap.blind.score import map_errors, score_blind
from palpmap.blind.seal import FOLDER, unseal
from palpmap.console import Output

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
    path = newest_result(trial) if answer is None else None
    result = stated(answer or "") if path is None else AnswerRecord.read(path)
    score = score_blind(result, truth.effects)
    rows = map_errors(result, truth)
    record = RevealRecord(
        **dict(score),
        hidden=truth.effects,
        verdict=result.verdict,
        added=result.added,
        ambiguous=result.ambiguous,
        map=rows,
        result=None if path is None else str(path),
    )
    output.result(record.to_dict(), *reveal_screen(record))
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


def stated(answer: str) -> AnswerRecord:
    """Return a person's answer in the form of a result: names, none or unexplained.

    >>> stated("none").verdict, stated("force_bias, breathing").added
    ('nothing_missing', ('force_bias', 'breathing'))
    """
    names = [name.strip() for name in answer.split(",") if name.strip()]
    if not names:
        raise InputError("found an empty answer, expected names of effects, none or unexplained")
    words: dict[str, Verdict] = {"none": "nothing_missing", "unexplained": "unexplained"}
    if len(names) > 1 and any(name in words for name in names):
        raise InputError(
            f"--answer: found '{answer}', expected names of effects, or none or unexplained alone"
        )
    if names[0] in words:
        return AnswerRecord(verdict=words[names[0]])
    from identify.catalogue import CATALOGUE

    known = [effect.name for effect in CATALOGUE]
    for name in names:
        if name not in known:
            raise InputError(
                f"--answer: found '{name}', expected none, unexplained or {', '.join(known)}"
            )
    return AnswerRecord(verdict="explained", added=tuple(names))


def reveal_screen(record: RevealRecord) -> "list[RenderableType]":
    """Return one screen: verdict, hidden beside found, map beside truth."""
    from rich import box
    from rich.table import Table

    colour = {"right": "green", "honest": "yellow", "missed": "yellow", "wrong": "red"}
    style = colour[record.outcome]
    table = Table(box=box.SIMPLE, show_header=False, title="hidden and found", title_justify="left")
    hidden = [
        f"{effect.name}, {100 * effect.size:.2g} % of the signal (rms displacement)"
        + "".join(f"\n  {name} {value:.4g}" for name, value in effect.values.items())
        for effect in record.hidden
    ]
    table.add_row("hidden", "\n".join(hidden) or "nothing")
    table.add_row("found", ", ".join(record.added) or "nothing")
    for group in record.ambiguous:
        table.add_row("one of", ", ".join(group))
    table.add_row("verdict", record.verdict)
    screen: list[RenderableType] = [table, f"[bold {style}]{record.outcome}[/]: {record.reason}"]
    if record.map:
        found = Table("parameter", "found", "true", "off by", box=box.SIMPLE, title="map",
                      title_justify="left")  # fmt: skip
        for row in record.map:
            found.add_row(row.name, *_shown(row))
        screen.insert(1, found)
    return screen


def _shown(row: MapErrorRecord) -> tuple[str, str, str]:
    """Found, true and the difference."""
    unit = units.unit_of(row.name)
    off = row.found - row.true
    much = f"{100 * off / row.true:+.1f} %" if unit == "Pa" else f"{units.shift(off, unit)} mm"
    if row.std:
        much += f" ({abs(off) / row.std:.1f} sigma)"
    return units.quantity(row.found, unit, row.std or 0.0), units.quantity(row.true, unit), much
