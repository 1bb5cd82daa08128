# SPDX-License-Identifier: Apache-2.0
"""Servers that play Gazebo's part in a process of their own, and some that fail at it."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np

from pm01_nav.backends.engine import Scenario, View
from pm01_nav.backends.gazebo.worker import Reading, Setup
from pm01_nav.errors import InputError
from pm01_nav.geometry import after_twist
from pm01_nav.worlds.world import World

SLIP = 0.9
"""The robot moves by so much of what its wheels say."""


class PlayedServer:
    """A robot that goes where it is told at once; it sees 1 m in all directions."""

    def __init__(self, world: Path, setup: Setup) -> None:
        """Read what a server would be started with."""
        assert world.read_text(encoding="utf-8").startswith("<sdf")
        self._setup = setup
        self._pose = self._odometry = np.zeros(3)
        self.replaced = 0

    def reset(self, scenario: Scenario, world: World | None) -> Reading:
        """Stand where the scenario says."""
        self.replaced += world is not None
        self._pose = self._odometry = scenario.pose
        return self._reading(np.zeros(2))

    def step(self, command: np.ndarray, movers: np.ndarray) -> Reading:
        """Move, with wheels that slip."""
        self._odometry = after_twist(self._odometry, command, self._setup.control_dt)
        self._pose = after_twist(self._pose, SLIP * command, self._setup.control_dt)
        return self._reading(command)

    def picture(self, view: View) -> np.ndarray:
        """Return a black picture."""
        width, height = view.size
        return np.zeros((height, width, 3), dtype=np.uint8)

    def _reading(self, twist: np.ndarray) -> Reading:
        ranges = np.ones(self._setup.num_beams, dtype=np.float32)
        # The first beam tells how often obstacles were replaced.
        ranges[0] += self.replaced
        return Reading(self._pose, SLIP * twist, self._odometry, twist, False, ranges)


class DyingServer(PlayedServer):
    """Dies in the third step, once: a file tells those who come after that it happened."""

    steps = 0
    always = False

    def step(self, command: np.ndarray, movers: np.ndarray) -> Reading:
        """Die in the third step."""
        self.steps += 1
        if self.steps == 3 or self.always:
            sys.stderr.write("[Err] ogre: out of memory\n")
            sys.stderr.flush()
            os._exit(7)
        return super().step(command, movers)


class SilentServer(PlayedServer):
    """Its lidar falls silent after the reset."""

    def step(self, command: np.ndarray, movers: np.ndarray) -> Reading:
        """Give up."""
        raise InputError("/scan: no message of 0.200 s or later in 20 s; none at all came")


def steady(world: Path, setup: Setup) -> PlayedServer:
    """Start a server that works."""
    return PlayedServer(world, setup)


def dying(world: Path, setup: Setup) -> PlayedServer:
    """Start a server that dies in its third step."""
    return DyingServer(world, setup)


def silent(world: Path, setup: Setup) -> PlayedServer:
    """Start a server whose lidar falls silent."""
    return SilentServer(world, setup)


def without_robot(world: Path, setup: Setup) -> PlayedServer:
    """Start a server in which no robot is."""
    raise InputError("Gazebo started without the robot; see its log")
