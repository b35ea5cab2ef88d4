"""Prediction of a scan's whole presses by a fit to their shallow parts: a row of a table.

    python benchmarks/deeper.py SCAN --cut MM [--to MM] [--first N] [--every N] [--effects NAME ...]

SCAN has a ball as its tip. The body comes from its contact points (30 mm thick, an assumption), the
map is free. The rows of docs/real_measurements.md, of scans that are not part of this repository.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np

import palpmap as pm

STUDY = """\
[study]
name = "cut"
scan = "scan.csv"

[body]
shape = "from-contacts"
thickness_m = 0.03
thickness_assumed = true
poisson_ratio = 0.49

[probe]
tip = "sphere"
radius_m = {radius_m:.6g}

[map]
kind = "free"
"""


def part(scan: pm.Scan, most_m: float, folder: Path, effects: list[str]) -> pm.Experiment:
    """Write the readings down to a travel with a study, and read both."""
    folder.mkdir()
    pm.write_scan(scan.rows(scan.displacement_m <= most_m), folder / "scan.csv")
    study = STUDY.format(radius_m=float(scan.probe_radius_m[0]))
    study += "".join(f'\n[[effects]]\nname = "{name}"\n' for name in effects)
    (folder / "study.toml").write_text(study)
    return pm.read_study(folder / "study.toml")


def row(scan: pm.Scan, cut_m: float, to_m: float, effects: list[str], folder: Path) -> str:
    """Return the row of a table: errors, presses in their bands, chi-square, verdict."""
    shallow = part(scan, cut_m, folder / "shallow", effects)
    found = pm.predict(pm.fit(shallow), part(scan, to_m, folder / "whole", []))
    deep, near = found.scan, found.scan.near_largest_force
    error = np.bincount(deep.press_index[near], found.error_n[near])
    rms = np.sqrt(np.mean((error / np.bincount(deep.press_index[near])) ** 2))
    return (
        f"| {len(error)} | {100 * rms / deep.force_n.max():.2g} % "
        f"| {100 * np.median(np.abs(found.force_error_share)):.2g} % "
        f"| {100 * found.within95:.3g} % | {found.chi2 / found.presses:.2f} | {found.verdict} |"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description="Predict a scan's whole presses by a fit to their shallow parts."
    )
    parser.add_argument("scan", type=Path)
    parser.add_argument("--cut", type=float, required=True, help="travel of the fit, mm")
    parser.add_argument("--to", type=float, default=np.inf, help="travel that is predicted, mm")
    parser.add_argument("--first", type=int, default=0, help="first press")
    parser.add_argument("--every", type=int, default=1, help="take one press in so many")
    parser.add_argument("--effects", nargs="*", default=["touch_threshold"])
    given = parser.parse_args()
    whole = pm.read_scan(given.scan)
    chosen = whole.press_ids[given.first :: given.every]
    whole = whole.rows(np.isin(whole.press_ids[whole.press_index], chosen))
    with tempfile.TemporaryDirectory() as name:
        print(row(whole, 1e-3 * given.cut, 1e-3 * given.to, given.effects, Path(name)))
