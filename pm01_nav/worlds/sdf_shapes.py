# SPDX-License-Identifier: Apache-2.0
"""What an SDF geometry covers of the floor, between two heights."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from pm01_nav.errors import InputError
from pm01_nav.worlds.sdf_pose import FloatArray, Transform, numbers, positive

CIRCLE_CORNERS = 24
"""A tilted circle becomes a polygon around it, 0.9 % larger."""
DRIVEN_OVER = 0.03
"""What ends lower than this above the ground [m] stops no wheel: sills, carpets, markings."""
LIDAR_HEIGHT = 0.15
"""Where a lidar is at the lowest [m]: what is wide and ends below is floor to the robot."""
FLOOR_WIDTH = 1.5
"""So wide [m] is a slab or a ramp that a robot stands on; a pallet is narrower."""


class UnsupportedError(Exception):
    """A geometry that cannot be turned into discs and polygons; the text names its kind."""


class Band(NamedTuple):
    """Heights that the robot or its lidar can meet [m]; the robot stands at the lowest."""

    low: float
    high: float

    @property
    def sill(self) -> float:
        """Above this an obstacle begins."""
        return min(self.low + DRIVEN_OVER, (self.low + self.high) / 2.0)

    @property
    def lidar(self) -> float:
        """Where the lowest lidar is."""
        return min(self.low + LIDAR_HEIGHT, self.high)


@dataclass
class Cover:
    """The floor that a solid covers between two heights; empty where it is not between them."""

    discs: list[tuple[float, float, float]] = field(default_factory=list)
    """x, y, radius [m]."""
    polygons: list[FloatArray] = field(default_factory=list)
    """Each of shape (n, 2) [m]."""
    segments: list[FloatArray] = field(default_factory=list)
    """Thin walls, each of shape (n, 4): x1, y1, x2, y2 [m]."""
    is_floor: bool = False
    """It, or a part of it, is what a robot stands on, and was left out."""


def cover(
    geometry: Element, pose: Transform, scale: NDArray[np.float64], band: Band, where: str
) -> Cover:
    """Return what a geometry, its sizes times ``scale`` (3,), covers of the floor.

    Of a tilted solid the part between the two heights counts.

    Raises:
        UnsupportedError: no disc or polygon can stand for it.
        InputError: a number is missing, not finite or not positive.
    """
    kind = geometry.tag
    where = f"{where}: {kind}"
    if kind == "plane":
        return _cover_plane(geometry, pose, where)
    if kind == "sphere":
        return _cover_sphere(geometry, pose, scale, band, where)
    if kind == "polyline":
        outline, heights = _polyline(geometry, scale, where)
    elif kind == "box":
        half = np.array(positive(geometry.find("size"), 3, where)) * scale / 2.0
        outline = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half[:2]
        heights = (-half[2], half[2])
    elif kind == "ellipsoid":
        radii = np.array(positive(geometry.find("radii"), 3, where)) * scale
        outline, heights = _circle() * radii[:2], (-radii[2], radii[2])
    elif kind in ("cylinder", "capsule", "cone"):
        return _cover_round(geometry, pose, scale, band, where)
    else:
        raise UnsupportedError(kind)
    return _cover_prism(outline, heights, pose, band)


def _cover_plane(geometry: Element, pose: Transform, where: str) -> Cover:
    normal = geometry.find("normal")
    direction = np.array([0.0, 0.0, 1.0] if normal is None else numbers(normal, 3, where))
    upward = pose.rotation @ direction
    # The ground is no obstacle; a slope or a wall without end is one that we cannot draw.
    if abs(upward[2]) < 0.999 * float(np.linalg.norm(direction)):
        raise UnsupportedError("plane that is not level")
    return Cover()


def _cover_sphere(
    geometry: Element, pose: Transform, scale: FloatArray, band: Band, where: str
) -> Cover:
    (radius,) = positive(geometry.find("radius"), 1, f"{where}: radius")
    radius *= float(scale[0])
    x, y, z = pose.translation.tolist()
    height = max(band.sill - z, z - band.high, 0.0)
    if height >= radius:
        return Cover()
    # The widest circle within the band.
    return Cover([(x, y, math.sqrt((radius - height) * (radius + height)))])


def _cover_round(
    geometry: Element, pose: Transform, scale: FloatArray, band: Band, where: str
) -> Cover:
    (radius,) = positive(geometry.find("radius"), 1, f"{where}: radius")
    (length,) = positive(geometry.find("length"), 1, f"{where}: length")
    radius, length = radius * float(scale[0]), length * float(scale[2])
    # A capsule's length leaves out its two round ends.
    half = length / 2.0 + (radius if geometry.tag == "capsule" else 0.0)
    found = _cover_prism(radius * _circle(), (-half, half), pose, band)
    if found.polygons and pose.is_upright:
        x, y, _ = pose.translation.tolist()
        return Cover([(x, y, radius)])
    return found


def _circle() -> FloatArray:
    """Return a polygon around the unit circle, (CIRCLE_CORNERS, 2)."""
    angle = np.arange(CIRCLE_CORNERS) * 2.0 * math.pi / CIRCLE_CORNERS
    corners = np.column_stack([np.cos(angle), np.sin(angle)])
    return corners / math.cos(math.pi / CIRCLE_CORNERS)


def _polyline(
    geometry: Element, scale: FloatArray, where: str
) -> tuple[FloatArray, tuple[float, float]]:
    (height,) = positive(geometry.find("height"), 1, f"{where}: height")
    points = np.array([numbers(p, 2, f"{where}: point") for p in geometry.findall("point")])
    if len(points) > 1 and (points[0] == points[-1]).all():
        points = points[:-1]
    if len(points) < 3:
        raise InputError(f"{where}: must have 3 or more points, not {len(points)}")
    return points * scale[:2], (0.0, height * float(scale[2]))


def _cover_prism(
    outline: FloatArray, heights: tuple[float, float], pose: Transform, band: Band
) -> Cover:
    """Cover an upright outline (n, 2) as it is, a tilted one by the hull of what is in the band."""
    ends = [np.column_stack([outline, np.full(len(outline), z)]) for z in heights]
    corners = pose.points(np.concatenate(ends))
    low, high = float(corners[:, 2].min()), float(corners[:, 2].max())
    # What only touches the band from outside is not in it.
    if low >= band.high or high <= band.low:
        return Cover()
    if high <= band.sill + ROUNDING:
        return Cover(is_floor=True)
    if high <= band.lidar + ROUNDING and _width(corners[:, :2]) >= FLOOR_WIDTH:
        return Cover(is_floor=True)
    if pose.is_upright:
        return Cover(polygons=[corners[: len(outline), :2]])
    return Cover(polygons=[_hull(_between(corners, band.sill, band.high)[:, :2])])


ROUNDING = 1e-9
"""Of heights [m]: sums of decimal numbers miss their limits by less."""


def _between(corners: FloatArray, low: float, high: float) -> FloatArray:
    """Return corners (m, 3) of the part of a convex solid between two heights."""
    kept = [corners[(corners[:, 2] >= low) & (corners[:, 2] <= high)]]
    first, second = np.triu_indices(len(corners), 1)
    a, b = corners[first], corners[second]
    # Any two corners are joined by a line inside the solid, its edges among these lines.
    for height in (low, high):
        crosses = (a[:, 2] - height) * (b[:, 2] - height) < 0.0
        start, end = a[crosses], b[crosses]
        part = (height - start[:, 2]) / (end[:, 2] - start[:, 2])
        kept.append(start + part[:, None] * (end - start))
    return np.concatenate(kept)


def _width(points: FloatArray) -> float:
    """Return the least distance of two parallel lines around points (n, 2)."""
    try:
        hull = _hull(points)
    except UnsupportedError:
        return 0.0
    edges = np.roll(hull, -1, axis=0) - hull
    normals = np.column_stack([-edges[:, 1], edges[:, 0]])
    normals /= np.linalg.norm(edges, axis=1)[:, None]
    return float(np.ptp(hull @ normals.T, axis=0).min())


def _hull(points: FloatArray) -> FloatArray:
    from scipy.spatial import ConvexHull, QhullError  # slow to import

    try:
        return points[ConvexHull(points).vertices]
    except (QhullError, ValueError):
        raise UnsupportedError("shape too thin to have a floor area") from None
