"""A plan that many tests press: a square grid on the top of a block."""

import numpy as np

from sim.motion.scan_plan import ScanPlan

SIZE = (0.096, 0.096, 0.048)
MARGIN_M = 0.012


def grid_plan(per_side=9, **settings):
    """Return the presses in rows that run to and fro."""
    x, y = (np.linspace(MARGIN_M, edge - MARGIN_M, per_side) for edge in SIZE[:2])
    points = [(xi, yk, SIZE[2]) for k, yk in enumerate(y) for xi in x[:: -1 if k % 2 else 1]]
    down = np.tile([0.0, 0.0, -1.0], (len(points), 1))
    return ScanPlan(np.array(points), down, body_size_m=SIZE, **settings)
