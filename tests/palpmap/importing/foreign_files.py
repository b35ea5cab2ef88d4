"""One scan as thirteen rigs would have written it, each with its mapping."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
import openpyxl
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore
from scipy.io import savemat

from models.scan import Scan

BODY = """
[probe]
tip = "flat"
radius_m = 0.005

[body]
shape = "block"
size_m = [0.096, 0.096, 0.048]
poisson_ratio = 0.49
support = "base-bonded"

[noise]
displacement_m = 2.0e-5
force_n = 5.0e-3

[map]
inclusions = 1
"""
START_NS = 1_760_000_000_123_456_789


@dataclass(frozen=True)
class Foreign:
    name: str
    files: tuple[Path, ...]
    rig: str


def num(value: float) -> str:
    return repr(float(value))


def comma(value: float) -> str:
    return num(value).replace(".", ",")


def csv_german(scan: Scan, folder: Path) -> Foreign:
    names = {"load": "Belasten", "hold": "Halten", "unload": "Entlasten"}
    lines = ["Messung am Phantom; Prüfer: Ö. Müller", "Datum;24.11.2026", "",
             "Kontakt;Zeit [s];Phase;X [mm];Y [mm];Z [mm];Kraft [N];Weg [µm];"]  # fmt: skip
    for i in range(len(scan)):
        x, y, z = 1e3 * scan.point_m[i]
        lines.append(
            f"{scan.press[i] + 1};{comma(scan.time_s[i])};{names[scan.phase[i]]};{comma(x)};"
            f"{comma(y)};{comma(z)};{comma(scan.force_n[i])};{comma(1e6 * scan.displacement_m[i])};"
        )
    path = folder / "german.csv"
    path.write_bytes("\r\n".join(lines).encode("cp1252"))
    return Foreign("csv_german", (path,), """
kind = "readings"
time = {column = "Zeit [s]", unit = "s"}
force = {column = "Kraft [N]", unit = "N"}
travel = {column = "Weg [µm]", unit = "um"}
point = {columns = ["X [mm]", "Y [mm]", "Z [mm]"], unit = "mm"}

[press]
number = "Kontakt"
phase = "Phase"
phases = {Belasten = "load", Halten = "hold", Entlasten = "unload"}
direction = [0, 0, -1]
""")  # fmt: skip


def csv_tab_units_row(scan: Scan, folder: Path) -> Foreign:
    lines = ["no\tt\tph\tpx\tpy\tpz\tF\td", "\tms\t-\tcm\tcm\tcm\tmN\tmm"]
    for i in range(len(scan)):
        x, y, z = 1e2 * scan.point_m[i]
        code = ["load", "hold", "unload"].index(scan.phase[i])
        lines.append(
            f"{scan.press[i]}\t{num(1e3 * scan.time_s[i])}\t{code}\t{num(x)}\t{num(y)}\t{num(z)}\t"
            f"{num(1e3 * scan.force_n[i])}\t{num(1e3 * scan.displacement_m[i])}"
        )
    path = folder / "tabs.txt"
    path.write_text("\n".join(lines), encoding="utf-16")
    return Foreign("csv_tab_units_row", (path,), """
kind = "readings"
time = {column = "t", unit = "ms"}
force = {column = "F", unit = "mN"}
travel = {column = "d", unit = "mm"}
point = {columns = ["px", "py", "pz"], unit = "cm"}

[press]
number = "no"
phase = "ph"
phases = {0 = "load", 1 = "hold", 2 = "unload"}
direction = [0, 0, -1]
""")  # fmt: skip


def csv_no_header(scan: Scan, folder: Path) -> Foreign:
    lines = ["% force gauge, 9 columns: no t ph x y z nz F d"]
    for i in range(len(scan)):
        x, y, z = scan.point_m[i]
        code = ["load", "hold", "unload"].index(scan.phase[i])
        lines.append(
            f"  {scan.press[i]}  {num(scan.time_s[i])} {code}  {num(x)} {num(y)} {num(z)} -1 "
            f" {num(scan.force_n[i] / 9.80665e-3)} {num(scan.displacement_m[i])}"
        )
    path = folder / "bare.dat"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return Foreign("csv_no_header", (path,), """
kind = "readings"
time = {column = "column_2", unit = "s"}
force = {column = "column_8", unit = "g"}
travel = {column = "column_9", unit = "m"}
point = {columns = ["column_4", "column_5", "column_6"], unit = "m"}

[press]
number = "column_1"
phase = "column_3"
phases = {0 = "load", 1 = "hold", 2 = "unload"}
direction = [0, 0, -1]
""")  # fmt: skip


def csv_turned_round(scan: Scan, folder: Path) -> Foreign:
    """Force on the tip and height of the tip: both fall while the robot presses."""
    lines = ['"press","phase","time/s","x/mm","y/mm","z/mm","Fx (N)","Fy (N)","Fz (N)","height/mm"']
    for i in range(len(scan)):
        x, y, z = 1e3 * scan.point_m[i]
        lines.append(
            f'{scan.press[i]},"{scan.phase[i].upper()}",{num(scan.time_s[i] + 1.76e9)},'
            f"{num(x)},{num(y)},{num(z)},0.0,0.0,{num(scan.force_n[i])},"
            f"{num(-1e3 * scan.displacement_m[i])}"
        )
    path = folder / "turned.csv"
    path.write_text("\n".join(lines), encoding="utf-8-sig")
    return Foreign("csv_turned_round", (path,), """
kind = "readings"
time = {column = "time/s", unit = "s"}
force = {columns = ["Fx (N)", "Fy (N)", "Fz (N)"], unit = "N", sign = -1}
travel = {column = "height/mm", unit = "mm", sign = -1}
point = {columns = ["x/mm", "y/mm", "z/mm"], unit = "mm"}
press = {number = "press", phase = "phase", direction = [0, 0, -1]}
""")  # fmt: skip


def csv_bars_dates(scan: Scan, folder: Path) -> Foreign:
    start = np.datetime64("2026-11-24T10:00:00", "us")
    lines = ["when|press|phase|x_mm|y_mm|z_mm|nx|ny|nz|force_N|travel_mm|radius_mm|operator"]
    for i in range(len(scan)):
        when = start + np.timedelta64(round(1e6 * scan.time_s[i]), "us")
        x, y, z = 1e3 * scan.point_m[i]
        nx, ny, nz = scan.direction[i]
        lines.append(
            f"{when}|{scan.press[i]}|{scan.phase[i]}|{num(x)}|{num(y)}|{num(z)}|{num(nx)}|{num(ny)}|{num(nz)}|"
            f"{num(scan.force_n[i])}|{num(1e3 * scan.displacement_m[i])}|"
            f"{num(1e3 * scan.probe_radius_m[i])}|A. N. Other"
        )
    path = folder / "bars.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    return Foreign("csv_bars_dates", (path,), """
kind = "readings"
time = {column = "when", unit = "s"}
force = {column = "force_N", unit = "N"}
travel = {column = "travel_mm", unit = "mm"}
point = {columns = ["x_mm", "y_mm", "z_mm"], unit = "mm"}
radius = {column = "radius_mm", unit = "mm"}
press = {number = "press", phase = "phase", direction = ["nx", "ny", "nz"]}
""")  # fmt: skip


def csv_file_a_press(scan: Scan, folder: Path) -> Foreign:
    paths = []
    for press in scan.press_ids:
        rows = np.flatnonzero(scan.press == press)
        lines = ["time [s];phase;x [m];y [m];z [m];F [kN];d [m]"]
        for i in rows:
            x, y, z = scan.point_m[i]
            lines.append(
                f"{comma(scan.time_s[i])};{scan.phase[i]};{comma(x)};{comma(y)};{comma(z)};"
                f"{comma(1e-3 * scan.force_n[i])};{comma(scan.displacement_m[i])}"
            )
        paths.append(folder / f"press_{press:03d}.csv")
        paths[-1].write_text("\n".join(lines), encoding="utf-8")
    return Foreign("csv_file_a_press", tuple(paths), """
kind = "readings"
time = {column = "time [s]", unit = "s"}
force = {column = "F [kN]", unit = "kN"}
travel = {column = "d [m]", unit = "m"}
point = {columns = ["x [m]", "y [m]", "z [m]"], unit = "m"}
press = {number = "part", phase = "phase", direction = [0, 0, -1]}
""")  # fmt: skip


def excel(scan: Scan, folder: Path) -> Foreign:
    book = openpyxl.Workbook()
    book.active.title = "About"
    book.active["A1"] = "Phantom 3"
    sheet = book.create_sheet("Data")
    sheet.append(["Run of 24 November"])
    sheet.append(["Press", "Time", "Phase", "X", "Y", "Z", "Force", "Travel"])
    sheet.append(["-", "s", "-", "mm", "mm", "mm", "N", "mm"])
    for i in range(len(scan)):
        sheet.append(
            [int(scan.press[i]), float(scan.time_s[i]), str(scan.phase[i]),
             *(1e3 * scan.point_m[i]).tolist(), float(scan.force_n[i]),
             1e3 * float(scan.displacement_m[i])]
        )  # fmt: skip
    path = folder / "book.xlsx"
    book.save(path)
    return Foreign("excel", (path,), """
kind = "readings"
time = {column = "Time", unit = "s"}
force = {column = "Force", unit = "N"}
travel = {column = "Travel", unit = "mm"}
point = {columns = ["X", "Y", "Z"], unit = "mm"}
press = {number = "Press", phase = "Phase", direction = [0, 0, -1]}
""")  # fmt: skip


_ARRAYS_RIG = """
kind = "readings"
time = {column = "t", unit = "s"}
force = {columns = ["force[0]", "force[1]", "force[2]"], unit = "N"}
travel = {column = "depth_mm", unit = "mm"}
point = {columns = ["contact[0]", "contact[1]", "contact[2]"], unit = "mm"}

[press]
number = "id"
phase = "phase"
phases = {1 = "load", 2 = "hold", 3 = "unload"}
direction = [0, 0, -1]
"""


def _arrays(scan: Scan) -> dict[str, np.ndarray]:
    return {
        "t": scan.time_s,
        "id": scan.press.astype(float),
        "phase": np.array([["load", "hold", "unload"].index(p) + 1.0 for p in scan.phase]),
        "force": scan.force_n[:, None] * scan.direction,
        "contact": 1e3 * scan.point_m,
        "depth_mm": 1e3 * scan.displacement_m,
    }


def matlab_5(scan: Scan, folder: Path) -> Foreign:
    path = folder / "v5.mat"
    savemat(path, {"run": _arrays(scan), "operator": "A. N. Other", "gain": 3.0})
    return Foreign("matlab_5", (path,), _ARRAYS_RIG)


def matlab_73(scan: Scan, folder: Path) -> Foreign:
    path = folder / "v73.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        group = file.create_group("run")
        for name, array in _arrays(scan).items():  # MATLAB's arrays lie transposed, vectors too
            group[name] = np.atleast_2d(array) if array.ndim == 1 else array.T
            group[name].attrs["MATLAB_class"] = np.bytes_("double")
        file["operator"] = np.array([[ord(c)] for c in "A. N. Other"], dtype=np.uint16)
        file["operator"].attrs["MATLAB_class"] = np.bytes_("char")
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    return Foreign("matlab_73", (path,), _ARRAYS_RIG)


def hdf5_group_a_press(scan: Scan, folder: Path) -> Foreign:
    path = folder / "groups.h5"
    with h5py.File(path, "w") as file:
        for press in scan.press_ids:
            rows = scan.press == press
            group = file.create_group(f"presses/press_{press:03d}")
            group["wrench"] = scan.force_n[rows]
            group["wrench"].attrs["unit"] = "N"
            group["tip"] = scan.point_m[rows]
            group["travel"] = scan.displacement_m[rows]
            group["clock"] = scan.time_s[rows]
            group["phase"] = scan.phase[rows].astype("S")
    return Foreign("hdf5_group_a_press", (path,), """
kind = "readings"
time = {column = "clock", unit = "s"}
force = {column = "wrench", unit = "N"}
travel = {column = "travel", unit = "m"}
point = {columns = ["tip[0]", "tip[1]", "tip[2]"], unit = "m"}
press = {number = "part", phase = "phase", direction = [0, 0, -1]}
""")  # fmt: skip


_BAG_RIG = """
kind = "readings"
time = {column = "stamp"}
force = {columns = ["/ft:wrench.force.x", "/ft:wrench.force.y", "/ft:wrench.force.z"], unit = "N"}
travel = {column = "/travel:data", unit = "m"}
point = {columns = ["/contact:point.x", "/contact:point.y", "/contact:point.z"], unit = "m"}
press = {number = "/press:data", phase = "/phase:data", direction = [0, 0, -1]}
"""


def _messages(scan: Scan, store, ros1: bool):
    """Topic, type, time in ns and message, in the order of time."""
    types = store.types

    def header(ns: int):
        stamp = types["builtin_interfaces/msg/Time"](sec=ns // 10**9, nanosec=ns % 10**9)
        more = {"seq": 0} if ros1 else {}
        return types["std_msgs/msg/Header"](stamp=stamp, frame_id="base", **more)

    vector, point = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Point"]
    zero = vector(x=0.0, y=0.0, z=0.0)
    for i in range(len(scan)):
        ns = START_NS + round(1e9 * scan.time_s[i])
        if i == 0 or scan.press[i] != scan.press[i - 1]:
            kind = "std_msgs/msg/Int32"
            yield "/press", kind, ns, types[kind](data=int(scan.press[i]))
        if i == 0 or scan.phase[i] != scan.phase[i - 1]:
            kind = "std_msgs/msg/String"
            yield "/phase", kind, ns, types[kind](data=str(scan.phase[i]))
        kind = "geometry_msgs/msg/WrenchStamped"
        fx, fy, fz = (float(f) for f in scan.force_n[i] * scan.direction[i])
        wrench = types["geometry_msgs/msg/Wrench"](force=vector(x=fx, y=fy, z=fz), torque=zero)
        yield "/ft", kind, ns, types[kind](header=header(ns), wrench=wrench)
        kind = "geometry_msgs/msg/PointStamped"
        x, y, z = map(float, scan.point_m[i])
        yield "/contact", kind, ns, types[kind](header=header(ns), point=point(x=x, y=y, z=z))
        kind = "std_msgs/msg/Float64"
        yield "/travel", kind, ns, types[kind](data=float(scan.displacement_m[i]))


def _write_bag(writer, scan: Scan, ros1: bool) -> None:
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    encode: Callable = store.serialize_ros1 if ros1 else store.serialize_cdr
    with writer:
        topics = {}
        for topic, kind, ns, message in _messages(scan, store, ros1):
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(topics[topic], ns, encode(message, kind))


def ros1_bag(scan: Scan, folder: Path) -> Foreign:
    path = folder / "run.bag"
    _write_bag(Writer1(path), scan, ros1=True)
    return Foreign("ros1_bag", (path,), _BAG_RIG)


def mcap_folder(scan: Scan, folder: Path) -> Foreign:
    path = folder / "ros2_run"
    _write_bag(Writer2(path, version=9, storage_plugin=StoragePlugin.MCAP), scan, ros1=False)
    return Foreign("mcap_folder", (path,), _BAG_RIG)


def mcap_file(scan: Scan, folder: Path) -> Foreign:
    """Written by another library than the one that reads it."""
    path = folder / "run.mcap"
    store = get_typestore(Stores.ROS2_HUMBLE)
    with path.open("wb") as stream:
        writer = McapWriter(stream)
        writer.start(profile="ros2", library="a rig's own recorder")
        channels = {}
        for topic, kind, ns, message in _messages(scan, store, ros1=False):
            if topic not in channels:
                text = store.generate_msgdef(kind, ros_version=2)[0]
                schema = writer.register_schema(kind, "ros2msg", text.encode())
                channels[topic] = writer.register_channel(topic, "cdr", schema)
            data = bytes(store.serialize_cdr(message, kind))
            writer.add_message(channels[topic], log_time=ns, publish_time=ns, data=data)
        writer.finish()
    return Foreign("mcap_file", (path,), _BAG_RIG)


FORMS: tuple[Callable[[Scan, Path], Foreign], ...] = (
    csv_german, csv_tab_units_row, csv_no_header, csv_turned_round, csv_bars_dates,
    csv_file_a_press, excel, matlab_5, matlab_73, hdf5_group_a_press, ros1_bag, mcap_folder,
    mcap_file,
)  # fmt: skip
