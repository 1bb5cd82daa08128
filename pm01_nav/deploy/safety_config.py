# SPDX-License-Identifier: Apache-2.0
"""What the safety supervisor can be told."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, fields

from pm01_nav.errors import InputError


@dataclass(frozen=True)
class SafetyConfig:
    """When to stop and when to slow down; times in seconds, lengths in metres."""

    scan_timeout_s: float = 0.5
    """A scan older than this stops the robot: two and a half turns of a lidar at 5 Hz."""
    odometry_timeout_s: float = 0.3
    transform_timeout_s: float = 1.0
    clock_jump_s: float = 1.0
    """Stamps that go back, or run ahead, by more than this are a jump."""
    valid_share_min: float = 0.5
    """A scan with a smaller share of valid beams is unusable; one with a smaller share of them in
    the direction of travel lets the robot turn only."""
    frozen_scan_s: float = 1.0
    """A lidar that repeats one scan while the robot moves for so long in all is broken."""
    padding: float = 0.02
    """The outline is larger by this to every side [m]."""
    reaction_s: float = 0.15
    """From a command until the base has taken it up: transport and lag, beside a control step."""
    time_to_collision_s: float = 0.6
    """In the slow-down zone the robot goes so slowly that contact is at least this far away."""
    obstacle_speed: float = 0.0
    """Obstacles may come nearer at this speed [m/s]; 0 takes them for standing."""

    def __post_init__(self) -> None:
        """Refuse what could not protect.

        Raises:
            InputError: names the first number that is out of range.
        """
        for name, value in asdict(self).items():
            least = 0.0 if name in ("padding", "obstacle_speed", "valid_share_min") else 1e-3
            if not least <= value < math.inf:
                raise InputError(f"safety.{name} = {value}: must be {least:g} or more, and finite")

    @classmethod
    def names(cls) -> list[str]:
        """Name the settings in order."""
        return [f.name for f in fields(cls)]
