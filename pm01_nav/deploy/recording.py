# SPDX-License-Identifier: Apache-2.0
"""Drives as rosbag2 folders of MCAP, which ``ros2 bag`` and Foxglove open, and back."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pm01_nav.deploy.messages import (
    Odometry,
    Scan,
    odometry_from_ros,
    ros_twist,
    scan_from_ros,
)
from pm01_nav.deploy.safety import Command
from pm01_nav.drives import AxisName
from pm01_nav.errors import InputError

SCAN, ODOMETRY = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry"
TWIST, TWIST_STAMPED = "geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped"
MAX_MESSAGES = 2_000_000
"""More is refused: an hour at 100 Hz of everything has a million."""
CLOCK_JUMP_S = 1.0
"""Stamps that are later or earlier than the others by more are no measure of when it was [s]."""
NO_TOPIC = "none"
"""A drive may lack scans."""


def _typestore() -> Any:
    try:
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise InputError("rosbags is missing: pip install 'pm01-nav[bags]'") from error
    return get_typestore(Stores.ROS2_HUMBLE)


class Recorder:
    """Write ``/scan``, ``/odom`` and ``/cmd_vel`` into a new folder."""

    def __init__(self, folder: str | Path, axes: Sequence[AxisName] = ("x", "yaw")) -> None:
        """Begin to write of a robot whose drive has these ``axes``.

        Raises:
            InputError: rosbags is missing, or the folder exists.
        """
        self._store, self._axes = _typestore(), axes
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
            self.odometry(odometry_from_ros(message, self._axes), now)

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
        twist = self._twist(ros_twist(odometry.twist))
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
        vector, (x, y, yaw) = self._type("geometry_msgs/msg/Vector3"), ros_twist(command)
        return self._type(TWIST)(vector(x=x, y=y, z=0.0), vector(x=0.0, y=0.0, z=yaw))

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
    begin: float = 0.0
    """When the bag begins [s]."""


def read_recording(
    path: str | Path,
    *,
    scan: str = "/scan",
    odometry: str = "/odom",
    command: str = "/cmd_vel",
    begin: float | None = None,
    end: float | None = None,
) -> Recording:
    """Read a drive from a rosbag2 folder, an .mcap or .db3 file, or a ROS 1 .bag file.

    ``begin`` and ``end`` [s after the bag begins] take a part of it; the commands before stay, as
    the first of them may still be driven. ``scan="none"`` reads no scans.

    Raises:
        InputError: rosbags is missing, this is no bag, a topic is missing, or the part is empty.
    """
    if len({scan, odometry, command}) < 3:
        raise InputError(
            f"{path}: scan, odometry and command need three topics; one is given twice"
        )
    kinds = {odometry: (ODOMETRY,), command: (TWIST, TWIST_STAMPED)}
    if scan != NO_TOPIC:
        kinds[scan] = (SCAN,)
    taken: dict[str, list[tuple[float, Any]]] = {topic: [] for topic in kinds}
    with _opened(path) as (reader, deserialize):
        _refuse_strange(reader, path, kinds)
        first = 1e-9 * reader.start_time
        _check_part(path, 1e-9 * reader.duration, begin, end)
        with _readable(path):
            for connection, nanoseconds, data in reader.messages(_wanted(reader, kinds)):
                message = deserialize(data, connection.msgtype)
                taken[connection.topic].append((1e-9 * nanoseconds, message))
    twists = [(t, getattr(m, "twist", m)) for t, m in taken[command]]
    commands = np.array([(t, m.linear.x, m.angular.z) for t, m in twists], dtype=np.float64)
    whole = Recording(
        commands=_finite(commands),
        odometry=_odometry_rows(taken[odometry]),
        scans=_scans(taken.get(scan, [])),
        begin=first,
    )
    return _part(whole, -math.inf if begin is None else begin, math.inf if end is None else end)


@contextmanager
def _readable(path: str | Path) -> Iterator[None]:
    """Say in one line what is wrong with a bag; what its readers raise is documented nowhere."""
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(
            f"{path}: is no readable rosbag2 folder, .mcap, .db3 or .bag file: {reason}"
        ) from error


@contextmanager
def _opened(path: str | Path) -> Iterator[tuple[Any, Callable[[bytes, str], Any]]]:
    """Open a bag by what it is, whatever it is called."""
    store = _typestore()
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import Stores, get_typestore

    with _readable(path):
        is_ros1 = Path(path).is_file() and _begins(Path(path)) == b"#ROSBAG"
        if is_ros1:
            store = get_typestore(Stores.ROS1_NOETIC)
        reader: Any = (rosbag1 if is_ros1 else rosbag2).Reader(Path(path))
        reader.open()
    try:
        yield reader, store.deserialize_ros1 if is_ros1 else store.deserialize_cdr
    finally:
        reader.close()


def _begins(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(7)


def _wanted(reader: Any, kinds: dict[str, tuple[str, ...]]) -> list[Any]:
    return [connection for connection in reader.connections if connection.topic in kinds]


def _refuse_strange(reader: Any, path: str | Path, kinds: dict[str, tuple[str, ...]]) -> None:
    found = _wanted(reader, kinds)
    for topic, allowed in kinds.items():
        # In ROS 1 each publisher of a topic has a connection of its own.
        if not any(c.msgcount for c in found if c.topic == topic):
            names = ", ".join(sorted({c.topic for c in reader.connections})) or "none"
            raise InputError(f"{path}: has no messages on {topic}; its topics: {names}")
        strange = [c.msgtype for c in found if c.topic == topic and c.msgtype not in allowed]
        if strange:
            raise InputError(f"{path}: {topic} is {strange[0]}; needed: {' or '.join(allowed)}")
    if sum(c.msgcount for c in found) > MAX_MESSAGES:
        raise InputError(f"{path}: holds more than {MAX_MESSAGES} messages; record a shorter drive")


def _check_part(path: str | Path, seconds: float, begin: float | None, end: float | None) -> None:
    first, last = 0.0 if begin is None else begin, seconds if end is None else end
    if not 0.0 <= first < seconds:
        raise InputError(f"{path}: from = {first:g}: the bag is {seconds:.1f} s long")
    if not first < last:
        raise InputError(f"{path}: to = {last:g}: must be more than from = {first:g}")


def _part(whole: Recording, begin: float, end: float) -> Recording:
    first, last = whole.begin + begin, whole.begin + end
    times = whole.odometry[:, 0]
    return replace(
        whole,
        commands=whole.commands[whole.commands[:, 0] <= last],
        odometry=whole.odometry[(times >= first) & (times <= last)],
        scans=[scan for scan in whole.scans if first <= scan.stamp <= last],
    )


def _finite(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    return rows[np.isfinite(rows).all(axis=1)]


def _times(arrived: list[float], stamps: list[float]) -> NDArray[np.float64]:
    """Return when messages were made, by the bag's clock [s].

    That is their stamp and what the typical message was late by: commands, which have no stamps,
    are as late. Stamps that have nothing to do with the bag's clock are not used.
    """
    late = np.array(arrived) - np.array(stamps)
    typical = float(np.median(late))
    sane = np.abs(late - typical) < CLOCK_JUMP_S
    # Stamps may stand still, or go at a simulation's pace.
    passed, told = (np.diff(np.quantile(times, [0.05, 0.95]))[0] for times in (arrived, stamps))
    if sane.mean() < 0.9 or abs(told - passed) > 0.1 + 0.1 * passed:
        return np.array(arrived)
    return np.where(sane, np.array(stamps) + typical, np.array(arrived))


def _odometry_rows(taken: list[tuple[float, Any]]) -> NDArray[np.float64]:
    """Return odometry by the time of its stamps, moved to the bag's clock."""
    ours = [odometry_from_ros(message) for _, message in taken]
    times = _times([t for t, _ in taken], [m.stamp for m in ours])
    rows = np.array([[t, *m.twist, *m.pose] for t, m in zip(times, ours, strict=True)])
    rows = _finite(rows)
    return rows[np.argsort(rows[:, 0], kind="stable")]


def _scans(taken: list[tuple[float, Any]]) -> list[Scan]:
    ours = [scan_from_ros(message) for _, message in taken]
    times = _times([t for t, _ in taken], [m.stamp for m in ours]) if ours else []
    moved = [replace(m, stamp=float(t)) for t, m in zip(times, ours, strict=True)]
    return sorted(moved, key=lambda scan: scan.stamp)
