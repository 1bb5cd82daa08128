# SPDX-License-Identifier: Apache-2.0
"""What goes between Gazebo's server and who steps it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pm01_nav.backends.engine import Scenario, View
from pm01_nav.worlds.world import World

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Setup:
    """What a server has to know of the robot and its steps."""

    num_beams: int
    wheel_radius: float
    """Height of ``base_link`` [m]."""
    ticks: int
    """Set points of movers in a control step."""
    iterations: int
    """Steps of the physics in a tick."""
    physics_dt: float
    """[s]"""

    @property
    def control_dt(self) -> float:
        """Time between two commands [s]."""
        return self.ticks * self.iterations * self.physics_dt


@dataclass(frozen=True)
class Reading:
    """What came of a control step or a reset."""

    pose: FloatArray
    """x, y, yaw of ``base_link`` [m, m, rad], shape (3,)."""
    twist: FloatArray
    """v, w in ``base_link`` [m/s, rad/s], shape (2,)."""
    odometry_pose: FloatArray
    """Where the wheels say that it is; at a reset, where it is. Like ``pose``."""
    odometry_twist: FloatArray
    """What the wheels say of v and w. Like ``twist``."""
    contact: bool
    """Whether the hull touched something."""
    ranges: NDArray[np.float32]
    """Of the beams, infinity where nothing is hit [m], shape (num_beams,)."""


class Server(Protocol):
    """A Gazebo with one robot, whether it runs here or elsewhere."""

    def reset(self, scenario: Scenario, world: World | None) -> Reading:
        """Put the robot at rest where its scenario says.

        Obstacles and movers of ``world`` replace those that are there; None leaves all as it is.
        """
        ...

    def step(self, command: FloatArray, movers: FloatArray) -> Reading:
        """Drive for a control step by v and w (2,) [m/s, rad/s].

        ``movers`` (ticks, at least n, 2) [m] says where movers are at each tick's end.
        """
        ...

    def picture(self, view: View) -> NDArray[np.uint8]:
        """Return a picture of the world, (height, width, 3)."""
        ...
