# SPDX-License-Identifier: Apache-2.0
"""What RViz shows of a policy: its beams, its goal, its state."""

from __future__ import annotations

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from pm01_nav.deploy.controller import Goal

BLUE = ColorRGBA(r=0.2, g=0.5, b=1.0, a=0.6)
GREEN = ColorRGBA(r=0.1, g=0.8, b=0.3, a=0.8)
WHITE = ColorRGBA(r=1.0, g=1.0, b=1.0, a=1.0)


def markers(
    stamp: Time,
    frames: tuple[str, str],
    lines: np.ndarray,
    goal: Goal | None,
    text: str,
) -> MarkerArray:
    """Return the beams as ``lines`` (n, 2, 2), the goal and a line of text.

    ``frames`` are those of odometry and of the robot, in which the beams are.
    """
    odometry_frame, base_frame = frames
    beams = _marker(stamp, base_frame, "beams", Marker.LINE_LIST, BLUE)
    beams.scale.x = 0.01
    beams.points = [Point(x=x, y=y) for x, y in lines.reshape(-1, 2).tolist()]
    state = _marker(stamp, base_frame, "state", Marker.TEXT_VIEW_FACING, WHITE)
    state.scale.z, state.pose.position.z, state.text = 0.15, 0.5, text
    target = _marker(stamp, odometry_frame, "goal", Marker.CYLINDER, GREEN)
    target.scale.x = target.scale.y = 0.3
    target.scale.z = 0.02
    if goal is None:
        target.action = Marker.DELETE
    else:
        target.pose.position.x, target.pose.position.y = goal.x, goal.y
    return MarkerArray(markers=[beams, target, state])


def _marker(stamp: Time, frame: str, name: str, kind: int, color: ColorRGBA) -> Marker:
    marker = Marker(ns=name, type=kind, action=Marker.ADD, color=color)
    marker.header.stamp, marker.header.frame_id = stamp, frame
    marker.pose.orientation.w = 1.0
    return marker
