# SPDX-License-Identifier: Apache-2.0
"""What the generators share: a world under construction, and divisions of an area."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pm01_nav.geometry import points_in_polygon, polygon_edges, rectangle
from pm01_nav.worlds.free_space import FreeSpace, free_space
from pm01_nav.worlds.mover import Mover
from pm01_nav.worlds.world import World

FloatArray = NDArray[np.float64]
Area = tuple[float, float, float, float]
"""x_min, y_min, x_max, y_max [m]."""
Box = tuple[float, float, float, float, float]
"""Centre x, y, length, width [m], yaw [rad]."""

PASSAGE = 0.65
"""What is left free between obstacles so that one can drive there: pm01 and its margin need 0.54 m,
and a raster of 0.1 m may cost some of the rest [m]."""
WALL_THICKNESS = 0.1
"""Of walls between rooms or passages [m]. A line would be invisible to a lidar end-on."""
SPACING = 0.2
"""Between the points that stand for a box or a line when distances are measured [m]."""


@dataclass
class Layout:
    """Obstacles put down so far, in a room or in the open."""

    bounds: Area
    segments: list[FloatArray] = field(default_factory=list)
    """Each of shape (n, 4)."""
    walls: list[FloatArray] = field(default_factory=list)
    """Outlines of walls that have a thickness, each of shape (4, 2)."""
    discs: list[tuple[float, float, float]] = field(default_factory=list)
    polygons: list[FloatArray] = field(default_factory=list)

    def clearance(self, points: FloatArray, walls: bool = True) -> float:
        """Return the least distance of points (n, 2) to an obstacle [m], 0 inside one.

        ``walls`` counts the segments and walls, too.
        """
        solids = [*(self.walls if walls else ()), *self.polygons]
        segments = [*(self.segments if walls else ()), *map(polygon_edges, solids)]
        distance = np.inf
        if segments:
            distance = min(distance, _to_segments(points, np.concatenate(segments)))
        if self.discs:
            x, y, radius = np.array(self.discs).T
            apart = np.hypot(points[:, :1] - x, points[:, 1:] - y) - radius
            distance = min(distance, float(apart.min()))
        if any(points_in_polygon(points, polygon).any() for polygon in solids):
            return 0.0
        return max(distance, 0.0)

    def encloses(self, points: FloatArray) -> bool:
        """Tell whether all points (n, 2) lie within the bounds."""
        low, high = np.array(self.bounds[:2]), np.array(self.bounds[2:])
        return bool(((points >= low) & (points <= high)).all())

    def ray(self, origin: FloatArray, direction: FloatArray) -> float:
        """Return how far a ray goes until it meets a wall or a polygon [m], infinity if never.

        ``direction`` is a unit vector.
        """
        solids = [*self.walls, *self.polygons]
        walls = np.concatenate([*self.segments, *map(polygon_edges, solids)])
        offset, extent = walls[:, :2] - origin, walls[:, 2:] - walls[:, :2]
        across = direction[0] * extent[:, 1] - direction[1] * extent[:, 0]
        # Walls along the ray are met edge-on, where they have no width.
        across = np.where(np.abs(across) < 1e-12, np.nan, across)
        distance = (offset[:, 0] * extent[:, 1] - offset[:, 1] * extent[:, 0]) / across
        along = (offset[:, 0] * direction[1] - offset[:, 1] * direction[0]) / across
        met = (distance >= 0.0) & (along >= 0.0) & (along <= 1.0)
        return float(distance[met].min(initial=np.inf))

    def add_walls(
        self, lines: FloatArray, thickness: float = WALL_THICKNESS, beyond: float = 0.0
    ) -> None:
        """Build walls along lines (n, 4), reaching past their ends by ``beyond`` [m].

        What would reach over the bounds is cut off; there walls must run along x or y.
        """
        for x1, y1, x2, y2 in lines.tolist():
            length, yaw = np.hypot(x2 - x1, y2 - y1), np.arctan2(y2 - y1, x2 - x1)
            centre = 0.5 * (x1 + x2), 0.5 * (y1 + y2)
            outline = rectangle(*centre, length + 2.0 * beyond, thickness, yaw)
            self.walls.append(np.clip(outline, self.bounds[:2], self.bounds[2:]))

    def add_box(self, box: Box) -> None:
        """Put down a solid rectangle."""
        self.polygons.append(rectangle(*box))

    def add_disc_if_clear(self, x: float, y: float, radius: float, gap: float = PASSAGE) -> bool:
        """Put down a disc where it leaves ``gap`` [m] around it; tell whether it did."""
        clear = self.clearance(np.array([[x, y]])) - radius >= gap
        if clear:
            self.discs.append((x, y, radius))
        return clear

    def add_box_if_clear(self, box: Box, gap: float = PASSAGE, walls: bool = True) -> bool:
        """Put down a box where it leaves ``gap`` [m] around it; tell whether it did."""
        clear = self.clearance(box_points(box), walls) >= gap
        if clear:
            self.add_box(box)
        return clear

    def world(
        self,
        name: str,
        movers: Iterable[Mover] = (),
        start_area: Area | None = None,
        goal_area: Area | None = None,
    ) -> World:
        """Return the finished world."""
        return World(
            name,
            self.bounds,
            discs=np.array(self.discs, dtype=np.float64).reshape(-1, 3),
            polygons=(*self.walls, *self.polygons),
            segments=np.concatenate([np.zeros((0, 4)), *self.segments]),
            movers=tuple(movers),
            start_area=start_area,
            goal_area=goal_area,
        )


def _to_segments(points: FloatArray, segments: FloatArray) -> float:
    """Return the least distance between points (n, 2) and segments (m, 4) [m]."""
    begin, extent = segments[:, :2], segments[:, 2:] - segments[:, :2]
    length_squared = np.maximum((extent**2).sum(axis=1), 1e-18)
    offset = points[:, None] - begin
    along = np.clip((offset * extent).sum(axis=2) / length_squared, 0.0, 1.0)
    off = offset - along[:, :, None] * extent
    return float(np.sqrt((off**2).sum(axis=2).min()))


def box_points(box: Box) -> FloatArray:
    """Return points all over a box, at most ``SPACING`` apart, corners included, shape (n, 2)."""
    x, y, length, width, yaw = box
    across, up = (
        np.linspace(-side / 2, side / 2, 1 + int(np.ceil(side / SPACING)))
        for side in (length, width)
    )
    grid = np.stack(np.meshgrid(across, up), axis=-1).reshape(-1, 2)
    return turned(grid, (x, y), yaw)


def points_along(segments: FloatArray) -> FloatArray:
    """Return points on segments (m, 4), at most ``SPACING`` apart, ends included, shape (n, 2)."""
    lengths = np.hypot(*(segments[:, 2:] - segments[:, :2]).T)
    steps = 1 + (lengths / SPACING).astype(np.int64)
    # Each segment once for each of its points, with the part of it that lies before the point.
    own = np.repeat(np.arange(len(segments)), steps + 1)
    first = np.cumsum(steps + 1) - (steps + 1)
    part = ((np.arange(len(own)) - first[own]) / steps[own])[:, None]
    return (1.0 - part) * segments[own, :2] + part * segments[own, 2:]


def turned(points: FloatArray, centre: tuple[float, float], yaw: float) -> FloatArray:
    """Turn points (n, 2) about the origin by ``yaw`` [rad], then move the origin to ``centre``."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    return points @ np.array([[cos, sin], [-sin, cos]]) + np.array(centre)


def thick_chain(points: FloatArray, thickness: float = WALL_THICKNESS) -> FloatArray:
    """Return the outline of a wall along successive points (n, 2), shape (2 n, 2) [m]."""
    along = np.diff(points, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    before, after = np.concatenate([along[:1], along]), np.concatenate([along, along[-1:]])
    # At a bend both sides are mitred: the offset has length 1 across either piece.
    normal = np.stack([-before[:, 1] - after[:, 1], before[:, 0] + after[:, 0]], axis=1)
    offset = normal / (1.0 + (before * after).sum(axis=1, keepdims=True))
    half = 0.5 * thickness * offset
    return np.concatenate([points + half, (points - half)[::-1]])


def room_walls(x_min: float, y_min: float, x_max: float, y_max: float) -> FloatArray:
    """Return the four walls of a room as segments, shape (4, 4) [m]."""
    corners = [(x_min, y_min), (x_max, y_min), (x_max, y_max), (x_min, y_max)]
    return np.array([(*corners[k - 1], *corners[k]) for k in range(4)])


def merge_walls(walls: Iterable[Area]) -> FloatArray:
    """Join walls along x or y that touch end to end, shape (n, 4) [m].

    ``walls`` run from the smaller to the greater coordinate.
    """
    lines: dict[tuple[bool, float], list[tuple[float, float]]] = {}
    for x1, y1, x2, y2 in walls:
        upright = x1 == x2
        ends = (y1, y2) if upright else (x1, x2)
        lines.setdefault((upright, x1 if upright else y1), []).append(ends)
    merged: list[Area] = []
    for (upright, place), intervals in sorted(lines.items()):
        intervals.sort()
        joined = [intervals[0]]
        for low, high in intervals[1:]:
            if low <= joined[-1][1] + 1e-9:
                joined[-1] = (joined[-1][0], max(joined[-1][1], high))
            else:
                joined.append((low, high))
        merged += [(place, a, place, b) if upright else (a, place, b, place) for a, b in joined]
    return np.array(merged, dtype=np.float64).reshape(-1, 4)


def divide(
    area: Area,
    rng: np.random.Generator,
    largest: tuple[float, float],
    gap: tuple[float, float],
    middle: tuple[float, float],
) -> list[Area]:
    """Cut an area across its longer side again and again, until its parts are small enough.

    A part stays whole when its longer side is at most U(*largest) m. A cut takes away a strip of
    width U(*gap) m, whose middle lies at U(*middle) of the side.
    """
    axis = 0 if area[2] - area[0] >= area[3] - area[1] else 1
    low, high = area[axis], area[axis + 2]
    if high - low <= rng.uniform(*largest):
        return [area]
    half = rng.uniform(*gap) / 2.0
    centre = low + (high - low) * rng.uniform(*middle)
    parts = []
    for k, edge in ((axis + 2, centre - half), (axis, centre + half)):
        part = [edge if index == k else value for index, value in enumerate(area)]
        parts += divide((part[0], part[1], part[2], part[3]), rng, largest, gap, middle)
    return parts


def walkable(layout: Layout, radius: float) -> FreeSpace:
    """Return the largest connected region in whose cells' centres a disc touches nothing.

    ``radius`` is the disc's [m].
    """
    space = free_space(layout.world("layout"), radius)
    regions = space.regions()
    sizes = np.bincount(regions.ravel())
    sizes[0] = 0
    return replace(space, free=(regions == sizes.argmax()) & space.free)
