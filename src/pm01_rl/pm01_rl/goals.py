# SPDX-License-Identifier: Apache-2.0
"""Goals from RViz and from ``NavigateToPose``, kept in place by tf2."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from geometry_msgs.msg import PoseStamped
from nav2_msgs.action import NavigateToPose
from rclpy.action.server import ServerGoalHandle
from rclpy.task import Future
from rclpy.time import Time
from tf2_ros import Buffer, TransformException

from pm01_nav.deploy.controller import Goal
from pm01_nav.deploy.messages import yaw_of_quaternion
from pm01_nav.geometry import to_world


@dataclass
class Errand:
    """A goal as it was given, and who waits for its end."""

    pose: PoseStamped
    started: float
    handle: ServerGoalHandle | None = None
    """The action's goal; None for a goal from a topic."""
    ended: Future = field(default_factory=Future)
    """Gets the outcome: arrived, canceled, dropped, preempted or stopped."""

    def end(self, outcome: str) -> None:
        """Say how it ended, once."""
        if not self.ended.done():
            self.ended.set_result(outcome)


def goal_in_odometry(
    pose: PoseStamped, odometry_frame: str, buffer: Buffer, now: float
) -> tuple[Goal | None, float]:
    """Return where a goal lies in the odometry frame, and how old the transform is [s].

    ``now`` [s] is the node's time. Without a transform it is None and infinitely old. A fixed
    transform has no age.
    """
    place = np.array([pose.pose.position.x, pose.pose.position.y])
    frame = pose.header.frame_id or odometry_frame
    if not np.isfinite(place).all():
        return None, math.inf
    if frame == odometry_frame:
        return Goal(float(place[0]), float(place[1])), 0.0
    try:
        found = buffer.lookup_transform(odometry_frame, frame, Time())
    except TransformException:
        return None, math.inf
    shift, turn = found.transform.translation, found.transform.rotation
    yaw = yaw_of_quaternion(turn.x, turn.y, turn.z, turn.w)
    x, y = to_world(place, np.array([shift.x, shift.y, yaw]))
    stamp = Time.from_msg(found.header.stamp).nanoseconds * 1e-9
    return Goal(float(x), float(y)), 0.0 if stamp == 0.0 else max(0.0, now - stamp)


def feedback(errand: Errand, pose: np.ndarray | None, distance: float, now: float) -> object:
    """Return what a client of ``NavigateToPose`` is told on the way."""
    message = NavigateToPose.Feedback()
    message.distance_remaining = distance if math.isfinite(distance) else -1.0
    message.navigation_time.sec = int(now - errand.started)
    if pose is not None:
        place = message.current_pose.pose
        place.position.x, place.position.y = float(pose[0]), float(pose[1])
        place.orientation.z = math.sin(0.5 * float(pose[2]))
        place.orientation.w = math.cos(0.5 * float(pose[2]))
    return message
