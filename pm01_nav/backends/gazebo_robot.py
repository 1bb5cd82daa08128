# SPDX-License-Identifier: Apache-2.0
"""A robot in a Gazebo of its own, with another server where one died."""

from __future__ import annotations

import os
import weakref
from collections import defaultdict

import numpy as np
from numpy.typing import NDArray

from pm01_nav.backends.engine import Scenario, View
from pm01_nav.backends.gazebo_exchange import Reading, Setup
from pm01_nav.backends.gazebo_worker import Cores, GazeboWorker, Opener, ServerLostError
from pm01_nav.errors import InputError
from pm01_nav.worlds.world import World

FloatArray = NDArray[np.float64]

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
