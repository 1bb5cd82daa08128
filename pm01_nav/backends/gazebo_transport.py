# SPDX-License-Identifier: Apache-2.0
"""The robot of a Gazebo that runs already as a batch of one."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pm01_nav.backends.engine import Motion, Scenario, View
from pm01_nav.backends.gazebo_config import GazeboConfig
from pm01_nav.backends.physics import PhysicsSimulator
from pm01_nav.errors import InputError
from pm01_nav.robot import RobotSpec
from pm01_nav.worlds.pool import WorldPool
from pm01_nav.worlds.world import World

FloatArray = NDArray[np.float64]


class RunningGazeboSimulator(PhysicsSimulator):
    """A robot in a Gazebo that others started; it is where its odometry says."""

    def __init__(
        self, address: GazeboConfig, robot: RobotSpec, pool: WorldPool, num_envs: int, **how: Any
    ) -> None:
        """Find the robot; ``how`` is as for ``Simulator``.

        Raises:
            InputError: there are several robots or worlds to drive in, Gazebo has none such, or
                the robot shall know its place otherwise.
        """
        if address.localization != "odometry":
            raise InputError(
                f"task.gazebo.localization = {address.localization!r}: a robot of "
                "gazebo_transport knows its place by odometry only"
            )
        if num_envs != 1 or len(pool) != 1:
            raise InputError(
                "backend = 'gazebo_transport': drives one robot in the one world that runs; give "
                "that world with --task map --map WORLD.sdf"
            )
        if any(world.movers for world in pool.worlds):
            raise InputError("backend = 'gazebo_transport': cannot know where movers are")
        super().__init__(partial(RunningEngine, address), robot, pool, num_envs, **how)

    def step(self, command: ArrayLike) -> None:
        """Apply velocity commands (1, 2) [m/s, rad/s] for one control step."""
        super().step(command)
        # Nothing tells of a touch but where the robot is.
        self.state.contact[:] |= self.state.clearance <= 0.0


class RunningEngine:
    """One robot over Gazebo's transport; see ``Engine``."""

    def __init__(
        self,
        address: GazeboConfig,
        robot: RobotSpec,
        worlds: Sequence[World],
        num_envs: int,
        control_dt: float,
    ) -> None:
        """Find the robot in the world that runs."""
        from pm01_nav.backends.gazebo_client import RunningGazebo

        self._gazebo = RunningGazebo(address, robot.lidar.num_beams, control_dt)
        self._ranges = np.zeros(robot.lidar.num_beams, dtype=np.float32)

    def reset(self, i: int, scenario: Scenario) -> None:
        """Put the robot at rest where its scenario says."""
        _, _, self._ranges = self._gazebo.reset(scenario.pose)

    def step(
        self,
        command: FloatArray,
        movers: FloatArray,
        motion: Motion,
        ranges: NDArray[np.float32],
    ) -> None:
        """Drive the robot for a control step; see ``Engine``."""
        motion.pose[0], motion.twist[0], self._ranges = self._gazebo.step(command[0])
        motion.contact[0] = False
        self.cast(np.array([0]), ranges)

    def cast(self, indices: NDArray[np.int64], ranges: NDArray[np.float32]) -> None:
        """Write the ranges of the robot's lidar [m]; see ``Engine``."""
        ranges[indices, : len(self._ranges)] = self._ranges

    def picture(self, i: int, view: View) -> NDArray[np.uint8]:
        """Refuse: the window of the Gazebo that runs shows more."""
        raise InputError("render: Gazebo has a window of its own; use --backend gazebo for videos")

    def keep(self, indices: NDArray[np.int64]) -> None:
        """Go on with the robot."""
