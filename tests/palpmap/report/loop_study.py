"""Small studies on files, for tests of the commands: twelve presses, a map of one free number."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from models.scan import Scan
from models.scan_file import write_scan
from palpmap.study.study import About, Body, Map, Noise, Probe, Study, write_study
from tests.identify.select.loop_problem import (
    NOISE,
    NU,
    PEAK_N,
    SIZE,
    TRUE,
    points,
    scan,
    timing,
    true_compliance,
)

PRESSES = (0, 2, 4, 7, 10, 11, 12, 13, 14, 17, 20, 24)
CREEP, TIME_S = 0.1, 0.8


def creeping(seed: int) -> Scan:
    """A scan of a Kelvin-Voigt element, in steps of a millisecond, on the true body."""
    press, time, _, force = timing(seed)
    travel = true_compliance()[press] * force
    for j in range(25):
        own = press == j
        start = time[own][0] - 0.125
        fine = np.arange(start, time[own][-1] + 1e-3, 1e-3)
        u = np.interp(fine, np.r_[start, time[own]], np.r_[0.0, travel[own]])
        z = np.zeros_like(u)
        for i in range(1, len(u)):
            z[i] = z[i - 1] + (u[i] - z[i - 1]) * 1e-3 / TIME_S
        travel[own] += CREEP * np.interp(time[own], fine, z)
    return few(scan(travel, force, seed))


def shifted(seed: int, offset_m: float = 1.5e-4) -> Scan:
    """A scan whose first touch is declared too early."""
    press, _, _, force = timing(seed)
    return few(scan(true_compliance()[press] * force + offset_m, force, seed))


def few(table: Scan) -> Scan:
    """The twelve presses of a scan of 25."""
    return table.rows(np.isin(table.press, PRESSES))


def untimed(table: Scan) -> Scan:
    return replace(table, time_s=np.full(len(table.press), np.nan))


def of_one_force(table: Scan) -> Scan:
    """Held readings only, with the force that was set in place of the one that was measured."""
    held = table.rows(table.phase == "hold")
    return replace(held, force_n=np.full(len(held.press), PEAK_N))


def at_one_place(table: Scan) -> Scan:
    return replace(table, point_m=np.tile(points()[12], (len(table.press), 1)))


def put(folder: Path, table: Scan) -> Path:
    """Write scan and study into a new folder; return the study's path. Only E0 is free."""
    folder.mkdir()
    write_scan(table, folder / "scan.csv")
    values = dict(zip(TRUE.names, map(float, TRUE.values), strict=True))
    background = 1.04 * values.pop("background_pa")
    study = Study(
        study=About(name=folder.name, scan=folder / "scan.csv"),  # pyright: ignore[reportCallIssue]
        body=Body(  # pyright: ignore[reportCallIssue]
            shape="block", size_m=SIZE, poisson_ratio=NU, cell_size_m=0.01
        ),
        probe=Probe(tip="flat", radius_m=0.004),
        noise=Noise(displacement_m=NOISE.displacement_m, force_n=NOISE.force_n),
        map=Map(inclusions=1, initial={"background_pa": background}, fixed=values),
    )
    write_study(study, folder / "study.toml")
    return folder / "study.toml"
