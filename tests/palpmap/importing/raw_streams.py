"""Raw streams of a made-up rig, drawn by seed.

Nothing here follows what the cutter assumes: the force comes from exponential, Hertzian or cubic
laws with relaxation over a broad spectrum and a smaller force on the way out; messages come at
uneven times, get lost, are repeated or come late; the clocks differ, the sensor drifts and is set
to zero anew, a tool hangs on it, the tip turns, dips without contact and touches twice.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from models.errors import InputError
from palpmap.importing.mapping.rig import parse_rig
from palpmap.importing.readers.recording import Recording, Table
from palpmap.importing.streams.alignment import UNSEEN_S
from palpmap.importing.streams.cutting import cut_stream

STEP = 5e-4
TAUS = np.geomspace(0.1, 20, 7)  # a body that relaxes faster cannot be told from a lag


@dataclass
class TruePress:
    touch_s: float  # physical time
    end_s: float
    point: np.ndarray
    direction: np.ndarray
    travel: float
    force: float
    hold: tuple[float, float]
    spoilt: str = ""


@dataclass
class RawStream:
    seed: int
    force_time: np.ndarray
    force: np.ndarray  # (m, 3), sensor's axes, N on the body
    pose_time: np.ndarray
    position: np.ndarray
    quaternion_xyzw: np.ndarray
    presses: list[TruePress]
    offset_s: float  # add to the pose's clock to get the force's, at the middle
    lag_s: float  # force's stamp less the physical time
    force_noise: float
    dips: int = 0
    soft: bool = False  # speeds without corners
    inside_m: np.ndarray = field(default_factory=lambda: np.zeros(0))  # true travel, each STEP
    normal_n: np.ndarray = field(default_factory=lambda: np.zeros(0))  # true force, each STEP
    pose_noise: float = 0.0
    notes: list[str] = field(default_factory=list)

    def to_force_clock(self, time: float) -> float:
        return time + self.lag_s

    def recording(self) -> Recording:
        """What reading the two files gives, up to rounding."""
        force = {"time_s": self.force_time}
        force |= dict(zip(("Fx_N", "Fy_N", "Fz_N"), self.force.T.copy(), strict=True))
        pose = {"t_s": self.pose_time}
        pose |= dict(zip(("x_mm", "y_mm", "z_mm"), 1e3 * self.position.T, strict=True))
        pose |= dict(zip(("qx", "qy", "qz", "qw"), self.quaternion_xyzw.T.copy(), strict=True))
        return Recording.of(
            [Table("ft", force, {}, lambda row: f"ft, row {row + 1}"),
             Table("pose", pose, {}, lambda row: f"pose, row {row + 1}")]
        )  # fmt: skip

    def write(self, folder: Path) -> list[Path]:
        """Two text files, as two loggers would leave them."""
        force, pose = folder / f"ft_{self.seed}.csv", folder / f"pose_{self.seed}.csv"
        np.savetxt(
            force, np.column_stack([self.force_time, self.force]), fmt="%.9g", delimiter=",",
            header="time_s,Fx_N,Fy_N,Fz_N", comments="",
        )  # fmt: skip
        np.savetxt(
            pose,
            np.column_stack([self.pose_time, 1e3 * self.position, self.quaternion_xyzw]),
            fmt="%.9g", delimiter=",", header="t_s,x_mm,y_mm,z_mm,qx,qy,qz,qw", comments="",
        )  # fmt: skip
        return [force, pose]


RIG = """
kind = "stream"

[force]
columns = ["Fx_N", "Fy_N", "Fz_N"]
unit = "N"
frame = "tip"
clock = {column = "time_s"}

[pose]
columns = ["x_mm", "y_mm", "z_mm"]
unit = "mm"
orientation = ["qx", "qy", "qz", "qw"]
clock = {column = "t_s"}
"""


def _ramp(distance: float, speed: float, smooth_motion: bool) -> np.ndarray:
    """Way along a line from 0 to distance, one value a step."""
    duration = max(distance / speed, 4 * STEP)
    t = np.arange(STEP, duration + STEP / 2, STEP) / duration
    if smooth_motion:
        return distance * (10 * t**3 - 15 * t**4 + 6 * t**5)
    share = 0.06  # of the time, to speed up and to slow down
    way = np.where(
        t < share, t**2 / (2 * share), np.where(t > 1 - share, 1 - share - (1 - t) ** 2 /
        (2 * share), t - share / 2),
    )  # fmt: skip
    return distance * way / (1 - share)


def draw(seed: int) -> RawStream:
    rng = np.random.default_rng([seed, 2911])
    count = int(rng.integers(6, 13))
    tilted = rng.random() < 0.5
    smooth_motion = rng.random() < 0.25
    speed = rng.uniform(1.5e-3, 6e-3)
    travel = rng.uniform(1.5e-3, 5e-3)
    clearance = rng.uniform(3e-3, 8e-3)
    hold_s = rng.uniform(0.3, 1.5)
    creep = rng.uniform(0, 0.1) if rng.random() < 0.4 else 0.0
    slope, bump = rng.uniform(-0.05, 0.05, 2), rng.uniform(0, 2e-3)
    law = rng.choice(["exponential", "hertz", "cubic"])
    relaxing, eaten = rng.uniform(0, 0.35), rng.uniform(0, 0.25)
    stiffness = rng.uniform(80, 400)  # N/m, at first
    dip_at = int(rng.integers(1, count)) if rng.random() < 0.3 else -1
    twice_at = int(rng.integers(0, count)) if rng.random() < 0.15 else -1

    position, angles, depth, presses, dips = [], [], [], [], 0
    spot = np.array([0.3, 0.1, 0.05])

    def surface(p: np.ndarray) -> float:
        return 0.02 + slope @ (p[:2] - spot[:2]) + bump * np.sin(60 * p[0]) * np.cos(50 * p[1])

    def go(points: np.ndarray, turn: np.ndarray, inside: np.ndarray | float = 0.0) -> None:
        position.append(points)
        angles.append(np.broadcast_to(turn, (len(points), 3)))
        depth.append(np.broadcast_to(inside, len(points)))

    turn = np.zeros(3)
    here = spot.copy()
    for j in range(count):
        place = spot + np.array([0.008 * (j % 4), 0.008 * (j // 4), 0])
        contact = np.array([place[0], place[1], surface(place)])
        new_turn = rng.uniform(-0.2, 0.2, 3) * [1, 1, 0.5] if tilted else turn
        direction = Rotation.from_rotvec(new_turn).apply([0, 0, -1.0])
        above = contact - clearance * direction
        way = np.linalg.norm(above - here)
        steps = _ramp(1.0, 0.02 / max(way, 2e-3), True)
        go(here + np.outer(steps, above - here), turn + np.outer(steps, new_turn - turn))
        turn = new_turn
        go(np.repeat(above[None], int(rng.uniform(0.1, 0.6) / STEP), 0), turn)
        if j == dip_at:
            down = _ramp(0.7 * clearance, speed, smooth_motion)
            dips += 1
            for way_ in (down, down[::-1]):
                go(above + np.outer(way_, direction), turn)
        into = travel * rng.uniform(0.8, 1.2)
        for again in range(2 if j == twice_at else 1):
            down = _ramp(clearance + into, speed, smooth_motion)
            if again:  # up from the surface by a third of the clearance only, and in once more
                down = clearance * 0.7 + _ramp(0.3 * clearance + into, speed, smooth_motion)
            start = STEP * sum(map(len, depth))
            go(above + np.outer(down, direction), turn, down - clearance)
            touch = start + STEP * float(np.searchsorted(down, clearance))
            held = into * (1 + creep * (1 - np.exp(-np.arange(int(hold_s / STEP)) * STEP / 0.5)))
            hold_start = STEP * sum(map(len, depth))
            go(above + np.outer(clearance + held, direction), turn, held)
            hold_end = STEP * sum(map(len, depth))
            if j == twice_at and not again:
                up = clearance + held[-1] - _ramp(0.3 * clearance + held[-1], speed, smooth_motion)
            else:
                up = (
                    clearance
                    + held[-1]
                    - _ramp(clearance + held[-1], speed * rng.uniform(1, 2), smooth_motion)
                )
            start = STEP * sum(map(len, depth))
            go(above + np.outer(up, direction), turn, up - clearance)
            release = start + STEP * float(np.sum(up > clearance))
            presses.append(
                TruePress(touch, release, contact, direction, float(held[-1]), 0.0,
                          (hold_start, hold_end), "twice" if j == twice_at else "")
            )  # fmt: skip
        here = above
        go(np.repeat(here[None], int(rng.uniform(0.1, 0.9) / STEP), 0), turn)
    path, turns = np.concatenate(position), np.concatenate(angles)
    inside = np.maximum(np.concatenate(depth), 0.0)
    time = STEP * np.arange(len(path))
    normal = _normal_force(rng, inside, presses, time, law, stiffness, travel, relaxing, eaten)
    rotation = Rotation.from_rotvec(turns)
    along = rotation.apply([0, 0, -1.0])
    on_body = normal[:, None] * along
    mass, bias = rng.uniform(0.0, 0.4), rng.uniform(-2, 2, 3)
    measured = rotation.inv().apply(on_body + np.array([0, 0, mass * 9.81])) + bias
    for press in presses:
        during = (time >= press.touch_s) & (time <= press.end_s)
        press.force = float(normal[during].max())
    stream = _sampled(rng, seed, time, measured, path, rotation, presses, dips)
    stream.soft = smooth_motion
    stream.inside_m, stream.normal_n = inside, normal
    return stream


def _normal_force(rng, inside, presses, time, law, stiffness, travel, relaxing, eaten):
    x = inside
    if law == "exponential":
        a = rng.uniform(100, 350)
        elastic = stiffness / a * (np.exp(a * x) - 1)
    elif law == "hertz":
        elastic = 1.5 * stiffness * x**1.5 / np.sqrt(travel)
    else:
        elastic = stiffness * x * (1 + 0.6 * (x / travel) ** 2)
    force = (1 - relaxing) * elastic
    places = np.unique([press.point for press in presses], axis=0)
    for place in places:  # each place rests until it is pressed
        here = [press for press in presses if np.array_equal(press.point, place)]
        rows = (time >= here[0].touch_s - 0.01) & (time <= here[-1].end_s + 0.01)
        rate = np.diff(elastic[rows], prepend=0.0)
        for tau in TAUS:
            past = lfilter([1.0], [1.0, -np.exp(-STEP / tau)], rate)
            force[rows] += relaxing / len(TAUS) * past
    soft = np.ones(len(x))
    for press in presses:
        out = (time >= press.hold[1]) & (time <= press.end_s + 0.5)
        share = inside[out] / press.travel
        soft[out] = 1 - eaten * (1 - share) * share * 2
        during = (time >= press.touch_s - 0.01) & (time <= press.end_s + 0.01)
        soft[during] *= rng.uniform(0.7, 1.4)
    force = np.maximum(force * soft, 0.0)
    return np.where(inside > 0, force, 0.0)


def _sampled(rng, seed, time, measured, path, rotation, presses, dips) -> RawStream:
    duration = time[-1]
    lag = rng.uniform(-0.03, 0.06)
    apart = rng.random() < 0.35
    offset, rate = (rng.uniform(-900, 900), rng.uniform(-6e-5, 6e-5)) if apart else (0.0, 0.0)
    stream = RawStream(seed, *[None] * 5, presses, 0.0, lag, 0.0, dips)

    def times(hz: float) -> np.ndarray:
        t = np.arange(0.05, duration - 0.05, 1 / hz)
        t = t + rng.uniform(-0.25, 0.25, len(t)) / hz  # jitter of the sampling, stamped rightly
        t = t[rng.random(len(t)) > rng.choice([0.0, 0.01, 0.03])]
        for _ in range(rng.integers(0, 3)):  # a burst is lost
            start, length = rng.uniform(0, duration), rng.uniform(0.02, 0.2)
            for press in presses:
                overlap = min(start + length, press.end_s) - max(start, press.touch_s)
                if overlap > 0.015:
                    press.spoilt = press.spoilt or "gap"
            t = t[(t < start) | (t > start + length)]
        return np.sort(t)

    hz = rng.uniform(150, 1000)
    tf, tp = times(hz), times(rng.uniform(60, 500))
    noise = rng.uniform(0.002, 0.012)
    force = np.column_stack([np.interp(tf, time, c) for c in measured.T])
    force += noise * rng.standard_normal(force.shape)
    drift = rng.uniform(-3e-4, 3e-4, 3) if rng.random() < 0.5 else np.zeros(3)
    force += np.outer(tf, drift) + rng.uniform(0, 0.01) * np.sin(tf[:, None] / 17 + [0, 1, 2])
    for _ in range(rng.integers(0, 3)):  # set to zero anew
        at = rng.uniform(1.0, duration)
        force[tf >= at] -= rng.uniform(-1, 1, 3)
        for press in presses:
            if press.touch_s - 0.1 < at < press.end_s + 0.1:
                press.spoilt = press.spoilt or "re-tare"
    position = np.column_stack([np.interp(tp, time, c) for c in path.T])
    stream.pose_noise = rng.uniform(3e-6, 2.5e-5)
    position += stream.pose_noise * rng.standard_normal(position.shape)
    nearest = np.clip(np.round(tp / STEP).astype(int), 0, len(time) - 1)
    quaternion = rotation[nearest].as_quat()
    quaternion *= rng.choice([-1, 1])
    stamp_f, stamp_p = tf + lag, tp * (1 + rate) - offset
    middle = duration / 2
    stream.offset_s = middle + lag - (middle * (1 + rate) - offset)
    for _ in range(rng.integers(0, 4)):  # repeated messages
        i = int(rng.integers(0, len(stamp_f)))
        stamp_f = np.insert(stamp_f, i, stamp_f[i])
        force = np.insert(force, i, force[i], axis=0)
    for _ in range(rng.integers(0, 3)):  # two messages change places
        i = int(rng.integers(0, len(stamp_p) - 1))
        for array in (stamp_p, position, quaternion):
            array[[i, i + 1]] = array[[i + 1, i]]
    stream.force_time, stream.force = stamp_f, force
    stream.pose_time, stream.position, stream.quaternion_xyzw = stamp_p, position, quaternion
    stream.force_noise = noise
    return stream


def lag_bound(stream: RawStream) -> float:
    """Least standard deviation in s of any unbiased estimate of the lag (Cramer-Rao).

    Unknown are a law of each press, up to the fourth power of the travel and of the way out, and
    the weights of the seven rates of relaxation, the same for all presses. As the touch is unknown
    too, readings at less than 7 % of the travel, and within 30 ms of that, say nothing. The noise
    is that of the force, and that of the pose times the stiffness, each by its rate of messages.
    """
    per_force, per_pose = (
        float(np.median(np.diff(np.sort(time)))) for time in (stream.force_time, stream.pose_time)
    )
    total = np.zeros((1 + len(TAUS), 1 + len(TAUS)))
    for press in stream.presses:
        if press.spoilt:
            continue
        first, hold, out = (int(t / STEP) for t in (press.touch_s, press.hold[0], press.hold[1]))
        rows = slice(first, int(press.end_s / STEP))
        x, force = stream.inside_m[rows] / press.travel, stream.normal_n[rows]
        law = np.polyfit(x[: hold - first], force[: hold - first], 4)
        stiffness = np.polyval(np.polyder(law), x) / press.travel
        density = (
            stream.force_noise**2 * per_force + (stiffness * stream.pose_noise) ** 2 * per_pose
        )
        deep = np.flatnonzero(x > 0.07)
        used = np.zeros(len(x), dtype=bool)
        used[deep[0] + int(0.03 / STEP) : deep[-1] - int(0.03 / STEP)] = True
        weight = (np.sqrt(STEP / density) * used)[:, None]
        back = np.zeros(len(x))
        back[out - first :] = np.maximum(x[: out - first].max() - x[out - first :], 0.0)
        free = np.column_stack(
            [np.ones(len(x)), *(x**p for p in (1, 1.5, 2, 3, 4)), *(back**p for p in (1, 2, 3, 4))]
        )
        rate = np.diff(np.polyval(law, x), prepend=0.0)
        past = [lfilter([1.0], [1.0, -np.exp(-STEP / tau)], rate) for tau in TAUS]
        shared = np.column_stack([np.gradient(force, STEP), *past]) * weight
        q, _ = np.linalg.qr(free * weight)
        shared -= q @ (q.T @ shared)
        total += shared.T @ shared
    scale = np.sqrt(np.diag(total))
    return float(
        np.sqrt(np.linalg.pinv(total / np.outer(scale, scale), rcond=1e-12)[0, 0]) / scale[0]
    )


@dataclass(frozen=True)
class Outcome:
    """What the import made of a stream.

    A press counts as right if its touch, travel, force, direction and hold are within tolerance,
    the touch or within four times its stated standard deviation, and its rows are all in contact.
    Wrong are also all presses of a refused stream, and good ones that were left out.
    """

    seed: int
    presses: int
    refused: str
    silent: list[str]  # errors that nothing warns of
    lost: list[str]  # good presses left out, with a reason
    off_s: float  # error of the lag
    stated_s: float  # its standard deviation as stated
    seen: bool  # a press shows the lag
    sharp: bool  # the tip stops sharply, as the import sees it
    bound_s: float

    @property
    def wrong(self) -> int:
        """Number of presses that are not right."""
        one_each = {sentence.split(":")[0] for sentence in self.silent}
        return self.presses if self.refused else len(self.lost) + len(one_each)


def outcome(seed: int) -> Outcome:
    """Import the stream of a seed and compare it with the truth."""
    stream = draw(seed)
    bound, count = lag_bound(stream), len(stream.presses)
    try:
        cut = cut_stream(stream.recording(), parse_rig(RIG, Path("rig.toml")))
    except InputError as error:
        return Outcome(seed, count, str(error), [], [], np.inf, np.inf, False, False, bound)
    silent, lost = faults(stream, cut)
    lag = cut.streams.lag
    off = cut.streams.offset_s + (lag.lag_s if lag else 0.0) - stream.offset_s
    stated, sharp = (lag.error_s, lag.has_corners) if lag else (UNSEEN_S, False)
    return Outcome(
        seed,
        count,
        "",
        silent,
        lost,
        float(off),
        float(stated),
        lag is not None,
        bool(sharp),
        bound,
    )


def faults(stream: RawStream, cut) -> tuple[list[str], list[str]]:
    """Silent errors, and presses lost although nothing was wrong with them."""
    silent, lost = [], []
    left = [time for time, _ in cut.left_out]
    taken = set()
    for press in stream.presses:
        touch, end = stream.to_force_clock(press.touch_s), stream.to_force_clock(press.end_s)
        near = [
            k
            for k, found in enumerate(cut.presses)
            if k not in taken and abs(found.touch_s - touch) < 0.3
        ]
        if not near:
            said = any(touch - 3.0 < time < end + 3.0 for time in left)
            if not said:
                silent.append(f"press at {touch:.2f} s is missing")
            elif not press.spoilt:
                lost.append(f"press at {touch:.2f} s was left out")
            continue
        k = near[0]
        taken.add(k)
        silent += _press_faults(stream, press, cut.presses[k], cut.streams.lag_error_s)
    silent += [f"press at {cut.presses[k].touch_s:.2f} s does not exist"
               for k in range(len(cut.presses)) if k not in taken]  # fmt: skip
    return silent, lost


def _press_faults(stream: RawStream, press: TruePress, found, lag_error_s: float) -> list[str]:
    wrong = []

    def check(what: str, error: float, allowed: float) -> None:
        if not abs(error) <= allowed:
            wrong.append(
                f"press at {found.touch_s:.2f} s: {what} off by {error:.3g} > {allowed:.3g}"
            )

    where = (found.point_m - press.point) @ press.direction
    last = int(np.sum(found.phase == "load")) - 1
    late = lag_error_s * found.displacement_m[last] / (found.time_s[last] - found.touch_s)
    known = max(1e-4, 0.05 * press.travel, 4 * float(np.hypot(found.touch_error_m, late)))
    check("touch, m", where, known)
    beside = np.linalg.norm(found.point_m - press.point - where * press.direction)
    check("place beside, m", beside, 3e-4)
    check("travel, m", found.displacement_m.max() - press.travel, known)
    check(
        "force, N", found.force_n.max() - press.force, 0.03 * press.force + 3 * stream.force_noise
    )
    turned = np.degrees(np.arccos(np.clip(found.direction @ press.direction, -1, 1)))
    check("direction, degrees", turned, 1.5)
    if stream.normal_n[int((found.time_s[-1] - stream.lag_s) / STEP)] <= 0:
        wrong.append(f"press at {found.touch_s:.2f} s: its last row is out of contact")
    hold = found.time_s[found.phase == "hold"]
    ramp = press.hold[0] - press.touch_s
    check("begin of hold, s", hold[0] - stream.to_force_clock(press.hold[0]),
          (0.5 if stream.soft else 0.25) * ramp + (press.hold[1] - press.hold[0]) / 6)  # fmt: skip
    check(
        "end of hold, s",
        hold[-1] - stream.to_force_clock(press.hold[1]),
        0.1 + (0.4 if stream.soft else 0.1) * ramp,
    )
    return wrong
