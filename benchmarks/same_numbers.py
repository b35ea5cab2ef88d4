"""Whether two states of the code give the same numbers: a guard for changes of its structure.

    python benchmarks/same_numbers.py measure before.json  # in one checkout, about 70 min of CPU
    python benchmarks/same_numbers.py measure after.json  # in the other
    python benchmarks/same_numbers.py compare before.json after.json

Measured are the accuracy table, the paper's tests by both optimisers, the fits of `case_a` and
`case_k`, `explain` on the open cases a to k, and twelve blind trials whose seeds stand in `SEEDS`.
Everything but the accuracy table goes through the command line and is read from its JSON, so that
the same script measures any state of the code. A stopped measurement goes on where it was stopped.
`compare` prints each number that differs by more than `RTOL` and exits with 1 if there is one.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent.parent
LAB = ROOT / "tests" / "data" / "lab"
CASES = tuple(f"case_{letter}" for letter in "abcdefghijk")
SEEDS = tuple(range(2801, 2813))
RTOL = 1e-4
"""Relative: far above rounding carried through an iteration that ends at 1e-9 of chi-square, far
below any standard error."""
NEAR_NOUGHT = {"m": 1e-7, "Pa": 1.0, "N": 1e-6, "": 1e-6}
"""Absolute differences that count as none, by unit."""


def command(*words: object) -> dict[str, Any]:
    """Return what a command prints as JSON; exit code 1 is an answer, not an error."""
    line = [sys.executable, "-m", "palpmap", *map(str, words), "--json"]
    threads = {"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    done = subprocess.run(
        line, capture_output=True, text=True, check=False, cwd=ROOT, env={**os.environ, **threads}
    )
    if done.returncode not in (0, 1):
        raise SystemExit(f"{' '.join(line)}\n{done.stderr}")
    return json.loads(done.stdout)


def parameters(record: dict[str, Any]) -> dict[str, Any]:
    """Return value and interval of each parameter."""
    kept = ("value", "std", "lower95", "upper95", "unit")
    return {
        name: {key: entry.get(key) for key in kept} for name, entry in record["parameters"].items()
    }


def explained(study: Path, folder: Path) -> dict[str, Any]:
    """Return verdict, ladder, candidates and parameters of an explained study."""
    record = command("explain", study, "--out", folder)
    step = ("effects", "rms_m", "held_out_rms_m", "noise_rms_m", "chi2_per_dof", "is_noise")
    candidate = ("verdict", "score", "p_value", "visible", "confused_with")
    return {
        "verdict": record["verdict"],
        "added": record["added"],
        "ambiguous": record["ambiguous"],
        "ladder": [{key: rung[key] for key in step} for rung in record["ladder"]],
        "candidates": {
            entry["name"]: {key: entry.get(key) for key in candidate}
            for entry in record["candidates"]
        },
        "parameters": parameters(record),
        "detection_limits": record["detection_limits"],
        "suspect_presses": record["suspect_presses"],
    }


def trial(seed: int, folder: Path) -> dict[str, Any]:
    """Return the explanation of a blind trial."""
    command("blind", "--seed", seed, "--out", folder / "trial")
    return explained(folder / "trial" / "study.toml", folder / "why")


def accuracy(folder: Path) -> dict[str, Any]:
    """Return the errors of the accuracy table, without its times."""
    sys.path[:0] = [str(ROOT), str(Path(__file__).parent)]
    from accuracy import table

    rows = [re.split(r"\s*\|\s*", line)[1:6] for line in table() if line.startswith("| ")]
    return {name: [float(e) for e in errors] for name, *errors in rows[1:]}


def paper(method: str, folder: Path) -> dict[str, Any]:
    """Return the paper's six tests by one optimiser, without their times."""
    record = command("paper", "--optimizer", method, "--out", folder)
    return {"tests": [without_times(test) for test in record["tests"]]}


def without_times(value: Any) -> Any:
    """Return a JSON value without entries that are times."""
    if isinstance(value, dict):
        return {k: without_times(v) for k, v in value.items() if "second" not in k}
    return [without_times(entry) for entry in value] if isinstance(value, list) else value


def fitted(name: str, folder: Path) -> dict[str, Any]:
    """Return the fitted map of an open case."""
    record = command("fit", LAB / name / "study.toml", "--out", folder)
    return {"parameters": parameters(record)}


def work() -> dict[str, Callable[[Path], dict[str, Any]]]:
    """Everything that is measured, by name."""
    return {
        "accuracy": accuracy,
        **{f"paper {m}": lambda f, m=m: paper(m, f) for m in ("bfgs", "gauss-newton")},
        **{f"fit {c}": lambda f, c=c: fitted(c, f) for c in ("case_a", "case_k")},
        **{c: lambda f, c=c: explained(LAB / c / "study.toml", f / "why") for c in CASES},
        **{f"trial {s}": lambda f, s=s: trial(s, f) for s in SEEDS},
    }


def measure(file: Path, only: list[str]) -> None:
    """Measure what a file does not hold yet."""
    found = json.loads(file.read_text()) if file.exists() else {}
    for name, task in work().items():
        if name in found or (only and name not in only):
            continue
        with tempfile.TemporaryDirectory() as folder:
            found[name] = task(Path(folder) / "run")
        file.write_text(json.dumps(found, indent=1))
        print(f"{name}: {len(found)} of {len(work())}", flush=True)


def differences(old: Any, new: Any, where: str = "", unit: str = "") -> Iterator[str]:
    """Yield each value that is not the same in both."""
    if isinstance(old, dict) and isinstance(new, dict):
        unit = old.get("unit", unit) or ""
        for key in sorted(old.keys() | new.keys()):
            if key not in old or key not in new:
                yield f"{where}/{key}: only in {'the second' if key in new else 'the first'}"
            else:
                own = "m" if key.endswith("_m") else unit
                yield from differences(old[key], new[key], f"{where}/{key}", own)
    elif isinstance(old, list) and isinstance(new, list):
        if len(old) != len(new):
            yield f"{where}: {len(old)} entries became {len(new)}: {old} and {new}"
            return
        for number, pair in enumerate(zip(old, new, strict=True)):
            yield from differences(*pair, f"{where}[{number}]", unit)
    elif isinstance(old, float) and isinstance(new, float | int):
        near = NEAR_NOUGHT.get(unit, NEAR_NOUGHT[""])
        both_nan = math.isnan(old) and math.isnan(new)
        if not both_nan and not math.isclose(old, new, rel_tol=RTOL, abs_tol=near):
            yield f"{where}: {old:.9g} became {new:.9g}"
    elif old != new:
        yield f"{where}: {old!r} became {new!r}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("action", choices=("measure", "compare"))
    parser.add_argument("files", nargs="+", type=Path)
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME", help="of what is measured")
    words = parser.parse_args()
    if words.action == "measure":
        measure(words.files[0], words.only)
        return
    first, second = (json.loads(file.read_text()) for file in words.files)
    both = [name for name in first if name in second and (not words.only or name in words.only)]
    lines = [line for name in both for line in differences(first[name], second[name], name)]
    print("\n".join(lines))
    print(f"{len(lines)} differences in {len(both)} of {len(first)} measurements")
    sys.exit(bool(lines))


if __name__ == "__main__":
    main()
