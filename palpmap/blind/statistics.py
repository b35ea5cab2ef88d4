"""What a tournament of blind trials has shown: rates, what was named for what, coverage."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

OUTCOMES = ("right", "honest", "missed", "wrong")


def tally(lines: Sequence[dict[str, Any]]) -> str:
    """Return a few words of how it stands."""
    counts = {o: sum(line.get("outcome") == o for line in lines) for o in OUTCOMES}
    failed = sum("error" in line for line in lines)
    text = ", ".join(f"{number} {outcome}" for outcome, number in counts.items())
    return text + (f", {failed} failed" if failed else "")


def tournament_record(lines: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return rates by category and by what was hidden, and what was named for what.

    Parameters
    ----------
    lines : of `trials.jsonl`
    """
    judged = [line for line in lines if "error" not in line]
    confusion: dict[str, dict[str, int]] = {}
    for line in judged:
        hidden, found = "+".join(line["hidden"]) or "none", _found(line)
        confusion.setdefault(hidden, {})
        confusion[hidden][found] = confusion[hidden].get(found, 0) + 1
    return {
        "trials": len(lines),
        "failed": len(lines) - len(judged),
        "errors": sorted({line["error"] for line in lines if "error" in line}),
        "passed": sum(line["passed"] for line in judged),
        "wrong": sum(line["outcome"] == "wrong" for line in judged),
        "categories": _rates(judged, lambda line: line["category"]),
        "effects": _rates(judged, lambda line: "+".join(line["hidden"]) or "none"),
        "confusion": confusion,
        "coverage": _coverage(judged),
    }


def _coverage(lines: Sequence[dict[str, Any]]) -> dict[str, dict[str, int]]:
    """Return how often a 95 % interval held the truth, where the right answer was given.

    By parameter of the map: how many intervals there were, and how many held.
    """
    found: dict[str, dict[str, int]] = {}
    for line in lines:
        if line["outcome"] != "right" or line["verdict"] not in ("explained", "nothing_missing"):
            continue
        for row in line.get("map", ()):
            if "inside" in row:
                count = found.setdefault(row["name"], {"intervals": 0, "held": 0})
                count["intervals"] += 1
                count["held"] += bool(row["inside"])
    return found


def _found(line: dict[str, Any]) -> str:
    if line["added"]:
        ended = "" if line["verdict"] == "explained" else f" ({line['verdict']})"
        return "+".join(line["added"]) + ended
    if line["ambiguous"]:
        return "one of " + ", ".join(line["ambiguous"][0])
    return line["verdict"]


def _rates(
    lines: Sequence[dict[str, Any]], key: Callable[[dict[str, Any]], str]
) -> dict[str, dict[str, int]]:
    found: dict[str, dict[str, int]] = {}
    for line in sorted(lines, key=key):
        row = found.setdefault(key(line), {"trials": 0, "passed": 0, **dict.fromkeys(OUTCOMES, 0)})
        row["trials"] += 1
        row["passed"] += bool(line["passed"])
        row[line["outcome"]] += 1
    return found


def tournament_screen(record: dict[str, Any]) -> list[Any]:
    """Return tables: rates by category, then what was named for what."""
    from rich import box
    from rich.table import Table

    rates = Table("category", "trials", "passed", *OUTCOMES, box=box.SIMPLE)
    for name, row in record["categories"].items():
        share = f"{row['passed']} ({100 * row['passed'] / row['trials']:.0f} %)"
        rates.add_row(name, str(row["trials"]), share, *(str(row[o]) for o in OUTCOMES))
    confusion = Table("hidden", "found", "times", box=box.SIMPLE)
    for hidden in sorted(record["confusion"]):
        ordered = sorted(record["confusion"][hidden].items(), key=lambda pair: -pair[1])
        for i, (found, times) in enumerate(ordered):
            confusion.add_row(hidden if i == 0 else "", found, str(times))
    last = f"{record['passed']} of {record['trials']} passed, {record['wrong']} wrong"
    if record["failed"]:
        last += f", {record['failed']} failed: {record['errors'][0]}"
    counts = record["coverage"].values()
    if counts:
        held, all_of_them = (sum(count[key] for count in counts) for key in ("held", "intervals"))
        last += f"; 95 % intervals of the map held the truth {held} of {all_of_them} times"
    return [confusion, rates, last]
