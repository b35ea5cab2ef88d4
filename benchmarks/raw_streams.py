"""Raw streams of a made-up rig, drawn by seed and imported: presses cut right, lags found.

    python benchmarks/raw_streams.py FIRST LAST [--save streams.jsonl]
    python benchmarks/raw_streams.py --table streams.jsonl ...

The streams, and what counts as right, are those of tests/palpmap/importing/raw_streams.py. `FIRST`
and `LAST` are seeds, both included; some 1.5 s of CPU each. `--table` counts saved runs together.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from palpmap.importing.streams.lag import WITHIN_2_MS
from tests.palpmap.importing.raw_streams import Outcome, outcome

WITHIN_S = 2e-3
INFORMS_S = 1e-3  # Cramer-Rao bound below which a recording determines its lag


def table(outcomes: Sequence[Outcome]) -> list[str]:
    """Return the lines of the table in docs/import.md."""
    presses = sum(one.presses for one in outcomes)
    wrong = sum(one.wrong for one in outcomes)
    cut = [one for one in outcomes if not one.refused]
    off, bound = (np.array([getattr(one, name) for one in cut]) for name in ("off_s", "bound_s"))
    stated, sharp = np.array([one.stated_s for one in cut]), np.array([one.sharp for one in cut])
    near = np.abs(off) < WITHIN_S

    def share(rows: np.ndarray) -> str:
        return f"{100 * near[rows].mean():.1f} % of {rows.sum()}" if rows.any() else "none"

    within = [f"{100 * np.mean(np.abs(off) < k * stated):.1f} %" for k in (2, 3)]
    rows = [
        ("presses right", f"{100 * (1 - wrong / presses):.1f} % of {presses}"),
        ("streams with a silent error", sum(bool(one.silent) for one in outcomes)),
        ("streams refused, with a sentence", sum(bool(one.refused) for one in outcomes)),
        ("presses left out although good, with a sentence", sum(len(one.lost) for one in outcomes)),
        ("lag within 2 ms: where the page claims it", share(stated <= WITHIN_2_MS)),
        ("all streams", share(np.ones(len(cut), dtype=bool))),
        ("where the tip stops sharply", share(sharp)),
        ("where the recording determines it to 1 ms", share(bound < INFORMS_S)),
        ("of these, where the tip stops sharply", share((bound < INFORMS_S) & sharp)),
        ("lag within 2 and 3 stated standard deviations", ", ".join(within)),
        ("median error of the lag by the bound, sharp stops",
         f"{np.median(np.abs(off[sharp]) / bound[sharp]):.2f}"),
    ]  # fmt: skip
    return ["| | |", "|---|---:|", *(f"| {name} | {value} |" for name, value in rows)]


def main() -> None:
    """Import the streams of the seeds, or count saved ones."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("seeds", nargs="*", type=int, help="first and last")
    parser.add_argument("--save", type=Path)
    parser.add_argument("--table", nargs="+", type=Path, default=[])
    given = parser.parse_args()
    outcomes = [
        Outcome(**json.loads(line))
        for path in given.table
        for line in path.read_text().splitlines()
    ]
    for seed in range(given.seeds[0], given.seeds[1] + 1) if given.seeds else ():
        one = outcome(seed)
        outcomes.append(one)
        for fault in (one.refused, *one.silent, *one.lost):
            if fault:
                print(f"seed {seed}: {fault}", file=sys.stderr, flush=True)
        if given.save:
            with given.save.open("a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(one)) + "\n")
    print("\n".join(table(outcomes)))


if __name__ == "__main__":
    main()
