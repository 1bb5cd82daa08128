# SPDX-License-Identifier: Apache-2.0
"""Poses and numbers of SDF's XML."""

from __future__ import annotations

import math
import re
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from pm01_nav.errors import InputError

FloatArray = NDArray[np.float64]

UPRIGHT = 1e-6
"""A shape tilted by less than this [rad] counts as upright."""
LARGEST = 1e9
"""Larger numbers are refused: their squares would lose what the sum of poses needs."""
# Gazebo reads numbers as a stream: a sign begins the next one.
_NEXT_NUMBER = re.compile(r"(?<=[\d.])(?=[-+])")


class Transform(NamedTuple):
    """A pose in space."""

    rotation: FloatArray
    """Shape (3, 3)."""
    translation: FloatArray
    """Shape (3,) [m]."""

    def apply(self, inner: Transform) -> Transform:
        """Express in our parent's frame a pose given in our own."""
        return Transform(self.rotation @ inner.rotation, self.points(inner.translation))

    def points(self, points: FloatArray) -> FloatArray:
        """Express in our parent's frame points (..., 3) given in our own."""
        return points @ self.rotation.T + self.translation

    def inverse(self) -> Transform:
        """Express our parent's frame in our own."""
        return Transform(self.rotation.T, -self.rotation.T @ self.translation)

    @property
    def is_upright(self) -> bool:
        """Tell whether z stays vertical."""
        return float(np.hypot(self.rotation[0, 2], self.rotation[1, 2])) < UPRIGHT


IDENTITY = Transform(np.eye(3), np.zeros(3))
QUATERNION = "quat_xyzw"


def read_pose(element: Element, where: str, home: str) -> Transform:
    """Read the ``<pose>`` of an element; ``home`` is the name of the frame it is usually in.

    Raises:
        InputError: it is no pose, or relative to another frame.
    """
    frame, pose = frame_and_pose(element, where)
    if frame not in ("", home):
        raise InputError(f"{where}: pose: relative_to = {frame!r}: other frames are not supported")
    return pose


def frame_and_pose(element: Element, where: str) -> tuple[str, Transform]:
    """Read the ``<pose>`` of an element and the name of the frame it is in, empty where none is.

    Raises:
        InputError: it is no pose.
    """
    pose = element.find("pose")
    if pose is None:
        return "", IDENTITY
    frame = pose.get("relative_to") or pose.get("frame") or ""
    if pose.get("rotation_format") == QUATERNION:
        x, y, z, *quaternion = numbers(pose, 7, f"{where}: pose")
        return frame, Transform(_from_quaternion(quaternion, where), np.array([x, y, z]))
    if not (pose.text or "").split():
        return frame, IDENTITY
    x, y, z, *angles = numbers(pose, 6, f"{where}: pose")
    if is_true(pose.get("degrees")):
        angles = [math.radians(angle) for angle in angles]
    return frame, Transform(from_euler(*angles), np.array([x, y, z]))


def is_true(text: str | None) -> bool:
    """Tell whether a truth value of SDF says yes."""
    return (text or "").strip().lower() in ("true", "1")


def from_euler(roll: float, pitch: float, yaw: float) -> FloatArray:
    """Return the rotation by roll, then pitch, then yaw about the fixed axes, shape (3, 3)."""
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
    about_y = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    about_z = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
    return about_z @ about_y @ about_x


def _from_quaternion(quaternion: list[float], where: str) -> FloatArray:
    norm = math.hypot(*quaternion)
    if not 1e-6 < norm < 1e6:
        raise InputError(f"{where}: pose: quaternion {quaternion}: must have length 1")
    x, y, z, w = (part / norm for part in quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def numbers(element: Element | None, count: int, where: str) -> list[float]:
    """Read ``count`` numbers.

    Raises:
        InputError: there are more or fewer, or one is not finite or too large.
    """
    text = "" if element is None else " ".join((element.text or "").split())
    try:
        values = [float(word) for word in _NEXT_NUMBER.sub(" ", text).split()]
    except ValueError:
        values = []
    # NaN and infinity fail the comparison, too.
    if len(values) != count or not all(abs(value) <= LARGEST for value in values):
        limit = f"-{LARGEST:.0e} to {LARGEST:.0e}"
        raise InputError(f"{where} = {text[:80]!r}: must be {count} number(s) from {limit}")
    return values


def positive(element: Element | None, count: int, where: str) -> list[float]:
    """Read ``count`` positive numbers.

    Raises:
        InputError: there are more or fewer, or one is not above 0.
    """
    values = numbers(element, count, where)
    if min(values) <= 0.0:
        raise InputError(f"{where} = {values}: must be above 0")
    return values
