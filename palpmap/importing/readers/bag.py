"""ROS 1 bags, ROS 2 bags (folder, .db3) and MCAP files: one table a topic.

Only the standard message types are read, by the definitions that come with `rosbags`; definitions
inside a file are not used, so that nothing in it is ever turned into code.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from models import InputError
from palpmap.importing.readers.recording import Table

PACKAGES = ("geometry_msgs/", "std_msgs/", "nav_msgs/msg/Odometry")
LISTS = {
    "sensor_msgs/msg/JointState": "joints",
    "tf2_msgs/msg/TFMessage": "transforms",
    "tf/msg/tfMessage": "transforms",
}
STAMP, RECEIVED = "stamp", "received"
MOST_ENTRIES = 36  # of an array inside a message, such as a covariance
UNITS = {
    "force": "N", "torque": "", "position": "m", "translation": "m", "point": "m",
    STAMP: "s", RECEIVED: "s",
}  # fmt: skip

Message = tuple[int, Any]
"""Time of reception in ns, and the message."""


def read_bag(path: Path) -> tuple[list[Table], list[str]]:
    """Read all topics of a bag whose message types are known.

    Times are in s since the first message of the file: `stamp` as the sender's header has it,
    `received` as the recorder's clock.

    Raises
    ------
    InputError
        A file that is no bag, is damaged, or holds no topic that can be read.
    """
    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2
    from rosbags.typesys import Stores, get_typestore

    ros1 = path.suffix.lower() == ".bag"
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    decode: Callable = store.deserialize_ros1 if ros1 else store.deserialize_cdr
    left_out: dict[str, str] = {}
    topics: dict[tuple[str, str], list[Message]] = {}
    with (Reader1 if ros1 else Reader2)(path) as bag:
        wanted = []
        for connection in bag.connections:
            kind = connection.msgtype
            if (kind.startswith(PACKAGES) or kind in LISTS) and kind in store.fielddefs:
                wanted.append(connection)
            else:
                left_out[connection.topic] = kind
        for connection, received, raw in bag.messages(connections=wanted) if wanted else ():
            topic = topics.setdefault((connection.topic, connection.msgtype), [])
            topic.append((received, decode(raw, connection.msgtype)))
    start = min((messages[0][0] for messages in topics.values()), default=0)
    tables = [
        table
        for (topic, kind), messages in topics.items()
        for table in _topic_tables(path, topic, LISTS.get(kind, ""), messages, start)
    ]
    if not tables:
        raise InputError(
            f"{path}: found no topic with messages of force, pose, joints or transforms; it has "
            f"{', '.join(f'{t} ({k})' for t, k in list(left_out.items())[:6]) or 'none'}"
        )
    notes = [f"{path.name}: topics {', '.join(sorted({topic for topic, _ in topics}))}."]
    if left_out:
        others = ", ".join(f"{topic} ({kind})" for topic, kind in list(left_out.items())[:6])
        notes.append(f"{path.name}: topics of other types were left out: {others}.")
    return tables, notes


def _topic_tables(
    path: Path, topic: str, kind: str, messages: list[Message], start: int
) -> Iterator[Table]:
    if kind == "transforms":
        pairs: dict[str, list[Message]] = {}
        for received, message in messages:
            for one in message.transforms:
                name = f"{topic}:{one.header.frame_id}->{one.child_frame_id}".replace(":/", ":")
                pairs.setdefault(name, []).append((received, one))
        for name, some in pairs.items():
            yield _table(path, name.replace(":", " ", 1), some, start)
    elif kind == "joints":
        table = _table(path, topic, messages, start)
        yield Table(
            topic, table.columns | _joints(messages), table.units, table.where, f"topic {topic}"
        )
    else:
        yield _table(path, topic, messages, start)


def _table(path: Path, topic: str, messages: list[Message], start: int) -> Table:
    received = np.array([time for time, _ in messages])
    columns = {RECEIVED: (received - start) * 1e-9}
    first = messages[0][1]
    if hasattr(first, "header"):
        sent = np.array(
            [m.header.stamp.sec * 1_000_000_000 + m.header.stamp.nanosec for _, m in messages]
        )
        if np.any(sent):
            # integers: nanoseconds since 1970 do not fit into a float
            columns[STAMP] = (sent - (start if abs(int(sent[0]) - start) < 10**16 else 0)) * 1e-9
        frame = str(first.header.frame_id)
        columns["frame_id"] = np.full(len(messages), frame) if frame else np.array([])
    for name in _leaves(first, ""):
        values = [attrgetter(name)(message) for _, message in messages]
        columns |= _as_columns(name, values)
    columns = {name: values for name, values in columns.items() if len(values)}
    units = {
        name: unit
        for name in columns
        if (unit := next((UNITS[p] for p in reversed(name.split(".")) if p in UNITS), ""))
    }
    return Table(
        topic,
        columns,
        {name: unit for name, unit in units.items() if "orientation" not in name},
        lambda row: f"{path}, topic {topic}, message {row + 1}",
        stacks_by=f"topic {topic}",
    )


def _leaves(message: Any, prefix: str) -> Iterator[str]:
    """Names of the numbers, texts and short arrays inside a message, header left out."""
    for name in getattr(message, "__dataclass_fields__", ()):
        if name in ("__msgtype__", "header", "layout", "covariance"):
            continue
        value = getattr(message, name)
        if hasattr(value, "__dataclass_fields__"):
            yield from _leaves(value, f"{prefix}{name}.")
        elif isinstance(value, (bool, int, float, str, np.ndarray)):
            yield prefix + name


def _as_columns(name: str, values: list[Any]) -> dict[str, np.ndarray]:
    if isinstance(values[0], str):
        return {name: np.array(values)}
    if isinstance(values[0], (bool, int, float)):
        return {name: np.array(values, dtype=float)}
    sizes = {np.size(value) for value in values}
    if len(sizes) > 1 or max(sizes) > MOST_ENTRIES or not max(sizes):
        return {}
    array = np.asarray(values, dtype=float)
    if array.ndim == 1:
        return {name: array}
    return {f"{name}[{i}]": column for i, column in enumerate(array.T.copy())}


def _joints(messages: list[Message]) -> dict[str, np.ndarray]:
    """Columns `position.<joint>` and so on; joints are found by name, whatever their order."""
    names = list(dict.fromkeys(name for _, message in messages for name in message.name))
    columns = {}
    for quantity in ("position", "velocity", "effort"):
        array = np.full((len(messages), len(names)), np.nan)
        for row, (_, message) in enumerate(messages):
            values = getattr(message, quantity)
            for name, value in zip(message.name, values, strict=False):
                array[row, names.index(name)] = value
        columns |= {
            f"{quantity}.{name}": array[:, i]
            for i, name in enumerate(names)
            if not np.isnan(array[:, i]).all()
        }
    return columns
