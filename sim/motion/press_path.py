"""The arm's configuration as a smooth function of the tip's depth along one press direction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.robot.arm_steps import SERVO_RAD_PER_S
from sim.robot.compiled import compiled
from sim.robot.inverse_kinematics import TipKinematics

KNOTS = 11


@dataclass(frozen=True)
class PressPath:
    """Polynomial q(h) through inverse kinematics solutions at even depths.

    A press then needs one number, the depth h (m, 0 at the planned surface, inwards positive),
    and no inverse kinematics while it runs.

    Attributes
    ----------
    start_m, end_m : range of h
    coefficients : (KNOTS, 2 n), of q and of dq/dh, in powers of (h - middle_m) scale_per_m, -1..1
    """

    start_m: float
    end_m: float
    coefficients: np.ndarray
    middle_m: float
    scale_per_m: float

    def at(self, depth_m: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the configuration (n,) rad and its derivative (n,) rad/m at a depth."""
        q, slope = np.empty((2, self.coefficients.shape[1] // 2))
        path_at(self.coefficients, (depth_m - self.middle_m) * self.scale_per_m, q, slope)
        return q, slope


@compiled
def path_at(coefficients: np.ndarray, s: float, q: np.ndarray, slope: np.ndarray) -> None:
    """Put both polynomials (see `PressPath`) at -1..1 into (n,) each."""
    n = len(q)
    for i in range(n):
        q[i] = slope[i] = 0.0
        for k in range(len(coefficients) - 1, -1, -1):
            q[i] = q[i] * s + coefficients[k, i]
            slope[i] = slope[i] * s + coefficients[k, n + i]


def sideways_yield(kinematics: TipKinematics, path: PressPath, direction: np.ndarray) -> np.ndarray:
    """Yield of the servo to a press, (n,) rad/N, less its part along the tip's path.

    The servo is a spring on the joints' accelerations, and the arm's inertia is not the same in
    all directions: a press of 1 N would push the tip 0.06 mm aside. A command that leads by this
    keeps it on the line; along the line the force control does.

    Parameters
    ----------
    direction : (3,) unit, of the press, world
    """
    q, slope = path.at(0.0)
    along = direction @ kinematics.jacobian(q)
    joints = np.linalg.solve(kinematics.mass(q), -along) / SERVO_RAD_PER_S**2
    return joints - (along @ joints) * slope


def press_path(
    kinematics: TipKinematics,
    point_m: np.ndarray,
    direction: np.ndarray,
    touch: np.ndarray,
    start_m: float,
    end_m: float,
) -> tuple[PressPath | None, float]:
    """Continue a touching configuration along the press direction, outwards and inwards.

    Parameters
    ----------
    point_m, direction : (3,) m and unit, world
    touch : (n,) rad, configuration with the tip on the point
    start_m, end_m : range of depth, start_m < 0 < end_m

    Returns
    -------
    The path, or None where a depth is not reached; and the depth that failed, or `end_m`.
    """
    depths = np.linspace(start_m, end_m, KNOTS)
    solved = np.empty((KNOTS, len(touch)))
    inner = int(np.searchsorted(depths, 0.0))
    for order in (range(inner, KNOTS), range(inner - 1, -1, -1)):
        q = touch
        for k in order:
            reached = kinematics.reach(point_m + depths[k] * direction, direction, q)
            if not reached.converged:
                return None, float(depths[k])
            solved[k] = q = reached.q
    middle, scale = (start_m + end_m) / 2, 2 / (end_m - start_m)
    powers = np.arange(KNOTS)
    matrix = ((depths - middle) * scale)[:, None] ** powers
    q_part = np.linalg.solve(matrix, solved)
    rate = np.zeros_like(q_part)
    rate[:-1] = q_part[1:] * powers[1:, None] * scale
    return PressPath(start_m, end_m, np.hstack([q_part, rate]), middle, scale), end_m
