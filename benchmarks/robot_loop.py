"""Computing time of the robot's loop for a simulated second, against MuJoCo's step alone.

Part of `python benchmarks/run.py`. Twelve presses, planned before, in one thread: control, physics,
watchdogs, record and the reduction to rows, without recording and without solving the body. The
smallest of three runs counts, processor time.
"""

# mujoco is a compiled module without type stubs
# pyright: reportAttributeAccessIssue=false
from __future__ import annotations

import time

import mujoco
import numpy as np

from sim.motion import ScanPlan, ScanSettings
from sim.motion.planner import plan_motion
from sim.motion.scene import plan_scene
from sim.robot.laboratory import Laboratory
from sim.robot.mechanism import Mechanism, Mechanisms
from sim.scan.whole_scan import run_scan

PRESSES, RUNS, ALONE_STEPS = 12, 3, 20_000


class _Spring:
    """F = 80 N/m u."""

    def displacement(self, press: int, force_n: float) -> float:
        return force_n / 80

    def tangent(self, press: int, force_n: float) -> float:
        return 80.0


class _Ball(_Spring):
    """F = k u^1.5, 10 mm at 0.3 N."""

    def displacement(self, press: int, force_n: float) -> float:
        return float(np.cbrt(max(force_n, 0.0) / 300) ** 2)

    def tangent(self, press: int, force_n: float) -> float:
        return 450 * float(np.cbrt(max(force_n, 1e-6) / 300))


def table() -> list[str]:
    """Return the table as lines of Markdown."""
    x = 0.024 + 0.012 * (np.arange(PRESSES) % 4)
    points = np.column_stack([x, 0.03 + 0.012 * (np.arange(PRESSES) // 4), np.full(PRESSES, 0.048)])
    plan = ScanPlan(points, np.tile([0.0, 0.0, -1.0], (PRESSES, 1)), 0.3)
    settings = ScanSettings(seed=1)
    laboratory = plan_scene(plan, settings)
    motion = plan_motion(plan, laboratory, settings)
    planted = Mechanisms((Mechanism("none", sensor=lambda t, wrench: wrench),))
    alone = _alone_ms(laboratory)
    lines = [
        "| what is pressed | ms of computing a simulated second | of these MuJoCo's step alone |",
        "|---|---:|---:|",
    ]
    for name, body, mechanisms in (
        ("a body with a straight law", _Spring(), None),
        ("a body with a ball's law, asked at every 2 % of the force", _Ball(), None),
        ("the first, with a mechanism in Python at the force sensor", _Spring(), planted),
    ):
        spent = []
        for _ in range(RUNS + 1):  # the first compiles
            started = time.process_time()
            run = run_scan(plan, body, settings, motion=motion, mechanisms=mechanisms)
            spent.append((time.process_time() - started) / run.simulated_s)
        lines.append(f"| {name} | {1e3 * min(spent):.1f} | {alone:.1f} |")
    return lines


def _alone_ms(laboratory: Laboratory) -> float:
    """Time of MuJoCo's step, called from Python with the arm at rest, for a simulated second."""
    model, data, spent = laboratory.model, mujoco.MjData(laboratory.model), []
    data.qpos[:] = laboratory.home
    for _ in range(RUNS):
        started = time.process_time()
        for _ in range(ALONE_STEPS):
            data.qfrc_applied[:] = data.qfrc_bias
            mujoco.mj_step(model, data)
        spent.append(time.process_time() - started)
    return 1e3 * min(spent) / ALONE_STEPS / model.opt.timestep


if __name__ == "__main__":
    print("\n".join(table()))
