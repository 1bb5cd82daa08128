# SPDX-License-Identifier: Apache-2.0
"""Nav2's actions for goals: one errand at a time, whichever of them it came by."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped
from nav2_msgs.action import NavigateThroughPoses, NavigateToPose
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node

from pm01_rl.conversions import quaternion
from pm01_rl.goals import Errand, is_place, result

ACTIONS = {"navigate_to_pose": NavigateToPose, "navigate_through_poses": NavigateThroughPoses}
RESULT_TIMEOUT_S = 10
"""Results are kept for so long for clients that ask late [s]; rclpy's 900 s cost memory, and time
for each new goal."""


class GoalServers:
    """The action servers of a node that drives to goals."""

    def __init__(
        self,
        node: Node,
        is_ready: Callable[[], bool],
        begin: Callable[[list[PoseStamped], ServerGoalHandle], Errand],
        cancel: Callable[[ServerGoalHandle], None],
    ) -> None:
        """Serve ``ACTIONS`` on ``node``.

        ``is_ready`` tells whether goals are accepted, ``begin`` starts an errand instead of any
        other, ``cancel`` ends that of a handle.
        """
        self._is_ready, self._begin, self._cancel = is_ready, begin, cancel
        self._servers = [
            ActionServer(
                node,
                kind,
                name,
                self._execute,
                goal_callback=self._on_goal,
                cancel_callback=self._on_cancel,
                result_timeout=RESULT_TIMEOUT_S,
            )
            for name, kind in ACTIONS.items()
        ]

    def destroy(self) -> None:
        """Serve no longer."""
        for server in self._servers:
            server.destroy()
        self._servers.clear()

    def _on_goal(self, goal: object) -> GoalResponse:
        poses = poses_of(goal)
        ready = self._is_ready() and poses and all(map(is_place, poses))
        return GoalResponse.ACCEPT if ready else GoalResponse.REJECT

    def _on_cancel(self, handle: ServerGoalHandle) -> CancelResponse:
        # The errand's coroutine goes on after this callback: then the goal is in state CANCELING.
        self._cancel(handle)
        return CancelResponse.ACCEPT

    async def _execute(self, handle: ServerGoalHandle) -> object:
        """Wait for the errand's end: a coroutine, so that one thread serves any number of them."""
        outcome = await self._begin(poses_of(handle.request), handle).ended
        if outcome.kind == "arrived":
            handle.succeed()
        elif handle.is_cancel_requested:
            handle.canceled()
        else:
            handle.abort()
        return result(kind_of(handle.request), outcome)


def poses_of(goal: object) -> list[PoseStamped]:
    """Return the poses of either action's goal."""
    return [goal.pose] if hasattr(goal, "pose") else list(goal.poses)


def kind_of(goal: object) -> type:
    """Return the action that a goal is of."""
    return NavigateToPose if isinstance(goal, NavigateToPose.Goal) else NavigateThroughPoses


def publish_feedback(
    errand: Errand, pose: np.ndarray | None, header: tuple[Time, str], elapsed: float, left: float
) -> None:
    """Tell an errand's client where the robot is on its way.

    ``pose`` (3,) is the robot's in the frame of ``header``; ``elapsed`` [s] is since the goal came,
    ``left`` [m] the straight way that remains, NaN where that is unknown.
    """
    message = kind_of(errand.handle.request).Feedback()
    message.distance_remaining = left if left == left else -1.0
    message.navigation_time.sec = int(elapsed)
    if hasattr(message, "number_of_poses_remaining"):
        message.number_of_poses_remaining = errand.remaining
    place = message.current_pose
    place.header.stamp, place.header.frame_id = header
    if pose is not None:
        place.pose.position.x, place.pose.position.y = float(pose[0]), float(pose[1])
        place.pose.orientation = quaternion(float(pose[2]))
    errand.handle.publish_feedback(message)
