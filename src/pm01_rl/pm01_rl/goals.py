# SPDX-License-Identifier: Apache-2.0
"""Goals from RViz and from ``NavigateToPose``, kept in place by tf2."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from builtin_interfaces.msg import Time as TimeMessage
from geometry_msgs.msg import PoseStamped
from nav2_msgs.action import NavigateToPose
from rclpy.action.server import ServerGoalHandle
from rclpy.task import Future
from rclpy.time import Time
from tf2_ros import Buffer, TransformException

from pm01_nav.deploy.controller import Goal, Status
from pm01_nav.deploy.freshness import Stream
from pm01_nav.deploy.messages import seconds, yaw_of_quaternion
from pm01_nav.geometry import to_world
from pm01_rl.conversions import quaternion

UNKNOWN = 9000
"""``NavigateToPose``'s code for an end that has none of its own."""


@dataclass
class Errand:
    """A goal as it was given, and who waits for its end."""

    pose: PoseStamped
    started: float
    handle: ServerGoalHandle | None = None
    """The action's goal; None for a goal from a topic."""
    ended: Future = field(default_factory=Future)
    """Gets the outcome: arrived, canceled, dropped, preempted or stopped."""
    placed: bool = False
    """Whether its place in the odometry frame was known yet."""
    transforms: Stream = field(default_factory=Stream)

    def end(self, outcome: str) -> None:
        """Say how it ended, once."""
        if not self.ended.done():
            self.ended.set_result(outcome)

    def transform_age(self, stamp: float | None, now: float, clock: float) -> float:
        """Return how old the transform is that was just used [s]; 0 for a fixed one, None.

        ``now`` [s] is the time that ages are measured by, ``clock`` [s] the node's, of which
        stamps are if all machines' clocks agree. If they do not, or whoever publishes the transform
        dates it ahead, it still grows old here once it is published no longer.
        """
        if stamp is None:
            return 0.0
        self.transforms.accept(stamp, now)
        return max(clock - stamp, self.transforms.age(now))


def is_place(pose: PoseStamped) -> bool:
    """Tell whether a pose has a finite position on the floor."""
    return math.isfinite(pose.pose.position.x) and math.isfinite(pose.pose.position.y)


def goal_in_odometry(
    pose: PoseStamped, odometry_frame: str, buffer: Buffer
) -> tuple[Goal | None, float | None]:
    """Return where a goal lies in the odometry frame, and the stamp of the transform used [s].

    The goal is None without a transform; the stamp is None where the transform is fixed.
    """
    place = np.array([pose.pose.position.x, pose.pose.position.y])
    frame = pose.header.frame_id or odometry_frame
    if frame == odometry_frame:
        return Goal(float(place[0]), float(place[1])), None
    try:
        found = buffer.lookup_transform(odometry_frame, frame, Time())
    except TransformException:
        return None, None
    shift, turn = found.transform.translation, found.transform.rotation
    yaw = yaw_of_quaternion(turn.x, turn.y, turn.z, turn.w)
    x, y = to_world(place, np.array([shift.x, shift.y, yaw]))
    return Goal(float(x), float(y)), seconds(found.header.stamp) or None


def feedback(
    pose: np.ndarray | None, stamp: TimeMessage, frame: str, distance: float, elapsed: float
) -> NavigateToPose.Feedback:
    """Return what a client of ``NavigateToPose`` is told on the way.

    ``pose`` (3,) is the robot's in the odometry ``frame``; ``elapsed`` [s] is since the goal came.
    """
    message = NavigateToPose.Feedback()
    message.distance_remaining = distance if math.isfinite(distance) else -1.0
    message.navigation_time.sec = int(elapsed)
    message.current_pose.header.stamp, message.current_pose.header.frame_id = stamp, frame
    if pose is not None:
        place = message.current_pose.pose
        place.position.x, place.position.y = float(pose[0]), float(pose[1])
        place.orientation = quaternion(float(pose[2]))
    return message


def result(outcome: str, status: Status | None) -> NavigateToPose.Result:
    """Return what a client is told at the end: from Jazzy on also why."""
    message = NavigateToPose.Result()
    if outcome == "arrived":
        return message
    if hasattr(message, "error_code"):
        message.error_code = UNKNOWN
    if hasattr(message, "error_msg"):
        reasons = status.verdict.reasons if status else ()
        message.error_msg = "; ".join([outcome, *(reason.value for reason in reasons)])
    return message
