"""Kinematics and inverse dynamics of the arm as compiled functions, for the control loop.

The quantities of Pinocchio's `rnea` and `framesForwardKinematics`, equal to rounding (tested), from
Pinocchio's own model: called from a compiled loop they take a tenth of the time. Newton-Euler
recursion in the joints' own frames, with classical accelerations (Siciliano et al., Robotics, 7.5).
"""

# pinocchio is a compiled module without type stubs
# pyright: reportAttributeAccessIssue=false, reportMissingImports=false
from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from sim.robot.compiled import compiled, part


class Chain(NamedTuple):
    """n joints with one degree of freedom each, every parent before its children.

    Attributes
    ----------
    parent : (n,) number of the joint that carries a joint, -1 the base
    turns : (n,) whether it turns, else slides
    axes : (n, 3) unit, in the joint's frame
    rotations, places : (n, 3, 3), (n, 3) m, of the joint's frame in its parent's at zero
    mass, centre, inertia : (n,) kg, (n, 3) m, (n, 3, 3) kg m^2 about the centre, of what moves with
        a joint
    probe : (4,) kg and m, mass and centre of the probe on the last joint
    armature : (n,) kg m^2
    gravity : (3,) m/s^2
    tip_rotation, tip_place : (3, 3), (3,) m, of the tip in the last joint's frame
    rotation, place : (n, 3, 3), (n, 3) m, of the joint's frame in its parent's, in the last call
    spin, turning, rising : (n, 3) angular velocity and acceleration, and acceleration against free
        fall, in the joint's frame
    force, moment : (n, 3) on the joint
    """

    parent: np.ndarray
    turns: np.ndarray
    axes: np.ndarray
    rotations: np.ndarray
    places: np.ndarray
    mass: np.ndarray
    centre: np.ndarray
    inertia: np.ndarray
    probe: np.ndarray
    armature: np.ndarray
    gravity: np.ndarray
    tip_rotation: np.ndarray
    tip_place: np.ndarray
    rotation: np.ndarray
    place: np.ndarray
    spin: np.ndarray
    turning: np.ndarray
    rising: np.ndarray
    force: np.ndarray
    moment: np.ndarray


def rigid_chain(arm: pin.Model, tool: pin.Model, tip: str = "tcp") -> Chain:
    """Return the chain of an arm with a probe; `tool` has the same joints and its mass alone."""
    joints = range(1, arm.njoints)
    at = [arm.jointPlacements[j] for j in joints]
    frame = arm.frames[arm.getFrameId(tip)]

    parts = [arm.inertias[j] for j in joints]
    probe = tool.inertias[arm.njoints - 1]
    return Chain(
        np.array([arm.parents[j] - 1 for j in joints]),
        np.array(["Revolute" in arm.joints[j].shortname() for j in joints]),
        np.array([arm.joints[j].extract().axis for j in joints]),
        np.array([place.rotation for place in at]),
        np.array([place.translation for place in at]),
        np.array([part.mass for part in parts]),
        np.array([part.lever for part in parts]),
        np.array([part.inertia for part in parts]),
        np.r_[probe.mass, probe.lever],
        np.array(arm.armature),
        np.array(arm.gravity.linear),
        np.array(frame.placement.rotation),
        np.array(frame.placement.translation),
        np.zeros((arm.nv, 3, 3)),
        *np.zeros((6, arm.nv, 3)),
    )


@part
def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@part
def _plus(a, b):
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@part
def _scaled(s, a):
    return s * a[0], s * a[1], s * a[2]


@part
def _row(array, j):
    return array[j, 0], array[j, 1], array[j, 2]


@part
def _keep(array, j, v):
    array[j, 0], array[j, 1], array[j, 2] = v


@part
def _times(m, j, v):
    return (
        m[j, 0, 0] * v[0] + m[j, 0, 1] * v[1] + m[j, 0, 2] * v[2],
        m[j, 1, 0] * v[0] + m[j, 1, 1] * v[1] + m[j, 1, 2] * v[2],
        m[j, 2, 0] * v[0] + m[j, 2, 1] * v[1] + m[j, 2, 2] * v[2],
    )


@part
def _back(m, j, v):
    return (
        m[j, 0, 0] * v[0] + m[j, 1, 0] * v[1] + m[j, 2, 0] * v[2],
        m[j, 0, 1] * v[0] + m[j, 1, 1] * v[1] + m[j, 2, 1] * v[2],
        m[j, 0, 2] * v[0] + m[j, 1, 2] * v[1] + m[j, 2, 2] * v[2],
    )


@part
def _move(chain, j, angle):
    """Turn or slide a joint: its frame in its parent's."""
    axis, rotation, place = _row(chain.axes, j), chain.rotation, _row(chain.places, j)
    if chain.turns[j]:
        c, s = math.cos(angle), math.sin(angle)
        for k in range(3):  # Rodrigues, a row of the fixed rotation at a time
            row = (chain.rotations[j, k, 0], chain.rotations[j, k, 1], chain.rotations[j, k, 2])
            along = (1 - c) * (row[0] * axis[0] + row[1] * axis[1] + row[2] * axis[2])
            beside = _cross(row, axis)
            for i in range(3):
                rotation[j, k, i] = c * row[i] + along * axis[i] + s * beside[i]
    else:
        for k in range(3):
            for i in range(3):
                rotation[j, k, i] = chain.rotations[j, k, i]
        place = _plus(place, _scaled(angle, _times(chain.rotations, j, axis)))
    _keep(chain.place, j, place)


@part
def _turn(chain, q):
    """Fill in each joint's frame at a configuration."""
    for j in range(len(q)):
        _move(chain, j, q[j])


@part
def _accelerate(chain, v, a):
    """Fill in how each joint's frame moves; the frames are there."""
    gravity = chain.gravity
    for j in range(len(v)):
        axis, parent = _row(chain.axes, j), chain.parent[j]
        if parent < 0:
            spin = turning = (0.0, 0.0, 0.0)
            rising = (-gravity[0], -gravity[1], -gravity[2])
        else:
            place, spin = _row(chain.place, j), _row(chain.spin, parent)
            turning = _row(chain.turning, parent)
            bent = _plus(_cross(turning, place), _cross(spin, _cross(spin, place)))
            rising = _plus(_row(chain.rising, parent), bent)
            spin = _back(chain.rotation, j, spin)
            turning = _back(chain.rotation, j, turning)
        rising = _back(chain.rotation, j, rising)
        along, gains = _scaled(v[j], axis), _scaled(a[j], axis)
        if chain.turns[j]:
            turning = _plus(turning, _plus(gains, _cross(spin, along)))
            spin = _plus(spin, along)
        else:
            rising = _plus(rising, _plus(gains, _scaled(2.0, _cross(spin, along))))
        _keep(chain.spin, j, spin)
        _keep(chain.turning, j, turning)
        _keep(chain.rising, j, rising)


@part
def _needed(chain, j, mass, centre):
    """Force (3,) N that a body's acceleration and weight need, in its joint's frame."""
    spin, turning = _row(chain.spin, j), _row(chain.turning, j)
    bent = _plus(_cross(turning, centre), _cross(spin, _cross(spin, centre)))
    return _scaled(mass, _plus(_row(chain.rising, j), bent))


@compiled
def inverse_dynamics(chain, q, v, a, torque):
    """Put the joints' torques for an acceleration into (n,) N m; without damping."""
    _turn(chain, q)
    _accelerate(chain, v, a)
    for j in range(len(q)):
        centre, spin = _row(chain.centre, j), _row(chain.spin, j)
        force = _needed(chain, j, chain.mass[j], centre)
        moment = _cross(spin, _times(chain.inertia, j, spin))
        moment = _plus(moment, _times(chain.inertia, j, _row(chain.turning, j)))
        _keep(chain.force, j, force)
        _keep(chain.moment, j, _plus(moment, _cross(centre, force)))
    for j in range(len(q) - 1, -1, -1):
        axis, parent = chain.axes, chain.parent[j]
        force, moment = _row(chain.force, j), _row(chain.moment, j)
        along = moment if chain.turns[j] else force
        torque[j] = axis[j, 0] * along[0] + axis[j, 1] * along[1] + axis[j, 2] * along[2]
        torque[j] += chain.armature[j] * a[j]
        if parent >= 0:
            force, moment = _times(chain.rotation, j, force), _times(chain.rotation, j, moment)
            moment = _plus(moment, _cross(_row(chain.place, j), force))
            _keep(chain.force, parent, _plus(_row(chain.force, parent), force))
            _keep(chain.moment, parent, _plus(_row(chain.moment, parent), moment))


@part
def tool_force(chain, v, a):
    """Return the force that the probe's weight and inertia need, last joint's frame, N.

    The configuration is that of the last call of `inverse_dynamics`.
    """
    _accelerate(chain, v, a)
    probe = chain.probe
    return _needed(chain, len(v) - 1, probe[0], (probe[1], probe[2], probe[3]))


@part
def _product(a, b, c):
    """Put the product of (3, 3) `a` and `b` into `c`."""
    for i in range(3):
        for k in range(3):
            c[i, k] = a[i, 0] * b[0, k] + a[i, 1] * b[1, k] + a[i, 2] * b[2, k]


@compiled
def tip_poses(chain, q, places, rotations):
    """Put the tip's place (t, 3) m and rotation (t, 3, 3) in the world at configurations (t, n)."""
    turns = np.zeros((2, 3, 3))
    for t in range(len(q)):
        turns[0] = 0.0
        turns[0, 0, 0] = turns[0, 1, 1] = turns[0, 2, 2] = 1.0
        place, k = (0.0, 0.0, 0.0), 0
        for j in range(q.shape[1]):
            _move(chain, j, q[t, j])
            place = _plus(place, _times(turns, k, _row(chain.place, j)))
            _product(turns[k], chain.rotation[j], turns[1 - k])
            k = 1 - k
        tip = chain.tip_place
        _keep(places, t, _plus(place, _times(turns, k, (tip[0], tip[1], tip[2]))))
        _product(turns[k], chain.tip_rotation, rotations[t])
