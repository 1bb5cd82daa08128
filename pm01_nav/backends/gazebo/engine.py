# SPDX-License-Identifier: Apache-2.0
"""Robots in Gazebo, stepped in lockstep: a server a robot, each in a process of its own."""

from __future__ import annotations

import os
import weakref
from collections import defaultdict
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pm01_nav.backends.engine import Motion, Scenario, View, ticks_in
from pm01_nav.backends.gazebo.model import server_world
from pm01_nav.backends.gazebo.worker import (
    Cores,
    GazeboWorker,
    Opener,
    Reading,
    ServerLostError,
    Setup,
    cores_of,
    open_gazebo,
)
from pm01_nav.errors import InputError
from pm01_nav.robot import RobotSpec
from pm01_nav.worlds.world import World

FloatArray = NDArray[np.float64]

PHYSICS_DT = 0.004
"""One step of Gazebo's physics [s], or the nearest that fits."""
DIED = "Gazebo's server died in the middle of the episode"
MOST_RESTARTS = 1
"""Of a robot's server after its process died; then something is wrong with the machine."""
MOST_MEMORY_MB = 1500.0
"""Of a server that is kept: Gazebo does not give back all that removed obstacles took."""

Kind = tuple[int, str, Setup, Opener, Cores]


class IdleServers:
    """Servers whose robots are no longer needed; starting one takes seconds."""

    def __init__(self) -> None:
        """Have none yet."""
        self._workers: defaultdict[Kind, list[GazeboWorker]] = defaultdict(list)

    def take(self, sdf: str, setup: Setup, opener: Opener, cores: Cores) -> GazeboWorker:
        """Return a server that is left or a new one."""
        # A process that was forked must not talk to its parent's servers.
        left = self._workers[os.getpid(), sdf, setup, opener, cores]
        while left:
            worker = left.pop()
            if worker.idle:
                return worker
        return GazeboWorker(sdf, setup, opener, cores)

    def give_back(
        self, worker: GazeboWorker, sdf: str, setup: Setup, opener: Opener, cores: Cores
    ) -> None:
        """Keep a server for the next robot, if it still answers and did not grow too much."""
        if worker.idle and worker.memory_mb < MOST_MEMORY_MB:
            self._workers[os.getpid(), sdf, setup, opener, cores].append(worker)
        else:
            worker.close()

    def close(self) -> None:
        """Stop them all."""
        for workers in self._workers.values():
            for worker in workers:
                worker.close()
        self._workers.clear()


IDLE = IdleServers()


class GazeboRobot:
    """One robot and its server."""

    def __init__(self, sdf: str, setup: Setup, opener: Opener, cores: Cores) -> None:
        """Start a server on the world ``sdf``, or take one that is left."""
        self._kind = (sdf, setup, opener, cores)
        self._restarts = 0
        self._reset: tuple[Scenario, World] | None = None
        self._take()

    def _take(self) -> None:
        self._worker = IDLE.take(*self._kind)
        self._world = -1
        self._release = weakref.finalize(self, IDLE.give_back, self._worker, *self._kind)

    def reset(self, scenario: Scenario, world: World) -> None:
        """Let the server put the robot at rest in a world; ``after_reset`` waits for it."""
        self._reset = scenario, world
        self._worker.send("reset", scenario, None if scenario.world == self._world else world)
        self._world = scenario.world

    def after_reset(self) -> Reading | None:
        """Return what the robot perceives where it was put; None if it was not since the last call.

        Raises:
            InputError: the server cannot do it, or died again.
        """
        if self._reset is None:
            return None
        try:
            reading = self._worker.receive()
        except ServerLostError as error:
            self._restart(error)
            self.reset(*self._reset)
            return self.after_reset()
        self._reset = None
        return reading

    def _restart(self, error: ServerLostError) -> None:
        if self._restarts >= MOST_RESTARTS:
            raise InputError(
                f"Gazebo's server died again{error}. Next: run `gz sim -s -r` on any world to see "
                "whether Gazebo works here, and `pm01 doctor`"
            )
        self._restarts += 1
        self._release()
        self._take()

    def start_step(self, command: FloatArray, movers: FloatArray) -> None:
        """Let the server drive for a control step; see ``Server.step``."""
        self._worker.send("step", command, movers)

    def after_step(self) -> Reading:
        """Return what came of the step.

        Raises:
            ServerLostError: the server died; the next reset starts another.
            InputError: the server could not do it.
        """
        return self._worker.receive()

    def picture(self, view: View) -> NDArray[np.uint8]:
        """Return a picture of the robot's world; see ``Server.picture``."""
        self._worker.send("picture", view)
        return self._worker.receive()


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
