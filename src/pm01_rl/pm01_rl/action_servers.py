# SPDX-License-Identifier: Apache-2.0
"""Nav2's actions for goals: one errand at a time, whichever of them it came by."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped
from nav2_msgs.action import NavigateThroughPoses, NavigateToPose
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node

from pm01_rl.conversions import quaternion
from pm01_rl.goals import Errand, Outcome, is_place, result

ACTIONS = {"navigate_to_pose": NavigateToPose, "navigate_through_poses": NavigateThroughPoses}
RESULT_TIMEOUT_S = 2
"""Results are kept for so long for clients that ask late [s]. Humble counts from the acceptance, so
a client has to ask soon after it, as those of rclpy, rclcpp and Nav2 do. Each kept result costs
memory, and time for each new goal, since the status of all is published: by default for 900 s."""


class GoalServer(ActionServer):
    """An action server whose goals are executed elsewhere.

    rclpy's own way is a coroutine that waits for the end. Humble's executor resumes it over and
    over as long as it waits, which keeps a core busy for the whole drive.
    """

    def notify_execute(self, goal_handle: ServerGoalHandle, execute_callback: object) -> None:
        """Schedule how a goal ends; that it is executed from now on needs nothing to be done."""
        if execute_callback is not None:
            super().notify_execute(goal_handle, execute_callback)


class Client:
    """Who sent a goal by an action, and waits for its end."""

    def __init__(self, server: GoalServer, action: type, handle: ServerGoalHandle) -> None:
        """Say that the goal is executed from now on."""
        self.handle = handle
        self._server, self._action = server, action
        handle.execute()

    def end(self, outcome: Outcome) -> None:
        """Tell the end; once is enough, and all that rclpy allows."""
        self._server.notify_execute(self.handle, lambda _: self._finish(outcome))

    def _finish(self, outcome: Outcome) -> object:
        if outcome.kind == "arrived":
            self.handle.succeed()
        elif self.handle.is_cancel_requested:
            self.handle.canceled()
        else:
            self.handle.abort()
        return result(self._action, outcome)

    def tell(
        self, errand: Errand, header: tuple[Time, str], pose: np.ndarray | None, left: float
    ) -> None:
        """Tell where the robot is on its way.

        ``pose`` (3,) is the robot's in the frame of ``header``; ``left`` [m] is the straight way
        that remains, NaN where that is unknown.
        """
        message = self._action.Feedback()
        message.distance_remaining = left if math.isfinite(left) else -1.0
        message.navigation_time.sec = int(errand.elapsed)
        if hasattr(message, "number_of_poses_remaining"):
            message.number_of_poses_remaining = errand.remaining
        place = message.current_pose
        place.header.stamp, place.header.frame_id = header
        if pose is not None:
            place.pose.position.x, place.pose.position.y = float(pose[0]), float(pose[1])
            place.pose.orientation = quaternion(float(pose[2]))
        self.handle.publish_feedback(message)


class GoalServers:
    """The action servers of a node that drives to goals."""

    def __init__(
        self,
        node: Node,
        is_ready: Callable[[], bool],
        begin: Callable[[list[PoseStamped], Client], None],
        cancel: Callable[[ServerGoalHandle], None],
    ) -> None:
        """Serve ``ACTIONS`` on ``node``.

        ``is_ready`` tells whether goals are accepted, ``begin`` starts an errand instead of any
        other, ``cancel`` ends that of a handle.
        """
        self._node = node
        self._is_ready, self._begin, self._cancel = is_ready, begin, cancel
        self._servers = [self._serve(name, action) for name, action in ACTIONS.items()]

    def _serve(self, name: str, action: type) -> GoalServer:
        def accept(handle: ServerGoalHandle) -> None:
            self._begin(poses_of(handle.request), Client(server, action, handle))

        server = GoalServer(
            self._node,
            action,
            name,
            execute_callback=lambda _: None,
            goal_callback=self._on_goal,
            handle_accepted_callback=accept,
            cancel_callback=self._on_cancel,
            result_timeout=RESULT_TIMEOUT_S,
        )
        return server

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
        # What is scheduled here runs when the goal is in the state CANCELING.
        self._cancel(handle)
        return CancelResponse.ACCEPT


def poses_of(goal: object) -> list[PoseStamped]:
    """Return the poses of either action's goal."""
    return [goal.pose] if hasattr(goal, "pose") else list(goal.poses)
