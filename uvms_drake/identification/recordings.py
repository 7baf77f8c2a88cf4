"""Recordings of ArduSub and ROS 2 as tables, with a column for each number of a message.

A table is a kind of message of ArduSub, as `ATT`, or of one instance, as `IMU[0]`; or a topic of
ROS 2, as `/imu/data`. Its columns are the fields of the message, `Roll`, `orientation.x`,
`position[0]`; besides them `time_s` is the time of recording, and `header.stamp` that of a header
[s]. Each kind of recording needs an optional package.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from uvms_drake.common.errors import InvalidParameter, require

MAVLINK, ROS = (".bin", ".tlog"), (".mcap", ".db3")
"""Ends of the names of recordings of ArduSub and ROS 2; a folder with `BAG_FILE` is one, too."""
BAG_FILE = "metadata.yaml"
TIME, STAMP = "time_s", "header.stamp"

Table = dict[str, np.ndarray]
"""Columns (N,) by their names."""


def is_recording(path: Path) -> bool:
    """Returns whether a path is one of a recording of ArduSub or ROS 2."""
    return path.suffix.lower() in (*MAVLINK, *ROS) or (path / BAG_FILE).is_file()


def recorded_tables(path: Path, names: Iterable[str]) -> dict[str, Table]:
    """Returns tables of a recording by their names.

    Raises:
        InvalidParameter: It cannot be read, has no such message or topic, or its package is not
            installed.
    """
    read = _ardusub if path.suffix.lower() in MAVLINK else _ros
    rows = defaultdict[str, list[dict[str, float]]](list)
    try:
        others = read(path, sorted(set(names)), rows)
    except ImportError as error:
        raise InvalidParameter("LOG", str(path), "left out without its package (pip install "
                               f"'uvms_drake[logs]'): {error}") from None
    except InvalidParameter:
        raise
    except Exception as error:  # The packages raise errors of many kinds.
        raise InvalidParameter("LOG", str(path), f"a recording that can be read ({error})"
                               ) from None
    for name in names:
        require(bool(rows[name]), f"{path}: signals.file", name,
                f"one of {', '.join(sorted(others)) or 'none: it is empty'}")
    return {name: {column: np.array([row.get(column, np.nan) for row in rows[name]])
                   for column in rows[name][0]} for name in names}


def _ardusub(path: Path, names: list[str], rows: dict[str, list[dict[str, float]]]) -> set[str]:
    """Fills in the messages of an ArduSub log, and returns the kinds that it has."""
    from pymavlink import mavutil  # type: ignore[import-not-found,import-untyped,unused-ignore]

    log, seen = mavutil.mavlink_connection(str(path)), set[str]()
    while (message := log.recv_match()) is not None:
        kind = message.get_type()
        field = getattr(getattr(message, "fmt", None), "instance_field", None)
        instance = "" if field is None else f"{kind}[{getattr(message, field)}]"
        seen |= {kind, instance} - {"", "BAD_DATA", "FMT"}
        for name in {kind, instance}.intersection(names):
            rows[name].append({TIME: float(message._timestamp), **dict(_numbers(
                {key: getattr(message, key) for key in message.get_fieldnames()}))})
    return seen


def _ros(path: Path, names: list[str], rows: dict[str, list[dict[str, float]]]) -> set[str]:
    """Fills in the messages of topics of a rosbag2 or an MCAP file, and returns its topics."""
    from rosbags.highlevel import (  # type: ignore[import-not-found,import-untyped,unused-ignore]
        AnyReader,
    )
    from rosbags.typesys import (  # type: ignore[import-not-found,import-untyped,unused-ignore]
        Stores,
        get_typestore,
    )

    with AnyReader([path], default_typestore=get_typestore(Stores.LATEST)) as bag:
        wanted = [each for each in bag.connections if each.topic in names]
        for connection, time, data in bag.messages(connections=wanted):
            found = dict(_numbers(bag.deserialize(data, connection.msgtype)))
            if f"{STAMP}.sec" in found:
                found[STAMP] = found[f"{STAMP}.sec"] + 1e-9 * found[f"{STAMP}.nanosec"]
            rows[connection.topic].append({TIME: 1e-9 * time, **found})
        return {each.topic for each in bag.connections}


def _numbers(value: Any, name: str = "") -> Iterator[tuple[str, float]]:
    """Yields the names and values of all numbers of a message."""
    if is_dataclass(value):
        value = {each.name: getattr(value, each.name) for each in fields(value)}
    if isinstance(value, dict):
        for key, part in value.items():
            yield from _numbers(part, f"{name}.{key}" if name else key)
    elif isinstance(value, bool | int | float | np.number):
        yield name, float(value)
    elif isinstance(value, list | tuple | np.ndarray):
        for i, part in enumerate(value):
            yield from _numbers(part, f"{name}[{i}]")
