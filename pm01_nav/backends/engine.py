# SPDX-License-Identifier: Apache-2.0
"""What a physics engine has to do for ``PhysicsSimulator``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pm01_nav.robot import RobotSpec
from pm01_nav.worlds.world import World

FloatArray = NDArray[np.float64]

PHYSICS_DT = 0.005
"""One step of an engine [s], or the nearest that fits."""
TICK = 0.02
"""Time between two set points of wheels and movers [s], or the nearest that fits."""
WALL_THICKNESS = 0.002
"""Of walls that have none in the plane: 1 mm to each side [m]."""


@dataclass(frozen=True)
class Scenario:
    """Where a robot's episode begins."""

    world: int
    """Which of the engine's worlds."""
    pose: FloatArray
    """x, y, yaw of ``base_link`` [m, m, rad], shape (3,)."""
    movers: FloatArray
    """x, y of the world's movers [m], shape (n, 2)."""
    height: float = 0.0
    """Of the wheels above the floor [m]."""


@dataclass(frozen=True)
class Motion:
    """What a control step made of the robots; one row each, written by the engine."""

    pose: FloatArray
    """x, y, yaw of ``base_link`` [m, m, rad], shape (num_envs, 3)."""
    twist: FloatArray
    """v, w in ``base_link`` [m/s, rad/s], shape (num_envs, 2)."""
    contact: NDArray[np.bool_]
    """Whether the hull touched an obstacle in the step, shape (num_envs,)."""

    lost: dict[int, str] = field(default_factory=dict)
    """Why the engine lost robots; one that is not finite and not here diverged."""

    @classmethod
    def of(cls, num_envs: int) -> Motion:
        """Return room for so many robots."""
        pose, twist = np.zeros((num_envs, 3)), np.zeros((num_envs, 2))
        return cls(pose, twist, np.zeros(num_envs, dtype=np.bool_))


@dataclass(frozen=True)
class View:
    """What a camera shows of one robot's world."""

    eye: tuple[float, float, float]
    """Where the camera is [m]."""
    target: tuple[float, float, float]
    """Where it looks [m]."""
    size: tuple[int, int]
    """Width and height of the picture [px]."""
    goal: tuple[float, float]
    """Where a marker lies on the floor [m]."""
    goal_radius: float
    """[m]"""


def ticks_in(control_dt: float) -> int:
    """Return how many set points a control step [s] has."""
    return max(1, round(control_dt / TICK))


class Engine(Protocol):
    """Robots with weight and wheels on a floor, each alone in a world of its own."""

    @property
    def odometry(self) -> Motion | None:
        """Poses and twists by the robots' wheels since the last reset; None: they know the true."""
        ...

    def reset(self, i: int, scenario: Scenario) -> None:
        """Put robot ``i`` at rest where its scenario says."""
        ...

    def step(
        self,
        command: FloatArray,
        movers: FloatArray,
        motion: Motion,
        ranges: NDArray[np.float32],
    ) -> None:
        """Drive every robot for a control step; write what came of it.

        ``command`` (num_envs, 2) holds v and w [m/s, rad/s]; ``movers`` (ticks, num_envs, most
        movers, 2) [m] say where movers are at each tick's end. ``ranges`` is as for ``cast``. A row
        of ``motion.pose`` that is not finite says that the engine lost the robot; its ranges are
        left as they were.
        """
        ...

    def cast(self, indices: NDArray[np.int64], ranges: NDArray[np.float32]) -> None:
        """Write the exact ranges of some robots' lidars [m], infinity where nothing is hit.

        They go into these robots' rows of ``ranges`` (num_envs, at least num_beams).
        """
        ...

    def picture(self, i: int, view: View) -> NDArray[np.uint8]:
        """Return a picture of robot ``i``'s world, (height, width, 3).

        Raises:
            InputError: there is nothing to draw with.
        """
        ...

    def keep(self, indices: NDArray[np.int64]) -> None:
        """Go on with some of the robots only."""
        ...


MakeEngine = Callable[[RobotSpec, Sequence[World], int, float], Engine]
"""Prepares so many robots in some of the worlds, which get a command every so many seconds."""
