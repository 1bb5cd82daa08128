# SPDX-License-Identifier: Apache-2.0
"""What happened in one control step, for reward terms and end conditions to read.

All of it is true, whatever the robot's sensors and odometry say, but for ``visited``. What takes
time is computed only where a term of the task says that it ``needs`` it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from pm01_nav.errors import InputError

ON_DEMAND = {"path_distance": "path_distances", "visited": "trail"}
"""What a term may need, and the simulator's feature (``sim.settings``) that it comes from."""


class OnDemand:
    """A field of ``Step`` that is None where no term needs it, and is then refused to readers."""

    def __init__(self, need: str) -> None:
        """Belong to one of ``ON_DEMAND``."""
        self._need = need

    def __set_name__(self, owner: type, name: str) -> None:
        """Learn the field's name."""
        self._name = name

    def __get__(self, step: Step | None, owner: type | None = None) -> Any:
        """Return the value.

        Raises:
            InputError: it was not computed.
        """
        if step is None:
            raise AttributeError(self._name)  # It tells the dataclass that there is no default.
        value = step.__dict__[self._name]
        if value is None:
            raise InputError(
                f"step.{self._name} is not computed for this task: the reward term that reads it "
                f'must say so: @reward_term(needs=("{self._need}",))'
            )
        return value

    def __set__(self, step: Step, value: Any) -> None:
        """Keep the value."""
        step.__dict__[self._name] = value


@dataclass
class Step:
    """One control step of the whole batch; arrays of one kind (numpy or another array API)."""

    xp: Any
    """Namespace of the arrays."""
    pose: Any
    """x, y, yaw in the world [m, m, rad], shape (num_envs, 3)."""
    twist: Any
    """Speed of each of the drive's axes in base_link [m/s, rad/s], shape (num_envs, axes)."""
    command: Any
    """The same as commanded, shape (num_envs, axes)."""
    read_scan: Any
    """Function that returns ``scan``; it is cast only where it is asked for."""
    read_mover_gap: Any
    """Function that returns ``mover_gap``."""
    clearance: Any
    """From the footprint to the nearest obstacle [m], shape (num_envs,)."""
    contact: Any
    """Whether an obstacle stopped the robot, shape (num_envs,)."""
    goal_distance: Any
    """[m], shape (num_envs,)."""
    goal_bearing: Any
    """Direction of the goal in base_link [rad], shape (num_envs,)."""
    previous_goal_distance: Any
    """Goal distance before the step [m], shape (num_envs,)."""
    count: Any
    """Steps of the episode so far, this one included, shape (num_envs,)."""
    path_distance: Any = OnDemand("path_distance")
    """Length of the way to the goal [m], shape (num_envs,)."""
    previous_path_distance: Any = OnDemand("path_distance")
    """The same before the step [m], shape (num_envs,)."""
    visited: Any = OnDemand("visited")
    """What the trail shows by odometry, shape (num_envs, trail size)."""
    faults: dict[int, str] = field(default_factory=dict)
    """Environments that the simulator lost, with the reason."""
    action: Any = None
    """Actions in [-1, 1], shape (num_envs, axes)."""
    previous_action: Any = None
    """Actions of the step before, zero at first, shape (num_envs, axes)."""
    reached: Any = None
    """Whether the goal was reached, shape (num_envs,)."""
    collided: Any = None
    """Whether the episode ends in a collision, shape (num_envs,)."""

    @cached_property
    def scan(self) -> Any:
        """Lidar ranges by REP-117 [m], shape (num_envs, num_beams)."""
        return self.read_scan()

    @cached_property
    def nearest_return(self) -> Any:
        """Nearest range of the scan [m], shape (num_envs,)."""
        return self.xp.min(self.scan, axis=-1)

    @cached_property
    def mover_gap(self) -> Any:
        """From the circle around the footprint to the nearest mover [m], shape (num_envs,)."""
        return self.read_mover_gap()
