"""A laboratory scan played back as the raw stream of a robot: one MCAP file of wrench and pose."""

from pathlib import Path

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from scipy.interpolate import PchipInterpolator

from models.scan import Scan

START_NS = 1_760_000_000_000_000_000
BASE_M = np.array([0.45, -0.10, 0.02])  # where the body's corner stands in the robot's frame
LAG_S = 0.012
FREE_S, MOVE_S = 1.6, 0.5
RIG = """
[probe]
tip = "flat"
radius_m = 0.005

[body]
shape = "block"
size_m = [0.096, 0.096, 0.048]
origin_m = [0.45, -0.10, 0.02]
poisson_ratio = 0.49

[map]
inclusions = 1
"""


def streams(scan: Scan, hz: float = 250.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time in s, force on the body (m, 3) and tip (m, 3) in the robot's frame, noiseless."""
    times, depths, forces, places = [], [], [], []
    start = 0.0
    for press in scan.press_ids:
        rows = scan.press == press
        t = scan.time_s[rows]
        t = t - 2 * t[0] + t[1]  # the first reading is one step after the touch
        speed_in = scan.displacement_m[rows][0] / t[0]
        speed_out = speed_in * 1.5
        deepest_free = max(scan.displacement_m[rows][-1], 0.0)  # a viscous body stays behind
        away = t[-1] + deepest_free / speed_out + 1e-3
        t = np.concatenate([[-FREE_S, 0.0], t, [away, away + FREE_S]])
        d = np.concatenate([[-FREE_S * speed_in, 0.0], scan.displacement_m[rows],
                            [0.0, -FREE_S * speed_out]])  # fmt: skip
        f = np.concatenate([[0.0, 0.0], scan.force_n[rows][:-1], np.zeros(3)])
        fine = np.arange(t[0], t[-1], 1 / hz)
        times.append(start + fine - t[0])
        depths.append(np.interp(fine, t, d))
        forces.append(np.interp(fine, t, f))
        places.append(np.tile(scan.point_m[rows][0], (len(fine), 1)))
        start += fine[-1] - fine[0] + MOVE_S
    path = [BASE_M + p - d[:, None] * [0, 0, 1.0] for p, d in zip(places, depths, strict=True)]
    time = np.arange(0.0, times[-1][-1], 1 / hz)
    known = np.concatenate(times)
    smooth = PchipInterpolator(known, np.concatenate(path), axis=0)
    force = np.interp(time, known, np.concatenate(forces))
    return time, force[:, None] * np.array([0, 0, -1.0]), smooth(time)


def write_mcap(scan: Scan, path: Path) -> None:
    """Write the stream as a folder with one MCAP file; the sensor is biased and reads late."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    types = store.types
    rng = np.random.default_rng(3)
    time, force, tip = streams(scan)
    force = force + [0.7, -1.1, 2.3] + 0.003 * rng.standard_normal(force.shape)
    tip = tip + 5e-6 * rng.standard_normal(tip.shape)

    def header(ns: int, frame: str):
        stamp = types["builtin_interfaces/msg/Time"](sec=ns // 10**9, nanosec=ns % 10**9)
        return types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)

    vector, point = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Point"]
    turned = types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0)
    zero = vector(x=0.0, y=0.0, z=0.0)
    wrench, pose = "geometry_msgs/msg/WrenchStamped", "geometry_msgs/msg/PoseStamped"
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        ft = writer.add_connection("/ft_sensor/wrench", wrench, typestore=store)
        tcp = writer.add_connection("/tcp_pose", pose, typestore=store)
        for t, f, p in zip(time, force, tip, strict=True):
            ns = START_NS + round(1e9 * t)
            message = types[pose](
                header=header(ns, "base_link"),
                pose=types["geometry_msgs/msg/Pose"](
                    position=point(x=p[0], y=p[1], z=p[2]), orientation=turned
                ),
            )
            writer.write(tcp, ns, store.serialize_cdr(message, pose))
            late = ns + round(1e9 * LAG_S)
            on_body = types["geometry_msgs/msg/Wrench"](
                force=vector(x=f[0], y=f[1], z=f[2]), torque=zero
            )
            message = types[wrench](header=header(late, "base_link"), wrench=on_body)
            writer.write(ft, late, store.serialize_cdr(message, wrench))
