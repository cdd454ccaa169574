"""ROS 1 and ROS 2 bags and MCAP, without ROS: a table for each topic, its clock in ``stamp``.

The clock is the header's where it is set, else the moment of writing. A message is taken apart by
its fields, ``pose.position.x``; a joint state by the names of its joints, ``position.elbow_joint``,
whatever their order; transforms by the frame that they place.
"""

from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from plumbline.errors import PlumblineError, fault, one_line
from plumbline.experiments.importing.tables import Raw

EXTRA = 'pip install "plumbline-robotics[rosbag]"'
LONGEST_LIST = 64  # values of an array that is taken apart: a longer one is a picture or a cloud
SKIPPED = (
    "sensor_msgs/msg/Image",
    "sensor_msgs/msg/CompressedImage",
    "sensor_msgs/msg/PointCloud2",
)
PLACES = {
    "pose.position": "x y z", "point": "x y z", "transform.translation": "x y z",
    "pose.pose.position": "x y z", "pose.orientation": "qx qy qz qw",
    "pose.pose.orientation": "qx qy qz qw", "transform.rotation": "qx qy qz qw",
}  # fmt: skip


def read(path: Path) -> list[Raw]:
    """A table for each topic of a bag, refused if it is none or nothing here reads it."""
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise PlumblineError(f"{path.name}: reading bags needs rosbags: {EXTRA}") from None
    store = get_typestore(Stores.LATEST)
    rows: dict[str, list[dict[str, Any]]] = {}
    try:
        with AnyReader([path], default_typestore=store) as reader:
            wanted = [c for c in reader.connections if c.msgtype not in SKIPPED]
            for connection, written, data in reader.messages(connections=wanted):
                message = reader.deserialize(data, connection.msgtype)
                for part, cells in _rows(message, written * 1e-9):
                    rows.setdefault(connection.topic + part, []).append(cells)
    except (AnyReaderError, OSError, ValueError, KeyError, RuntimeError) as error:
        found = f"no bag that can be read ({one_line(str(error))[:80]})"
        raise fault(path.name, found, "a ROS bag or MCAP", "check it with: ros2 bag info") from None
    return [_raw(topic, found) for topic, found in sorted(rows.items())]


def _raw(topic: str, rows: list[dict[str, Any]]) -> Raw:
    table = pd.DataFrame(rows)
    columns = {str(c): np.asarray(table[c]) for c in table.columns}
    roles = {"stamp": "time"}
    for place, names in PLACES.items():
        inside = {f"{place}.{name[-1]}": name for name in names.split()}
        roles |= inside if set(inside) <= set(columns) else {}
    return Raw(topic, columns, f"{len(rows):,} messages", roles=roles)


def _rows(message: Any, written: float) -> Iterator[tuple[str, dict[str, Any]]]:
    """What a message holds: one row, or one a transform, named by the frame that it places."""
    if hasattr(message, "transforms"):
        for part in message.transforms:
            yield f"/{part.child_frame_id}", _row(part, written)
    else:
        yield "", _row(message, written)


def _row(message: Any, written: float) -> dict[str, Any]:
    header = getattr(message, "header", None)
    stamp = getattr(header, "stamp", None)
    moment = written if stamp is None else stamp.sec + 1e-9 * stamp.nanosec
    cells: dict[str, Any] = {"stamp": moment if moment > 0.0 else written}
    if hasattr(message, "name") and hasattr(message, "position"):
        for key in ("position", "velocity", "effort"):
            values = getattr(message, key, ())
            if len(values) == len(message.name):
                cells |= {f"{key}.{n}": float(v) for n, v in zip(message.name, values, strict=True)}
        return cells
    return cells | dict(_cells(message, ""))


def _cells(message: Any, prefix: str) -> Iterator[tuple[str, Any]]:
    """Numbers and words of a message by the path of their field; the header is left out."""
    for field in fields(message):
        value, name = getattr(message, field.name), f"{prefix}{field.name}"
        if field.name in ("header", "layout") or field.name.startswith("__"):
            continue
        if is_dataclass(value):
            yield from _cells(value, f"{name}.")
        elif isinstance(value, bool | int | float | str | np.number):
            yield name, value
        elif isinstance(value, np.ndarray) and value.ndim == 1 and len(value) <= LONGEST_LIST:
            yield from ((f"{name}.{k}", float(v)) for k, v in enumerate(value, start=1))
