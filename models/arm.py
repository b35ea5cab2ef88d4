"""The laboratory's arm: its MJCF files, its names, and the published table behind them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

ARM_XML = Path(__file__).parent / "panda" / "arm.xml"
SCENE_XML = Path(__file__).parent / "panda" / "scene.xml"

JOINTS = tuple(f"joint{i}" for i in range(1, 8))
LINKS = (*(f"link{i}" for i in range(8)), "probe")

PROBE_LENGTH_M = 0.145
"""From the flange to the tip's flat face."""

REACH_M = 0.855
"""Published reach, from the shoulder to the flange."""

SHOULDER_M = np.array([0.0, 0.0, 0.333])
"""Centre of the shoulder in the arm's base frame."""

DENAVIT_HARTENBERG = np.array(
    [
        # a (m), d (m), alpha (rad)
        [0.0, 0.333, 0.0],
        [0.0, 0.0, -np.pi / 2],
        [0.0, 0.316, np.pi / 2],
        [0.0825, 0.0, np.pi / 2],
        [-0.0825, 0.384, -np.pi / 2],
        [0.0, 0.0, np.pi / 2],
        [0.088, 0.0, np.pi / 2],
        [0.0, 0.107, 0.0],
    ]
)
"""Craig's convention, seven joints and the flange; source: Franka Control Interface documentation,
"Denavit-Hartenberg parameters" of the Franka Emika Robot (Panda)."""

for _array in (SHOULDER_M, DENAVIT_HARTENBERG):
    _array.flags.writeable = False
