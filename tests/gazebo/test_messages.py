# SPDX-License-Identifier: Apache-2.0
"""What Gazebo's messages say."""

from __future__ import annotations

from types import SimpleNamespace as Message

import numpy as np
import pytest

from pm01_nav.backends.gazebo.messages import pose_of, pose_since, ranges_of, stamp_of, twist_of
from pm01_nav.errors import InputError


def odometry(x: float, y: float, yaw: float) -> Message:
    turn = Message(x=0.0, y=0.0, z=np.sin(yaw / 2.0), w=np.cos(yaw / 2.0))
    pose = Message(position=Message(x=x, y=y), orientation=turn)
    return Message(pose=pose, twist=Message(linear=Message(x=0.4), angular=Message(z=-0.2)))


def test_stamps_are_nanoseconds() -> None:
    header = Message(stamp=Message(sec=12, nsec=304_000_000))
    assert stamp_of(Message(header=header)) == 12_304_000_000


def test_ranges_out_of_sight() -> None:
    scan = Message(ranges=[1.5, np.inf, -np.inf, np.nan])
    assert ranges_of(scan, 4, "/scan").tolist() == [1.5, np.inf, 0.0, 0.0]
    with pytest.raises(InputError, match=r"/scan: 4 beams, the robot has 360"):
        ranges_of(scan, 360, "/scan")


def test_odometry() -> None:
    message = odometry(1.0, -2.0, -3.0)
    assert pose_of(message) == pytest.approx([1.0, -2.0, -3.0])
    assert twist_of(message) == pytest.approx([0.4, -0.2])


def test_odometry_counts_from_where_the_robot_was_put_down() -> None:
    start, origin = np.array([5.0, 1.0, np.pi / 2.0]), np.array([2.0, 0.0, np.pi])
    # Since then a metre ahead, along -x of odometry, is a metre ahead along +y of the world,
    # and a quarter turn to the left is one.
    now = np.array([1.0, 0.0, -np.pi / 2.0])
    assert pose_since(start, origin, origin) == pytest.approx(start)
    moved = pose_since(start, origin, now)
    assert moved[:2] == pytest.approx([5.0, 2.0])
    assert abs(moved[2]) == pytest.approx(np.pi)
