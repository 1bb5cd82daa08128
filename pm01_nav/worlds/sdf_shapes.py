# SPDX-License-Identifier: Apache-2.0
"""What an SDF geometry covers on the floor: poses, numbers and shapes of SDF's XML."""

from __future__ import annotations

import math
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from pm01_nav.errors import InputError

FloatArray = NDArray[np.float64]

UPRIGHT = 1e-6
"""A shape tilted by less than this [rad] counts as upright."""
LARGEST = 1e9
"""Larger numbers are refused: their squares would lose what the sum of poses needs."""
CIRCLE_CORNERS = 24
"""A tilted circle becomes a polygon around it, 0.9 % larger."""


class UnsupportedError(Exception):
    """A geometry that cannot be turned into discs and polygons; the text names its kind."""


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

    @property
    def is_upright(self) -> bool:
        """Tell whether z stays vertical."""
        return float(np.hypot(self.rotation[0, 2], self.rotation[1, 2])) < UPRIGHT


class Shape(NamedTuple):
    """The floor that a solid covers between two heights."""

    disc: tuple[float, float, float] | None
    """x, y, radius [m]."""
    polygon: FloatArray | None
    """Shape (n, 2) [m]."""


IDENTITY = Transform(np.eye(3), np.zeros(3))
QUATERNION = "quat_xyzw"


def read_pose(element: Element, where: str, home: str) -> Transform:
    """Read the ``<pose>`` of an element; ``home`` is the name of the frame it is usually in.

    Raises:
        InputError: it is no pose, or relative to another frame.
    """
    pose = element.find("pose")
    if pose is None:
        return IDENTITY
    frame = pose.get("relative_to") or pose.get("frame") or home
    if frame != home:
        raise InputError(f"{where}: pose: relative_to = {frame!r}: other frames are not supported")
    if pose.get("rotation_format") == QUATERNION:
        x, y, z, *quaternion = numbers(pose, 7, f"{where}: pose")
        return Transform(_from_quaternion(quaternion, where), np.array([x, y, z]))
    if not (pose.text or "").split():
        return IDENTITY
    x, y, z, *angles = numbers(pose, 6, f"{where}: pose")
    if pose.get("degrees") in ("true", "1"):
        angles = [math.radians(angle) for angle in angles]
    return Transform(from_euler(*angles), np.array([x, y, z]))


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
    words = "" if element is None else " ".join((element.text or "").split())
    try:
        values = [float(word) for word in words.split()]
    except ValueError:
        values = []
    # NaN and infinity fail the comparison, too.
    if len(values) != count or not all(abs(value) <= LARGEST for value in values):
        limit = f"-{LARGEST:.0e} to {LARGEST:.0e}"
        raise InputError(f"{where} = {words[:80]!r}: must be {count} number(s) from {limit}")
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


def cover(geometry: Element, pose: Transform, band: tuple[float, float], where: str) -> list[Shape]:
    """Return what a geometry covers of the floor, nothing where it misses the heights ``band``.

    A tilted solid covers the hull of its projection, more than the part of it in the band.

    Raises:
        UnsupportedError: no disc or polygon can stand for it.
        InputError: a number is missing, not finite or not positive.
    """
    kind = geometry.tag
    where = f"{where}: {kind}"
    if kind == "plane":
        return _cover_plane(geometry, pose, where)
    if kind == "sphere":
        return _cover_sphere(geometry, pose, band, where)
    if kind == "polyline":
        return _cover_polyline(geometry, pose, band, where)
    if kind in ("box", "ellipsoid"):
        element = geometry.find("size" if kind == "box" else "radii")
        half = np.array(positive(element, 3, where)) * (0.5 if kind == "box" else 1.0)
        corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half[:2]
        return _cover_prism(corners, (-half[2], half[2]), pose, band)
    if kind in ("cylinder", "capsule", "cone"):
        return _cover_round(geometry, pose, band, where)
    raise UnsupportedError(kind)


def _cover_plane(geometry: Element, pose: Transform, where: str) -> list[Shape]:
    normal = geometry.find("normal")
    direction = np.array([0.0, 0.0, 1.0] if normal is None else numbers(normal, 3, where))
    upward = pose.rotation @ direction
    # The ground is no obstacle; a slope or a wall without end is one that we cannot draw.
    if abs(upward[2]) < 0.999 * float(np.linalg.norm(direction)):
        raise UnsupportedError("plane that is not level")
    return []


def _cover_sphere(
    geometry: Element, pose: Transform, band: tuple[float, float], where: str
) -> list[Shape]:
    (radius,) = positive(geometry.find("radius"), 1, f"{where}: radius")
    x, y, z = pose.translation.tolist()
    below, above = band[0] - z, z - band[1]
    height = max(below, above, 0.0)
    if height >= radius:
        return []
    # The widest circle within the band.
    return [Shape((x, y, math.sqrt((radius - height) * (radius + height))), None)]


def _cover_round(
    geometry: Element, pose: Transform, band: tuple[float, float], where: str
) -> list[Shape]:
    (radius,) = positive(geometry.find("radius"), 1, f"{where}: radius")
    (length,) = positive(geometry.find("length"), 1, f"{where}: length")
    # A capsule's length leaves out its two round ends.
    half = length / 2.0 + (radius if geometry.tag == "capsule" else 0.0)
    if pose.is_upright:
        x, y, z = pose.translation.tolist()
        return [Shape((x, y, radius), None)] if _meets(z - half, z + half, band) else []
    angle = np.arange(CIRCLE_CORNERS) * 2.0 * math.pi / CIRCLE_CORNERS
    around = radius / math.cos(math.pi / CIRCLE_CORNERS)
    circle = around * np.column_stack([np.cos(angle), np.sin(angle)])
    return _cover_prism(circle, (-half, half), pose, band)


def _cover_polyline(
    geometry: Element, pose: Transform, band: tuple[float, float], where: str
) -> list[Shape]:
    (height,) = positive(geometry.find("height"), 1, f"{where}: height")
    points = np.array([numbers(p, 2, f"{where}: point") for p in geometry.findall("point")])
    if len(points) > 1 and (points[0] == points[-1]).all():
        points = points[:-1]
    if len(points) < 3:
        raise InputError(f"{where}: must have 3 or more points, not {len(points)}")
    return _cover_prism(points, (0.0, height), pose, band)


def _cover_prism(
    outline: FloatArray, heights: tuple[float, float], pose: Transform, band: tuple[float, float]
) -> list[Shape]:
    """Cover an upright outline (n, 2) as it is, a tilted one by the hull of its projection."""
    ends = [np.column_stack([outline, np.full(len(outline), z)]) for z in heights]
    corners = pose.points(np.concatenate(ends))
    if not _meets(float(corners[:, 2].min()), float(corners[:, 2].max()), band):
        return []
    floor = corners[:, :2]
    return [Shape(None, floor[: len(outline)] if pose.is_upright else _hull(floor))]


def _meets(low: float, high: float, band: tuple[float, float]) -> bool:
    """Tell whether heights overlap; what only touches the band from outside does not."""
    return low < band[1] and high > band[0]


def _hull(points: FloatArray) -> FloatArray:
    try:
        return points[ConvexHull(points).vertices]
    except (QhullError, ValueError):
        raise UnsupportedError("shape too thin to have a floor area") from None
