# SPDX-License-Identifier: Apache-2.0
"""A way through a known map, and the point on it that a robot should drive towards next.

A local policy sees a few metres and gets stuck in dead ends. With a map, a global plan leads
it: the plan's look-ahead point takes the place of the goal. It needs the robot's position in the
map and nothing else, so the same code serves a simulator and a robot with localisation.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pm01_nav.compilation import compiled
from pm01_nav.errors import InputError
from pm01_nav.worlds.free_space import FreeSpace
from pm01_nav.worlds.grid_search import cheapest_path, pull_taut

FloatArray = NDArray[np.float64]

INFLATION_DISTANCE = 1.0
"""Cells nearer than this to closed ones cost extra [m]."""
INFLATION_WEIGHT = 4.0
"""A metre right beside closed cells costs this many metres extra."""
SNAP_DISTANCE = 0.3
"""A start or goal in a closed cell is moved to a free one no further away [m]."""
LONGEST_LINE = 20.0
"""Straight pieces of a path replace at most this length of it [m]; it bounds the time needed."""


@dataclass(frozen=True)
class Costmap:
    """Where a robot fits, and where it had better not drive."""

    space: FreeSpace
    extra: NDArray[np.float32]
    """What a metre through each cell costs on top of itself, shape like ``space.free``."""
    radius: float
    """The cells are free for a disc of this radius [m]."""


def inflate(space: FreeSpace, radius: float) -> Costmap:
    """Lay a cost around closed cells that draws paths to the middle of free space.

    It falls from ``INFLATION_WEIGHT`` to nothing, with the square of the distance that is left
    to ``INFLATION_DISTANCE``. ``radius`` [m] is the one that ``space`` was rasterised for.
    """
    from scipy import ndimage

    if space.free.all():
        return Costmap(space, np.zeros(space.free.shape, dtype=np.float32), radius)
    distance = space.resolution * np.asarray(ndimage.distance_transform_edt(space.free))
    left = np.clip(1.0 - distance / INFLATION_DISTANCE, 0.0, 1.0)
    return Costmap(space, (INFLATION_WEIGHT * left**2).astype(np.float32), radius)


def plan_path(costmap: Costmap, start: ArrayLike, goal: ArrayLike) -> FloatArray:
    """Return the corners of a cheapest path, start first and goal last, shape (n, 2) [m].

    A* on 8 neighbours, then pulled taut where a straight line costs no more.

    Raises:
        InputError: start or goal is further than ``SNAP_DISTANCE`` from free space, or no way
            leads from one to the other.
    """
    start, goal = _point(start, "start"), _point(goal, "goal")
    space = costmap.space
    first, last = _free_cell(costmap, start, "start"), _free_cell(costmap, goal, "goal")
    cells, costs = cheapest_path(space.free, costmap.extra, first, last, True)
    if len(cells) == 0:
        raise InputError(
            f"goal = ({goal[0]:.2f}, {goal[1]:.2f}): no way leads there from "
            f"({start[0]:.2f}, {start[1]:.2f}) for a robot of radius {costmap.radius:.2f} m"
        )
    reach = max(int(LONGEST_LINE / space.resolution), 1)
    kept = cells[pull_taut(space.free, costmap.extra, cells, costs, reach)]
    between = space.centre(kept[1:-1, 0], kept[1:-1, 1])
    return np.concatenate([[start], between, [goal]])


def _point(point: ArrayLike, name: str) -> FloatArray:
    point = np.asarray(point, dtype=np.float64)
    if point.shape != (2,) or not np.isfinite(point).all():
        raise InputError(f"{name} = {point.tolist()}: must be two finite numbers, x and y [m]")
    return point


def _free_cell(costmap: Costmap, point: FloatArray, name: str) -> tuple[int, int]:
    cell = costmap.space.nearest_free(point[0], point[1], SNAP_DISTANCE)
    if cell is None:
        raise InputError(
            f"{name} = ({point[0]:.2f}, {point[1]:.2f}): a robot of radius "
            f"{costmap.radius:.2f} m does not fit within {SNAP_DISTANCE} m of it"
        )
    return cell


class LookAhead(NamedTuple):
    """Where to drive next, and how far the robot has strayed."""

    point: FloatArray
    """x, y in the map [m], shape (2,)."""
    deviation: float
    """From the robot to the path [m]."""
    visible: bool
    """Whether the straight line from the robot to the point is free."""


class GlobalPlan:
    """A path, and how far along it a robot has come."""

    def __init__(self, costmap: Costmap, path: FloatArray) -> None:
        """Begin at the start of ``path`` (n, 2) [m]."""
        self.costmap, self.path = costmap, path
        pieces = np.linalg.norm(np.diff(path, axis=0), axis=1)
        self._along = np.concatenate([[0.0], np.cumsum(pieces)])
        self.progress = 0.0
        """Length of the path that lies behind the robot [m]; it never falls."""

    @property
    def length(self) -> float:
        """Length of the path [m]."""
        return float(self._along[-1])

    def look_ahead(self, position: ArrayLike, distance: float) -> LookAhead:
        """Return the furthest visible point at most ``distance`` [m] of path ahead of the robot.

        The robot at ``position`` (2,) [m] is where the path comes nearest to it, searched no
        further than ``distance`` ahead of its last place, so that it never skips a loop of the
        path. If it can see nothing of the path, the point is one cell ahead of that place.
        """
        x, y = np.asarray(position, dtype=np.float64)
        space = self.costmap.space
        frame = (space.origin[0], space.origin[1], space.resolution)
        self.progress, deviation, ahead, visible = _look_ahead(
            (self.path, self._along, self.progress),
            (x, y, distance),
            (space.free, frame, self.costmap.radius),
        )
        return LookAhead(np.array(_point_at(self.path, self._along, ahead)), deviation, visible)


@compiled
def _look_ahead(plan, robot, grid):
    """Return the new progress, the deviation, where the point lies [m], and if it is visible."""
    path, along, progress = plan
    x, y, distance = robot
    free, frame, radius = grid
    length, step = along[-1], frame[2]
    progress, deviation = _project(path, along, progress, progress + distance, x, y)
    ahead = min(progress + distance, length)
    # Half a step: rounding must not end at the robot's own place.
    while ahead > progress + 0.5 * step or ahead == length:
        point = _point_at(path, along, ahead)
        if _sees(free, frame, radius, (x, y), point):
            return progress, deviation, ahead, True
        ahead -= step
    return progress, deviation, min(progress + step, length), False


@compiled
def _project(path, along, low, high, x, y):
    """Return where between ``low`` and ``high`` [m] the path is nearest, and how near it is."""
    nearest, place = np.inf, low
    for k in range(max(along.shape[0] - 1, 1)):
        j = min(k + 1, along.shape[0] - 1)
        if along[j] < low or along[k] > high:
            continue
        dx, dy = path[j, 0] - path[k, 0], path[j, 1] - path[k, 1]
        size = max(along[j] - along[k], 1e-12)
        offset = ((x - path[k, 0]) * dx + (y - path[k, 1]) * dy) / size
        here = along[k] + min(
            max(offset, low - along[k], 0.0), high - along[k], along[j] - along[k]
        )
        px, py = _point_at(path, along, here)
        gap = np.sqrt((x - px) ** 2 + (y - py) ** 2)
        if gap < nearest:
            nearest, place = gap, here
    return place, nearest


@compiled
def _point_at(path, along, place):
    """Return x, y [m] after ``place`` [m] of path."""
    k = np.searchsorted(along, place, side="right") - 1
    k = min(max(k, 0), along.shape[0] - 1)
    j = min(k + 1, along.shape[0] - 1)
    part = (place - along[k]) / max(along[j] - along[k], 1e-12)
    part = min(max(part, 0.0), 1.0)
    x = path[k, 0] + part * (path[j, 0] - path[k, 0])
    return x, path[k, 1] + part * (path[j, 1] - path[k, 1])


@compiled
def _sees(free, frame, radius, begin, end):
    """Tell whether the straight line between two points [m] runs through free cells.

    Closed cells count as free up to ``radius`` [m] from the beginning: a robot that came too near
    to an obstacle must find its way out, and a wall is at least a radius thick on either side.
    """
    dx, dy = end[0] - begin[0], end[1] - begin[1]
    length = np.sqrt(dx * dx + dy * dy)
    steps = int(np.ceil(2.0 * length / frame[2]))
    leaving = True
    for k in range(steps + 1):
        part = k / max(steps, 1)
        column = int(np.floor((begin[0] + part * dx - frame[0]) / frame[2]))
        row = int(np.floor((begin[1] + part * dy - frame[1]) / frame[2]))
        inside = 0 <= row < free.shape[0] and 0 <= column < free.shape[1]
        if inside and free[row, column]:
            leaving = False
        elif not leaving or part * length > radius:
            return False
    return True
