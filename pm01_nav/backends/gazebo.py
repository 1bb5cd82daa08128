# SPDX-License-Identifier: Apache-2.0
"""Robots in Gazebo, stepped in lockstep: a server a robot, each in a process of its own."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pm01_nav.backends.engine import Motion, Scenario, View, ticks_in
from pm01_nav.backends.gazebo_exchange import Reading, Setup
from pm01_nav.backends.gazebo_model import server_world
from pm01_nav.backends.gazebo_robot import GazeboRobot
from pm01_nav.backends.gazebo_worker import (
    Opener,
    ServerLostError,
    cores_of,
    open_gazebo,
)
from pm01_nav.backends.physics import PhysicsSimulator
from pm01_nav.geometry import to_frame
from pm01_nav.robot import RobotSpec
from pm01_nav.worlds.pool import WorldPool
from pm01_nav.worlds.world import World

FloatArray = NDArray[np.float64]

PHYSICS_DT = 0.004
"""One step of Gazebo's physics [s], or the nearest that fits."""
DIED = "Gazebo's server died in the middle of the episode"


class GazeboSimulator(PhysicsSimulator):
    """Robots in Gazebo, which know their speed by their wheels, and their place as well.

    With ``localization`` "ground_truth" they know their place as if by a perfect map. An episode
    ends at the goal where the robot truly is.
    """

    def __init__(
        self, localization: str, robot: RobotSpec, pool: WorldPool, num_envs: int, **how: Any
    ) -> None:
        """Start ``num_envs`` servers; ``how`` is as for ``Simulator``."""
        super().__init__(GazeboEngine, robot, pool, num_envs, **how)
        self._localized = localization == "ground_truth"

    @property
    def _odometry(self) -> Motion:
        assert isinstance(self._engine, GazeboEngine)
        return self._engine.odometry

    @property
    def measured_pose(self) -> FloatArray:
        """Where the robot believes to be, like ``SimState.pose``."""
        return super().measured_pose if self._localized else self._odometry.pose

    @property
    def measured_goal(self) -> FloatArray:
        """Distance and bearing of the goal as the robot believes [m, rad], shape (num_envs, 2)."""
        if self._localized:
            return super().measured_goal
        x, y = to_frame(self.state.goal, self._odometry.pose).T
        return np.stack([np.hypot(x, y), np.arctan2(y, x)], axis=-1)

    @property
    def measured_twist(self) -> FloatArray:
        """The robot's v and w by odometry [m/s, rad/s], shape (num_envs, 2)."""
        return self._odometry.twist


class GazeboEngine:
    """One server a robot; see ``Engine``."""

    opener: Opener = staticmethod(open_gazebo)
    """What starts a server, in a process of its own."""

    def __init__(
        self, robot: RobotSpec, worlds: Sequence[World], num_envs: int, control_dt: float
    ) -> None:
        """Start ``num_envs`` servers, or take those that are left from earlier robots."""
        ticks = ticks_in(control_dt)
        iterations = max(1, round(control_dt / ticks / PHYSICS_DT))
        dt = control_dt / (ticks * iterations)
        setup = Setup(robot.lidar.num_beams, robot.driven_wheels.radius, ticks, iterations, dt)
        sdf = server_world(robot, dt, control_dt)
        self._worlds = worlds
        self._robots = [
            GazeboRobot(sdf, setup, self.opener, cores_of(i, num_envs)) for i in range(num_envs)
        ]
        self.odometry = Motion.of(num_envs)
        """Where the robots are and how fast, by their wheels since the last reset."""
        self._ranges = np.zeros((num_envs, robot.lidar.num_beams), dtype=np.float32)

    def reset(self, i: int, scenario: Scenario) -> None:
        """Let a server put its robot at rest where its scenario says; ``cast`` waits for it."""
        self._robots[i].reset(scenario, self._worlds[scenario.world])

    def cast(self, indices: NDArray[np.int64], ranges: NDArray[np.float32]) -> None:
        """Write the ranges of some robots' lidars [m]; see ``Engine``."""
        for i in indices.tolist():
            reading = self._robots[i].after_reset()
            if reading is not None:
                self._note(i, reading)
        ranges[indices, : self._ranges.shape[1]] = self._ranges[indices]

    def step(
        self,
        command: FloatArray,
        movers: FloatArray,
        motion: Motion,
        ranges: NDArray[np.float32],
    ) -> None:
        """Drive every robot for a control step, all at the same time; see ``Engine``."""
        for i, robot in enumerate(self._robots):
            robot.start_step(command[i], movers[:, i])
        for i, robot in enumerate(self._robots):
            try:
                reading = robot.after_step()
            except ServerLostError as error:
                motion.pose[i] = np.nan
                motion.lost[i] = f"{DIED}{error}"
                continue
            motion.pose[i], motion.twist[i] = reading.pose, reading.twist
            motion.contact[i] = reading.contact
            self._note(i, reading)
        self.cast(np.flatnonzero(np.isfinite(motion.pose[:, 0])), ranges)

    def _note(self, i: int, reading: Reading) -> None:
        self.odometry.pose[i] = reading.odometry_pose
        self.odometry.twist[i] = reading.odometry_twist
        self._ranges[i] = reading.ranges

    def picture(self, i: int, view: View) -> NDArray[np.uint8]:
        """Return a picture of robot ``i``'s world, (height, width, 3); see ``Engine``."""
        return self._robots[i].picture(view)

    def keep(self, indices: NDArray[np.int64]) -> None:
        """Go on with some of the robots only."""
        self._robots = [self._robots[i] for i in indices]
        self._ranges = self._ranges[indices]
        odometry = self.odometry
        self.odometry = Motion(
            odometry.pose[indices], odometry.twist[indices], odometry.contact[indices]
        )
