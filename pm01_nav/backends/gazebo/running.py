# SPDX-License-Identifier: Apache-2.0
# pyright: reportMissingImports=false
"""The robot of a Gazebo that runs already, as a batch of one, stepped over its transport.

What is known of the robot is what its topics say: its pose is its odometry, counted from the last
reset, and a collision is what the plane makes of that pose. Obstacles are those of the world that
the task names, which must be the one that Gazebo has loaded.
"""

from __future__ import annotations

import re
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from gz.msgs10.boolean_pb2 import Boolean
from gz.msgs10.empty_pb2 import Empty
from gz.msgs10.laserscan_pb2 import LaserScan
from gz.msgs10.odometry_pb2 import Odometry
from gz.msgs10.pose_pb2 import Pose
from gz.msgs10.scene_pb2 import Scene
from gz.msgs10.twist_pb2 import Twist
from gz.msgs10.world_control_pb2 import WorldControl
from gz.msgs10.world_stats_pb2 import WorldStatistics
from gz.transport13 import Node
from numpy.typing import NDArray

from pm01_nav.backends.engine import Motion, Scenario, View
from pm01_nav.backends.gazebo.config import GazeboConfig
from pm01_nav.backends.gazebo.messages import (
    SilentError,
    StampedStream,
    nanoseconds,
    pose_of,
    pose_since,
    ranges_of,
    subscribe,
    twist_of,
)
from pm01_nav.errors import InputError
from pm01_nav.robot import RobotSpec
from pm01_nav.worlds.world import World

FloatArray = NDArray[np.float64]

REQUEST_MS = 200
"""Limit for the answer of a service; what it does shows in the topics."""
FOUND_S = 5.0
"""Limit for finding a world and its topics, and for its statistics."""
SILENCE_S = 10.0
"""Limit for what belongs to a step."""
MEASURED_STEPS = 50
"""Steps of the physics from which the length of one is known."""
REST_STEPS, AT_REST = 30, 2e-3
"""A robot without a command stands still after so many control steps, slower than this."""
START = "start one with: ros2 launch pm01_gazebo pm01_world.launch.py"


class RunningEngine:
    """One robot in a Gazebo that others started, paused between our steps; see ``Engine``."""

    odometry = None
    """The robot is where its odometry says."""

    def __init__(
        self,
        address: GazeboConfig,
        robot: RobotSpec,
        worlds: Sequence[World],
        num_envs: int,
        control_dt: float,
    ) -> None:
        """Find the world, pause it and measure its steps.

        Raises:
            InputError: there is no such world or topic, or its steps do not fit ``control_dt`` [s].
        """
        self._address, self._num_beams = address, robot.lidar.num_beams
        self._ranges = np.zeros(self._num_beams, dtype=np.float32)
        self._node = Node()
        self._world = self._find_world()
        self._check_model()
        self._scans = subscribe(self._node, self._find_topic("scan"), LaserScan)
        self._odometer = subscribe(self._node, self._find_topic("odom"), Odometry)
        self._command = self._node.advertise(address.topic("cmd_vel"), Twist)
        self._time_ns, step_ns = self._pause_and_measure()
        self._period_ns = round(control_dt * 1e9)
        self._iterations = round(self._period_ns / step_ns)
        if abs(self._iterations * step_ns - self._period_ns) > 1000:
            raise InputError(
                f"world {self._world}: its steps of {step_ns / 1e6:g} ms do not fit a control step "
                f"of {control_dt:g} s; change max_step_size in its physics"
            )
        self._align()
        self._anchor: tuple[FloatArray, FloatArray] = (np.zeros(3), np.zeros(3))

    def reset(self, i: int, scenario: Scenario) -> None:
        """Put the robot at rest where its scenario says.

        Raises:
            InputError: Gazebo has no such robot, or it does not come to rest.
        """
        pose = scenario.pose
        self._publish(np.zeros(2))
        self._teleport(pose)
        for _ in range(REST_STEPS):
            if np.abs(twist_of(self._step())).max() < AT_REST:
                break
        else:
            raise InputError(
                f"{self._odometer.topic}: the robot does not come to rest at {pose.round(3)}; "
                "does another program publish commands?"
            )
        self._teleport(pose)
        self._anchor = (pose.copy(), pose_of(self._step()))

    def step(
        self,
        command: FloatArray,
        movers: FloatArray,
        motion: Motion,
        ranges: NDArray[np.float32],
    ) -> None:
        """Drive the robot for a control step; see ``Engine``.

        Raises:
            InputError: the scan or the odometry of the step does not come.
        """
        self._publish(command[0])
        odometry = self._step()
        motion.pose[0] = pose_since(*self._anchor, pose_of(odometry))
        motion.twist[0], motion.contact[0] = twist_of(odometry), False
        self.cast(np.array([0]), ranges)

    def cast(self, indices: NDArray[np.int64], ranges: NDArray[np.float32]) -> None:
        """Write the ranges of the robot's lidar [m]; see ``Engine``."""
        ranges[indices, : self._num_beams] = self._ranges

    def picture(self, i: int, view: View) -> NDArray[np.uint8]:
        """Refuse: the window of the Gazebo that runs shows more."""
        raise InputError("render: Gazebo has a window of its own; use --backend gazebo for videos")

    def keep(self, indices: NDArray[np.int64]) -> None:
        """Go on with the robot."""

    def _find_world(self) -> str:
        """Return the name of the world that is meant."""
        wanted, found = self._address.world, set()
        end = time.monotonic() + FOUND_S
        while time.monotonic() < end and not (wanted in found or (found and not wanted)):
            names = self._node.service_list()
            found = {m[1] for n in names if (m := re.fullmatch(r"/world/([^/]+)/control", n))}
        if not found:
            raise InputError(
                f"backend = 'gazebo_transport': no Gazebo answers; {START}. GZ_PARTITION and GZ_IP "
                "must be the same here as there"
            )
        names = ", ".join(sorted(found))
        if wanted and wanted not in found:
            raise InputError(f"gazebo.world = {wanted!r}: does not run; running: {names}")
        if len(found) > 1 and not wanted:
            raise InputError(f"gazebo.world: several run; give one of {names}")
        return wanted or found.pop()

    def _check_model(self) -> None:
        """Refuse a robot that is not there, as far as the world tells of its models."""
        service = f"/world/{self._world}/scene/info"
        done, scene = self._node.request(service, Empty(), Empty, Scene, REQUEST_MS)
        models = sorted(model.name for model in scene.model)
        if done and self._address.model not in models:
            raise InputError(
                f"gazebo.model = {self._address.model!r}: not in world {self._world}; its models: "
                f"{', '.join(models)}"
            )

    def _find_topic(self, name: str) -> str:
        """Return the address of a topic that is published."""
        topic, end = self._address.topic(name), time.monotonic() + FOUND_S
        topics: list[str] = []
        while time.monotonic() < end and topic not in topics:
            topics = list(self._node.topic_list())
        if topic not in topics:
            alike = [other for other in topics if other.rstrip("/").endswith(name)]
            hint = f"there is {', '.join(alike)}: set task.gazebo.namespace" if alike else START
            raise InputError(f"{topic}: nobody publishes it in world {self._world}; {hint}")
        return topic

    def _pause_and_measure(self) -> tuple[int, int]:
        """Return the time at which the world stands still now, and what one step adds [ns]."""
        topic = f"/world/{self._world}/stats"
        # Without stamps: in a paused world simulation time stands still.
        statistics = subscribe(self._node, topic, WorldStatistics, lambda _: 0)
        self._control(WorldControl(pause=True))
        before = self._standing(statistics)
        self._control(WorldControl(pause=True, multi_step=MEASURED_STEPS))
        after = before
        end = time.monotonic() + FOUND_S
        while after == before and time.monotonic() < end:
            after = self._standing(statistics)
        self._node.unsubscribe(topic)
        if after == before:
            raise InputError(f"world {self._world}: does not step; is it a playback of a log?")
        return after, (after - before) // MEASURED_STEPS

    def _standing(self, statistics: StampedStream) -> int:
        """Return the simulation time of a world once it is paused [ns]."""
        end = time.monotonic() + FOUND_S
        while time.monotonic() < end:
            try:
                statistics.clear()
                message = statistics.wait(0, FOUND_S)
            except SilentError as error:
                raise InputError(str(error)) from error
            if message.paused:
                return nanoseconds(message.sim_time)
        raise InputError(f"world {self._world}: does not pause")

    def _align(self) -> None:
        """Step to where a control step begins, so that its scan lies at its end."""
        step_ns = self._period_ns // self._iterations
        missing = -self._time_ns % self._period_ns // step_ns
        if missing:
            self._control(WorldControl(pause=True, multi_step=missing))
            self._time_ns += missing * step_ns

    def _publish(self, command: FloatArray) -> None:
        twist = Twist()
        twist.linear.x, twist.angular.z = float(command[0]), float(command[1])
        self._command.publish(twist)

    def _step(self) -> Any:
        """Run one control step; note the ranges that belong to its end, return the odometry."""
        self._time_ns += self._period_ns
        self._control(WorldControl(pause=True, multi_step=self._iterations))
        # Whatever the lidar's phase, one scan lies within the step.
        begin = self._time_ns - self._period_ns + 1
        try:
            scan = self._scans.wait(begin, SILENCE_S)
            odometry = self._odometer.wait(begin, SILENCE_S)
        except SilentError as error:
            raise InputError(
                f"world {self._world}: {error}. Did Gazebo end? Is its lidar slower than the "
                "control step, or does the world lack the Sensors system?"
            ) from error
        self._ranges = ranges_of(scan, self._num_beams, self._scans.topic)
        return odometry

    def _teleport(self, pose: FloatArray) -> None:
        request = Pose(name=self._address.model)
        x, y, yaw = pose.tolist()
        request.position.x, request.position.y, request.position.z = x, y, 0.0
        request.orientation.z, request.orientation.w = np.sin(yaw / 2.0), np.cos(yaw / 2.0)
        service = f"/world/{self._world}/set_pose"
        # It answers at once, whether there is such a model or not.
        self._node.request(service, request, Pose, Boolean, REQUEST_MS)

    def _control(self, request: WorldControl) -> None:
        """Ask for steps or a pause; an answer that is late does not matter."""
        service = f"/world/{self._world}/control"
        self._node.request(service, request, WorldControl, Boolean, REQUEST_MS)
