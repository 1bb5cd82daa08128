# SPDX-License-Identifier: Apache-2.0
"""What a drive is: all that a velocity command means to a base, in numpy alone.

A drive is one class, entered in the table by ``@drive``. It has an axis for each number of a
command, and of a measured twist: forwards (x), to the left (y) and the turn (yaw) of ``base_link``.
"""

from __future__ import annotations

import math
from abc import ABC
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any, ClassVar, Literal, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pm01_nav.arrays import array_namespace
from pm01_nav.errors import InputError

FloatArray = NDArray[np.float64]
AxisName = Literal["x", "y", "yaw"]
BOX, ELLIPSE = 0, 1
"""How the speeds of the axes limit each other: not at all, or x and y as in an ellipse."""
PLANAR: tuple[AxisName, ...] = ("x", "y", "yaw")


@dataclass(frozen=True)
class Drive(ABC):
    """What commands, one number for each axis [m/s, rad/s], mean to a base with these limits.

    The fields are the limits of speed, by the names that they have in a robot's description; they
    stand in an exported policy's metadata.
    """

    name: ClassVar[str]
    """By which a robot's description calls it."""
    axes: ClassVar[tuple[AxisName, ...]]
    """What the numbers of a command stand for, in order."""
    has_wheels: ClassVar[bool]
    """Whether a description must say where its driven wheels are."""
    identified_by: ClassVar[str | None] = None
    """The model that is fitted to what such a base did (``deploy.base_fit``); None if none is."""

    linear_min: float
    linear_max: float
    angular_max: float
    acceleration: tuple[float, ...] = field(default=(), compare=False, kw_only=True)
    """Of each axis [m/s^2, rad/s^2]; none where they are not known, as for a policy's file."""

    @classmethod
    def of(cls, limits: Any) -> Drive:
        """Return the drive that has the limits of a robot's description (``drives.limits``)."""
        given = {name: getattr(limits, name) for name in cls._speed_names()}
        return cls(**given, acceleration=cls._accelerations(limits))

    @classmethod
    def _accelerations(cls, limits: Any) -> tuple[float, ...]:
        return limits.linear_acceleration, limits.angular_acceleration

    @classmethod
    def _speed_names(cls) -> list[str]:
        return [f.name for f in fields(cls) if f.name != "acceleration"]

    def speeds(self) -> dict[str, Any]:
        """Return the limits of speed as plain data."""
        return {name: getattr(self, name) for name in self._speed_names()}

    def _bounds(self) -> dict[AxisName, tuple[float, float]]:
        """Return the least and the greatest speed of each axis."""
        return {
            "x": (self.linear_min, self.linear_max),
            "yaw": (-self.angular_max, self.angular_max),
        }

    @property
    def envelope(self) -> int:
        """How the speeds of the axes limit each other: BOX or ELLIPSE."""
        return BOX

    @property
    def size(self) -> int:
        """How many numbers a command has."""
        return len(self.axes)

    def bounds(self, axis: AxisName) -> tuple[float, float]:
        """Return the least and the greatest speed of an axis [m/s or rad/s]."""
        return self._bounds()[axis]

    @cached_property
    def low(self) -> FloatArray:
        """Least speed of each axis, shape (size,)."""
        return np.array([self.bounds(axis)[0] for axis in self.axes])

    @cached_property
    def high(self) -> FloatArray:
        """Greatest speed of each axis, shape (size,)."""
        return np.array([self.bounds(axis)[1] for axis in self.axes])

    @cached_property
    def fastest(self) -> FloatArray:
        """Greatest speed of each axis in either direction, shape (size,)."""
        return np.maximum(self.high, -self.low)

    @cached_property
    def top_speed(self) -> float:
        """How fast the base can travel in any direction [m/s]."""
        return float(np.linalg.norm(self.fastest[:-1]))

    @cached_property
    def _halves(self) -> list[float]:
        """Half of each axis' range of speeds."""
        return [0.5 * (high - low) for low, high in map(self.bounds, self.axes)]

    def to_command(self, action: Any) -> Any:
        """Return the commands of actions (..., size) in [-1, 1]; zero lies halfway between."""
        command = array_namespace(action).empty_like(action)
        for k, half in enumerate(self._halves):
            command[..., k] = half * action[..., k]
        # Only forwards and backwards may have different limits.
        command[..., 0] += self.linear_min + self._halves[0]
        return command

    def to_action(self, command: Any) -> Any:
        """Return the actions (..., size) that stand for commands within the limits."""
        xp = array_namespace(command)
        columns = [command[..., k] / half for k, half in enumerate(self._halves)]
        columns[0] = (command[..., 0] - self.linear_min) / self._halves[0] - 1.0
        return xp.clip(xp.stack(columns, axis=-1), -1.0, 1.0)

    def clip(self, command: FloatArray) -> FloatArray:
        """Return the commands (..., size) that the base really follows."""
        return np.clip(command, self.low, self.high)

    def reachable(self, command: FloatArray, before: FloatArray, seconds: float) -> FloatArray:
        """Return what of a command the base can do ``seconds`` [s] after it did ``before``."""
        change = np.asarray(self.acceleration) * seconds
        return np.clip(self.clip(command), before - change, before + change)

    def braking_time(self, twist: ArrayLike) -> float:
        """Return how long the base needs to stop from a twist (size,) [s]."""
        return float((np.abs(twist) / np.asarray(self.acceleration)).max())

    def pace(self, twist: ArrayLike) -> FloatArray:
        """Return how fast twists (..., size) travel and turn, whichever way, shape (..., 2)."""
        twist = np.asarray(twist)
        travel = np.linalg.norm(twist[..., :-1], axis=-1)
        return np.stack([travel, np.abs(twist[..., -1])], axis=-1)

    @property
    def courses(self) -> tuple[float, ...]:
        """Where a motion along each axis leads, in base_link [rad]."""
        aside = (0.5 * math.pi, -0.5 * math.pi) if "y" in self.axes else ()
        return (0.0, math.pi, *aside)

    def course(self, twist: ArrayLike) -> float | None:
        """Return where a twist (size,) leads, in base_link [rad]; None if it does not travel."""
        x, y, _ = map(float, self.planar(twist))
        # Without the sign of a zero, straight back is one direction.
        return math.atan2(y + 0.0, x) if x or y else None

    def planar(self, command: ArrayLike) -> FloatArray:
        """Return commands or twists (..., size) with all three axes, x, y and yaw."""
        command = np.asarray(command, dtype=np.float64)
        full = np.zeros((*command.shape[:-1], 3))
        full[..., [PLANAR.index(axis) for axis in self.axes]] = command
        return full

    def from_planar(self, twist: ArrayLike) -> FloatArray:
        """Return of twists (..., 3) what the base has axes for, shape (..., size)."""
        return np.asarray(twist)[..., [PLANAR.index(axis) for axis in self.axes]]

    def to_unicycle(self, twist: FloatArray) -> FloatArray:
        """Return v and w of twists, shape (..., 2)."""
        return twist if self.size == 2 else twist[..., [0, -1]]

    def from_unicycle(self, twist: FloatArray) -> FloatArray:
        """Return the commands that go at v and w (..., 2), and not sideways."""
        if self.size == 2:
            return twist
        command = np.zeros((*twist.shape[:-1], self.size))
        command[..., [0, -1]] = twist
        return command

    def turning(self, rate: float) -> FloatArray:
        """Return the command that turns on the spot [rad/s], shape (size,)."""
        return self.from_unicycle(np.array([0.0, rate]))


DRIVES: dict[str, type[Drive]] = {}
DriveClass = TypeVar("DriveClass", bound=type[Drive])


def drive(kind: DriveClass) -> DriveClass:
    """Enter a class in the table of drives by its ``name``."""
    DRIVES[kind.name] = kind
    return kind


def drive_to_dict(given: Drive) -> dict[str, Any]:
    """Return plain data for an exported policy's metadata."""
    named = {} if given.name == "differential" else {"drive": given.name}
    return named | given.speeds()


def drive_from_dict(data: Mapping[str, Any]) -> Drive:
    """Return the drive of an exported policy's metadata.

    Raises:
        InputError: there is no such drive.
        TypeError: a limit is unknown or missing.
    """
    given = dict(data)
    name = given.pop("drive", "differential")
    if name not in DRIVES:
        raise InputError(f"limits.drive = {name!r}: unknown; allowed: {', '.join(sorted(DRIVES))}")
    made = DRIVES[name](**given)
    if not all(math.isfinite(speed) for speed in (*made.low, *made.high)):
        raise InputError("limits: must be finite")
    return made
