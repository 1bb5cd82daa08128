# SPDX-License-Identifier: Apache-2.0
"""What Gazebo's messages say, in our terms, and streams of them, ordered by their stamps.

A step waits for the scan that belongs to it, and never sleeps. All but ``subscribe`` runs without
Gazebo.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pm01_nav.errors import InputError
from pm01_nav.geometry import to_frame, to_world, wrap_angle

FloatArray = NDArray[np.float64]


def nanoseconds(moment: Any) -> int:
    """Return a ``gz.msgs.Time`` [ns]."""
    return int(moment.sec) * 1_000_000_000 + int(moment.nsec)


def stamp_of(message: Any) -> int:
    """Return the simulation time of a message with a header [ns]."""
    return nanoseconds(message.header.stamp)


def ranges_of(scan: Any, num_beams: int, topic: str) -> NDArray[np.float32]:
    """Return the ranges of a ``gz.msgs.LaserScan`` [m], infinity where nothing is hit.

    Raises:
        InputError: it has another number of beams than the robot.
    """
    ranges = np.array(scan.ranges, dtype=np.float32)
    if len(ranges) != num_beams:
        raise InputError(
            f"{topic}: {len(ranges)} beams, the robot has {num_beams}; give the --robot that drives"
        )
    # Nearer than the sensor can see, where nothing of the robot's own is.
    ranges[np.isneginf(ranges) | np.isnan(ranges)] = 0.0
    return ranges


def pose_of(odometry: Any) -> FloatArray:
    """Return x, y, yaw of a ``gz.msgs.Odometry`` [m, m, rad], shape (3,)."""
    place, turn = odometry.pose.position, odometry.pose.orientation
    return np.array([place.x, place.y, 2.0 * np.arctan2(turn.z, turn.w)])


def twist_of(odometry: Any) -> FloatArray:
    """Return v, w of a ``gz.msgs.Odometry`` [m/s, rad/s], shape (2,)."""
    return np.array([odometry.twist.linear.x, odometry.twist.angular.z])


def pose_since(start: FloatArray, origin: FloatArray, odometry: FloatArray) -> FloatArray:
    """Return an odometry pose as one in the world: ``start`` where odometry was ``origin``.

    All are x, y, yaw [m, m, rad], shape (3,).
    """
    place = to_world(to_frame(odometry[:2], origin), start)
    return np.array([*place, float(wrap_angle(start[2] + odometry[2] - origin[2]))])


def pixels_of(image: Any, topic: str) -> NDArray[np.uint8]:
    """Return what a camera's message shows, (height, width, 3).

    Raises:
        InputError: it is no picture of three colours.
    """
    size = image.height * image.width * 3
    if len(image.data) != size or not size:
        raise InputError(f"{topic}: {len(image.data)} bytes, needs {size}")
    shape = (image.height, image.width, 3)
    return np.frombuffer(image.data, dtype=np.uint8).reshape(shape).copy()


class SilentError(Exception):
    """Nothing came in time that was new enough."""


class StampedStream:
    """The newest message of one topic; filled by the transport's thread, read by ours.

    Messages of a topic come in the order in which they were sent.
    """

    def __init__(self, topic: str, read: Callable[[Any], tuple[int, Any]]) -> None:
        """Hold nothing yet; ``topic`` is for messages to people.

        ``read`` returns the stamp [ns] and the content of a message as it arrives. Of many messages
        only those that somebody asks for are read.
        """
        self.topic = topic
        self._read = read
        self._unread: Any = None
        self._newest: tuple[int, Any] | None = None
        self._arrived = threading.Condition()

    def put(self, message: Any) -> None:
        """Take a message as it arrives."""
        with self._arrived:
            self._unread = message
            self._arrived.notify_all()

    def clear(self) -> None:
        """Forget what came, as after a reset."""
        with self._arrived:
            self._unread = self._newest = None

    def latest(self, stamp: int) -> Any | None:
        """Return the newest message if it is not older than ``stamp`` [ns], or None."""
        with self._arrived:
            newest = self._now()
        return newest[1] if newest is not None and newest[0] >= stamp else None

    def wait(self, stamp: int, timeout_s: float) -> Any:
        """Return the newest message as soon as it is not older than ``stamp`` [ns].

        Raises:
            SilentError: none such came within ``timeout_s`` of real time.
        """
        end = time.monotonic() + timeout_s
        with self._arrived:
            while True:
                newest = self._now()
                if newest is not None and newest[0] >= stamp:
                    return newest[1]
                left = end - time.monotonic()
                if left <= 0.0:
                    raise SilentError(self._complaint(stamp, timeout_s))
                self._arrived.wait(left)

    def _now(self) -> tuple[int, Any] | None:
        if self._unread is not None:
            self._newest, self._unread = self._read(self._unread), None
        return self._newest

    def _complaint(self, stamp: int, timeout_s: float) -> str:
        wanted = f"{self.topic}: no message of {stamp / 1e9:.3f} s or later in {timeout_s:g} s"
        if self._newest is None:
            return f"{wanted}; none at all came"
        return f"{wanted}; the newest is of {self._newest[0] / 1e9:.3f} s"


def subscribe(
    node: Any, topic: str, message_type: Any, stamp: Callable[[Any], int] = stamp_of
) -> StampedStream:
    """Return the stream of a topic's messages, which a node of Gazebo's transport receives."""
    from gz.transport13 import SubscribeOptions  # pyright: ignore[reportMissingImports]

    def read(data: bytes) -> tuple[int, Any]:
        message = message_type.FromString(data)
        return stamp(message), message

    stream = StampedStream(topic, read)
    name = message_type.DESCRIPTOR.full_name
    node.subscribe_raw(topic, lambda data, info: stream.put(data), name, SubscribeOptions())
    return stream
