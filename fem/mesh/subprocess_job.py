"""Runs a job of `fem.mesh.surface_worker` in its own process, within a time limit."""

from __future__ import annotations

import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from fem.errors import MeshError

_JOBS = {"read": "Reading the surface file", "tetrahedralize": "The mesher"}
_WORKER = Path(__file__).with_name("surface_worker.py")


def run_job(job: str, time_limit_s: float, **given: Any) -> dict[str, np.ndarray]:
    """Return the arrays that the job makes of the given ones.

    Raises
    ------
    MeshError
        The job found a fault, crashed, or did not end within the time limit.
    """
    with tempfile.TemporaryDirectory(prefix="palpmap-") as folder:
        source, target = Path(folder, "input.npz"), Path(folder, "output.npz")
        np.savez(source, **given)
        # -P: modules of the worker's folder must not hide others of the same name
        command = [sys.executable, "-P", str(_WORKER), job, str(source), str(target)]
        try:
            done = subprocess.run(
                command,
                capture_output=True,
                timeout=time_limit_s,
                stdin=subprocess.DEVNULL,
                cwd=folder,  # the mesher leaves a file where it runs
            )
        except subprocess.TimeoutExpired as error:
            raise MeshError(
                f"{_JOBS[job]} did not end within {time_limit_s:g} s: use a longer edge length, "
                "a coarser surface, or a higher time limit."
            ) from error
        if done.returncode < 0:
            raise MeshError(
                f"{_JOBS[job]} crashed ({signal.Signals(-done.returncode).name}): the surface "
                "is damaged; repair it and export it again."
            )
        if done.returncode or not target.exists():
            lines = done.stderr.decode(errors="replace").strip().splitlines() or ["no message"]
            raise MeshError(f"{_JOBS[job]} failed: {lines[-1]}")
        with np.load(target, allow_pickle=False) as file:
            result = dict(file)
    if "error" in result:
        raise MeshError(str(result["error"]))
    return result
