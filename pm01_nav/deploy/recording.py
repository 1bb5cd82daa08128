# SPDX-License-Identifier: Apache-2.0
"""Drives as rosbag2 folders of MCAP, which ``ros2 bag`` and Foxglove open, and back."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pm01_nav.deploy.messages import Odometry, Scan, odometry_from_ros, scan_from_ros
from pm01_nav.deploy.safety import Command
from pm01_nav.errors import InputError

SCAN, ODOMETRY = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry"
TWIST, TWIST_STAMPED = "geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped"
MAX_MESSAGES = 2_000_000
"""More is refused: an hour at 100 Hz of everything has a million."""


def _typestore() -> Any:
    try:
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise InputError("rosbags is missing: pip install 'pm01-nav[bags]'") from error
    return get_typestore(Stores.ROS2_HUMBLE)


class Recorder:
    """Write ``/scan``, ``/odom`` and ``/cmd_vel`` into a new folder."""

    def __init__(self, folder: str | Path) -> None:
        """Begin to write.

        Raises:
            InputError: rosbags is missing, or the folder exists.
        """
        self._store = _typestore()
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.rosbag2.errors import WriterError

        try:
            self._writer = Writer(Path(folder), version=8, storage_plugin=StoragePlugin.MCAP)
            self._writer.open()
        except (WriterError, OSError) as error:
            raise InputError(f"{folder}: cannot be written: {error}") from error
        self._connections: dict[str, Any] = {}

    def event(self, kind: str, message: Any, now: float) -> None:
        """Write a scan or odometry that arrived at ``now`` [s]; other kinds are not written."""
        if kind == "scan":
            self.scan(scan_from_ros(message), now)
        elif kind == "odometry":
            self.odometry(odometry_from_ros(message), now)

    def scan(self, scan: Scan, now: float) -> None:
        """Write a scan that arrived at ``now`` [s]."""
        message = self._type(SCAN)(
            header=self._header(scan.stamp, "base_scan"),
            angle_min=scan.angle_min,
            angle_max=scan.angle_min + scan.angle_increment * (len(scan.ranges) - 1),
            angle_increment=scan.angle_increment,
            time_increment=0.0,
            scan_time=0.0,
            range_min=scan.range_min,
            range_max=scan.range_max,
            ranges=np.asarray(scan.ranges, dtype=np.float32),
            intensities=np.zeros(0, dtype=np.float32),
        )
        self._write("/scan", SCAN, message, now)

    def odometry(self, odometry: Odometry, now: float) -> None:
        """Write odometry that arrived at ``now`` [s]."""
        x, y, yaw = map(float, odometry.pose)
        turn = self._type("geometry_msgs/msg/Quaternion")(
            x=0.0, y=0.0, z=math.sin(0.5 * yaw), w=math.cos(0.5 * yaw)
        )
        place = self._type("geometry_msgs/msg/Point")(x=x, y=y, z=0.0)
        pose = self._type("geometry_msgs/msg/Pose")(position=place, orientation=turn)
        unknown = np.zeros(36)
        twist = self._twist((float(odometry.twist[0]), float(odometry.twist[1])))
        message = self._type(ODOMETRY)(
            header=self._header(odometry.stamp, "odom"),
            child_frame_id="base_link",
            pose=self._type("geometry_msgs/msg/PoseWithCovariance")(pose, unknown),
            twist=self._type("geometry_msgs/msg/TwistWithCovariance")(twist, unknown),
        )
        self._write("/odom", ODOMETRY, message, now)

    def command(self, command: Command, now: float) -> None:
        """Write a command that was sent at ``now`` [s]."""
        self._write("/cmd_vel", TWIST, self._twist(command), now)

    def close(self) -> None:
        """Finish the files."""
        self._writer.close()

    def _type(self, name: str) -> Any:
        return self._store.types[name]

    def _header(self, stamp: float, frame: str) -> Any:
        nanoseconds = round(stamp * 1e9)
        time = self._type("builtin_interfaces/msg/Time")(
            sec=nanoseconds // 1_000_000_000, nanosec=nanoseconds % 1_000_000_000
        )
        return self._type("std_msgs/msg/Header")(stamp=time, frame_id=frame)

    def _twist(self, command: Command) -> Any:
        vector = self._type("geometry_msgs/msg/Vector3")
        linear = vector(x=float(command[0]), y=0.0, z=0.0)
        return self._type(TWIST)(linear, vector(x=0.0, y=0.0, z=float(command[1])))

    def _write(self, topic: str, kind: str, message: Any, now: float) -> None:
        connection = self._connections.get(topic)
        if connection is None:
            connection = self._writer.add_connection(topic, kind, typestore=self._store)
            self._connections[topic] = connection
        data = self._store.serialize_cdr(message, kind)
        self._writer.write(connection, round(now * 1e9), data)


@dataclass(frozen=True)
class Recording:
    """What a bag holds of a drive; all times are when messages were written [s]."""

    commands: NDArray[np.float64]
    """t, v, w, shape (n, 3), in order of time."""
    odometry: NDArray[np.float64]
    """t, v, w, x, y, yaw, shape (n, 6), in order of time."""
    scans: list[Scan]
    """Their stamps are by the same clock."""


def read_recording(
    path: str | Path, *, scan: str = "/scan", odometry: str = "/odom", command: str = "/cmd_vel"
) -> Recording:
    """Read a rosbag2 folder, SQLite or MCAP.

    Raises:
        InputError: rosbags is missing, the folder is no bag, or a topic is missing.
    """
    store = _typestore()
    from rosbags.highlevel import AnyReader
    from rosbags.highlevel.anyreader import AnyReaderError
    from rosbags.rosbag2.errors import ReaderError

    taken: dict[str, list[tuple[float, Any]]] = {scan: [], odometry: [], command: []}
    try:
        with AnyReader([Path(path)], default_typestore=store) as reader:
            _refuse_strange(reader, path, taken)
            wanted = [c for c in reader.connections if c.topic in taken]
            for connection, nanoseconds, data in reader.messages(wanted):
                message = reader.deserialize(data, connection.msgtype)
                taken[connection.topic].append((1e-9 * nanoseconds, message))
    except (AnyReaderError, ReaderError, OSError) as error:
        raise InputError(f"{path}: is no readable rosbag2 folder: {error}") from error
    twists = [(t, getattr(m, "twist", m)) for t, m in taken[command]]
    return Recording(
        commands=np.array([(t, m.linear.x, m.angular.z) for t, m in twists], dtype=np.float64),
        odometry=_odometry_rows(taken[odometry]),
        scans=_scans(taken[scan]),
    )


def _refuse_strange(reader: Any, path: str | Path, topics: dict[str, Any]) -> None:
    found = {c.topic: c for c in reader.connections}
    for topic in topics:
        if topic not in found or found[topic].msgcount == 0:
            names = ", ".join(sorted(found)) or "none"
            raise InputError(f"{path}: has no messages on {topic}; its topics: {names}")
        if found[topic].msgtype not in (SCAN, ODOMETRY, TWIST, TWIST_STAMPED):
            raise InputError(f"{path}: {topic} is {found[topic].msgtype}: cannot be used")
    if reader.message_count > MAX_MESSAGES:
        raise InputError(f"{path}: holds more than {MAX_MESSAGES} messages; record a shorter drive")


def _odometry_rows(taken: list[tuple[float, Any]]) -> NDArray[np.float64]:
    """Return odometry by the time of its stamps, moved to the bag's clock."""
    ours = [odometry_from_ros(message) for _, message in taken]
    apart = min(t - m.stamp for (t, _), m in zip(taken, ours, strict=True))
    rows = np.array([[m.stamp + apart, *m.twist, *m.pose] for m in ours])
    return rows[np.argsort(rows[:, 0], kind="stable")]


def _scans(taken: list[tuple[float, Any]]) -> list[Scan]:
    ours = [scan_from_ros(message) for _, message in taken]
    apart = min(t - m.stamp for (t, _), m in zip(taken, ours, strict=True))
    moved = [Scan(m.stamp + apart, *_rest(m)) for m in ours]
    return sorted(moved, key=lambda scan: scan.stamp)


def _rest(scan: Scan) -> tuple[Any, ...]:
    return (scan.angle_min, scan.angle_increment, scan.range_min, scan.range_max, scan.ranges)
