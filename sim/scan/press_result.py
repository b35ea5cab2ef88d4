"""From the log of one press to the robot's report: rows of the scan, statistics, series.

Displacement is that of a real robot: noisy joint angles through the kinematics, along the
press direction, since first touch as found from the samples themselves (`sim.scan.first_touch`).
The encoders' noise is set so that its image along the press direction has the declared standard
deviation: sd_q = sd_d / |n' J|.
"""

# mujoco and pinocchio are compiled modules without type stubs
# pyright: reportAttributeAccessIssue=false, reportMissingImports=false
from __future__ import annotations

import numpy as np
import pinocchio as pin

from models import Scan
from sim.motion.planned_motion import PlannedPress
from sim.motion.scan_plan import ScanPlan
from sim.motion.settings import ScanSettings
from sim.robot.contact_coupling import PressedBody
from sim.robot.inverse_kinematics import TipKinematics
from sim.robot.mechanism import Mechanisms
from sim.scan.first_touch import FirstTouch, first_touch
from sim.scan.outcome import Judgement
from sim.scan.press_log import PressLog
from sim.scan.record_check import check_record, check_touch
from sim.scan.result import PHASES, PressResult, PressStatistics, Series
from sim.scan.touch_laws import Ball

SMOOTHED_S = 0.05
"""Over which the force is averaged before its overshoot is judged."""

REST_S = 0.1
"""Time at rest before the approach from which on samples tell where the tip touched."""

APPROACH, LOAD, HOLD, UNLOAD = map(PHASES.index, ("approach", "load", "hold", "unload"))


def press_result(
    log: PressLog,
    plan: ScanPlan,
    planned: PlannedPress,
    settings: ScanSettings,
    kinematics: TipKinematics,
    body: PressedBody,
    rng: np.random.Generator,
    mechanisms: Mechanisms,
) -> PressResult:
    """Reduce one press's log.

    Parameters
    ----------
    log : of the press
    plan, planned : of the scan and of this press
    settings : noise and sampling
    kinematics : of the tip
    body : whose own law the settled pairs are compared with
    rng : source of the encoders' noise
    mechanisms : tell from where the robot counts travel

    Raises
    ------
    PressFault
        Samples that cannot be right.
    """
    contact, wanted = np.flatnonzero(log.phase >= LOAD), plan.force_of(log.press)
    contact = contact[log.phase[contact] <= UNLOAD]
    step_s = float(log.time_s[1] - log.time_s[0])
    begun = int((log.phase == APPROACH).argmax())
    # At rest before the approach and on it: on the way there an unknown mass would show as a force
    before = int(contact[0]) - begun + min(round(REST_S / step_s), begun)
    read = np.arange(contact[0] - before, contact[-1] + 1)
    lever = np.linalg.norm(planned.direction @ kinematics.jacobian(planned.touch))
    noise = settings.displacement_noise_m / lever * rng.standard_normal(log.q[read].shape)
    tips, turns = kinematics.poses(log.q_read[read] + noise)
    depth = (tips - planned.point_m) @ planned.direction
    # row by row: probe axes -> world
    vectors = np.einsum("tij,tj->ti", turns, log.wrist_n[read])
    force = vectors @ planned.direction
    early = depth, force
    tips, turns, depth, vectors, force = (
        values[before:] for values in (tips, turns, depth, vectors, force)
    )
    check_record(log.clock_s[begun:], force, depth, wanted, settings)
    zero, touch_sd_m = mechanisms.zero_shift_m, 0.0
    if mechanisms.zero == "touch":
        touch = _touch(log, plan, read, *early, settings)
        check_touch(touch.depth_m, depth)
        zero, touch_sd_m = zero + touch.depth_m, touch.sd_m
    true_depth = (log.tip_m - planned.point_m) @ planned.direction
    rows = _sample_rows(log.phase[contact], settings)
    picked = contact[rows]
    scan = _scan(log, plan, picked, tips[rows], turns[rows], vectors[rows], depth[rows] - zero)
    displacement = np.full(len(log.time_s), np.nan)
    displacement[contact] = depth - zero
    series = Series(
        time_s=log.time_s,
        press=np.full(len(log.time_s), plan.ids[log.press]),
        phase=log.phase,
        force_n=log.wrist_n[:, 2],
        displacement_m=displacement,
        wanted_n=log.wanted_n,
        q=log.q,
        true_force_n=log.true_force_n,
        true_depth_m=true_depth,
    )
    statistics = _statistics(log, plan, planned, body, true_depth, zero)
    judged = _judged(
        log, contact, force, depth, tips, planned, wanted, touch_sd_m, settings.force_noise_n
    )
    truth = log.true_force_n[picked], true_depth[picked]
    return PressResult(statistics, scan, series, *truth, judged)


def _touch(
    log: PressLog,
    plan: ScanPlan,
    read: np.ndarray,
    depth_m: np.ndarray,
    force_n: np.ndarray,
    settings: ScanSettings,
) -> FirstTouch:
    """Return the first touch from depth and force (t,) at the samples `read` (t,) of a log."""
    tip = plan.tip_of(log.press)
    return first_touch(
        depth_m,
        force_n,
        log.wanted_n[read],
        np.maximum(log.phase[read] - LOAD + 1, 0),
        float(log.time_s[1] - log.time_s[0]),
        settings.displacement_noise_m,
        settings.force_noise_n,
        Ball(tip.radius_m, plan.thickness_m(log.press)) if tip.kind == "ball" else None,
    )


def _judged(
    log: PressLog,
    contact: np.ndarray,
    force_n: np.ndarray,
    depth_m: np.ndarray,
    tips_m: np.ndarray,
    planned: PlannedPress,
    wanted_n: float,
    touch_sd_m: float,
    force_noise_n: float,
) -> Judgement:
    """Return the quality of the press as the robot's own readings show it."""
    hold = np.flatnonzero(log.phase[contact] == HOLD)
    settled, end_n = hold[len(hold) // 2 :], float(log.wanted_n[contact][-1])
    mean = float(force_n[settled].mean())
    width = min(max(round(SMOOTHED_S / float(log.time_s[1] - log.time_s[0])), 1), len(force_n))
    smooth = np.convolve(force_n, np.full(width, 1 / width), "valid")
    # The largest of so many means is above the true force by their noise alone
    by_noise = force_noise_n / np.sqrt(width) * np.sqrt(2 * np.log(max(len(smooth) / width, 1)))
    away = (tips_m[settled] - planned.point_m).mean(axis=0)
    beside = away - (away @ planned.direction) * planned.direction
    return Judgement(
        force_n=mean,
        force_error=mean / wanted_n - 1,
        overshoot=float((smooth.max() - by_noise) / wanted_n - 1),
        place_error_m=float(np.linalg.norm(beside)),
        tare_n=log.tare_n,
        zero_after_n=log.zero_after_n,
        set_force_n=wanted_n,
        touch_sd_m=touch_sd_m,
        rise_m=_rise(log.phase[contact], depth_m, force_n, width),
        travel_m=float(np.ptp(depth_m)),
        end_share=float((force_n[-width:].mean() + 4 * force_noise_n / np.sqrt(width)) / end_n),
    )


def _rise(phase: np.ndarray, depth_m: np.ndarray, force_n: np.ndarray, size: int) -> float:
    """Return how much higher the tip stood on the way back under the same force, at most, m.

    Of means over `size` samples; creep and friction make it stand deeper.
    """

    def means(code: int) -> np.ndarray:
        rows = np.flatnonzero(phase == code)
        rows = rows[: len(rows) // size * size].reshape(-1, size)
        return np.array([force_n[rows].mean(axis=1), depth_m[rows].mean(axis=1)])

    load, unload = means(LOAD), means(UNLOAD)
    load = load[:, load[0].argsort()]
    common = unload[:, (unload[0] >= load[0, 0]) & (unload[0] <= load[0, -1])]
    higher = np.interp(common[0], *load) - common[1]
    return float(higher.max(initial=0.0))


def _sample_rows(phase: np.ndarray, settings: ScanSettings) -> np.ndarray:
    """Return the indices of the scan's rows: evenly over each phase, its end included."""
    rows = []
    for code, count in (
        (LOAD, settings.load_samples),
        (HOLD, settings.hold_samples),
        (UNLOAD, settings.unload_samples),
    ):
        of_phase = np.flatnonzero(phase == code)
        rows.append(of_phase[np.arange(1, count + 1) * len(of_phase) // count - 1])
    return np.concatenate(rows)


def _scan(
    log: PressLog,
    plan: ScanPlan,
    picked: np.ndarray,
    tips: np.ndarray,
    turns: np.ndarray,
    vectors: np.ndarray,
    displacement: np.ndarray,
) -> Scan:
    """Rows of the table, in the body frame."""
    count = len(picked)
    rotation = plan.body_in_world.rotation
    direction = plan.directions[log.press]
    position = (tips - np.asarray(plan.body_in_world.position_m)) @ rotation
    turned = [pin.Quaternion(rotation.T @ turn).coeffs() for turn in turns]  # x, y, z, w
    force = vectors @ rotation
    return Scan(
        press=np.full(count, plan.ids[log.press]),
        time_s=log.clock_s[picked],
        phase=np.array(PHASES)[log.phase[picked]],
        point_m=np.tile(plan.points_m[log.press], (count, 1)),
        direction=np.tile(direction, (count, 1)),
        force_n=force @ direction,
        displacement_m=displacement,
        probe_radius_m=np.full(count, plan.tip_of(log.press).radius_m),
        force_vector_n=force,
        tip_pose=np.hstack([position, np.roll(turned, 1, axis=1)]),
        outcome=np.full(count, log.outcome),
    )


def _statistics(
    log: PressLog,
    plan: ScanPlan,
    planned: PlannedPress,
    body: PressedBody,
    true_depth: np.ndarray,
    zero: float,
) -> PressStatistics:
    hold = np.flatnonzero(log.phase == HOLD)
    settled = hold[len(hold) // 2 :]
    force = log.true_force_n
    mean, wanted = float(force[settled].mean()), plan.force_of(log.press)
    outside = np.flatnonzero(np.abs(force[hold] / wanted - 1) > 0.01)
    last = outside[-1] + 1 if len(outside) else 0
    offset = log.tip_m[hold[-1]] - planned.point_m
    law = getattr(body, "displacement_at", lambda press, f, _: body.displacement(press, f))
    own = np.array([law(log.press, force[i], log.time_s[i]) for i in settled[::50]])
    step = float(log.time_s[1] - log.time_s[0])
    pressed = (log.phase >= LOAD) & (log.phase <= UNLOAD)  # not on the way to a slope
    return PressStatistics(
        press=int(plan.ids[log.press]),
        set_force_n=wanted,
        force_n=mean,
        force_error=mean / wanted - 1,
        overshoot=float(force.max() / wanted - 1),
        contact_error_m=float(
            np.linalg.norm(offset - (offset @ planned.direction) * planned.direction)
        ),
        settle_s=last * step,
        fem_calls=log.fem_calls,
        coupling_error=float(np.abs(true_depth[settled[::50]] / own - 1).max()),
        touch_error_m=zero,
        depth_share=float(true_depth[pressed].max()) / plan.thickness_m(log.press),
    )
