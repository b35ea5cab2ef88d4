"""MuJoCo's step for compiled loops: the C function itself, without Python between two steps."""

# mujoco is a compiled module without type stubs
# pyright: reportAttributeAccessIssue=false
from __future__ import annotations

import ctypes
from pathlib import Path

import mujoco
from numba import types


def _load() -> None:
    """Let compiled functions find the symbols of the library that the mujoco package has loaded."""
    folder = Path(mujoco.__file__).parent
    files = [
        file
        for pattern in ("libmujoco*.so*", "libmujoco*.dylib", "mujoco.dll")
        for file in sorted(folder.rglob(pattern))
    ]
    if not files:
        raise ImportError(f"{folder}: found no MuJoCo library; install mujoco from its wheel")
    ctypes.CDLL(str(files[0]), mode=ctypes.RTLD_GLOBAL)


_load()

mj_step = types.ExternalFunction("mj_step", types.void(types.int64, types.int64))
"""(address of the model, address of the data)."""
