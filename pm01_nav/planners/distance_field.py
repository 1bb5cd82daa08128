# SPDX-License-Identifier: Apache-2.0
"""Which return of the present scan is the nearest, for each cell of a grid around the robot.

Local planners try out thousands of places a step; each is one look into this grid. The distance is
measured from the place itself to that return, so that it changes with every millimetre: a planner
that sees whole cells only creeps into an obstacle within one.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pm01_nav.compilation import compiled
from pm01_nav.robot import Footprint, RobotSpec

FloatArray = NDArray[np.float64]
DISCS = 2
"""A polygon is covered by so many discs along and across."""
RESOLUTION = 0.05
"""Side of a cell [m]."""


def covering_discs(footprint: Footprint) -> FloatArray:
    """Return discs that cover a footprint: x, y, radius [m], shape (n, 3).

    A distance to discs is one look into the field for each, whichever way the robot is turned
    (J. Ziegler, C. Stiller, "Fast collision checking for intelligent vehicle motion planning", IV
    2010).
    """
    if footprint.shape == "circle":
        return np.array([[0.0, 0.0, footprint.circumscribed_radius]])
    corners = np.array(footprint.vertices)
    low, high = corners.min(axis=0), corners.max(axis=0)
    side = (high - low) / DISCS
    x, y = np.meshgrid(*(low[k] + side[k] * (np.arange(DISCS) + 0.5) for k in range(2)))
    return np.stack([x.ravel(), y.ravel(), np.full(x.size, 0.5 * np.hypot(*side))], axis=-1)


class Fields(NamedTuple):
    """Distance fields of n robots, for ``distance_at``."""

    nearest: NDArray[np.int32]
    """Number of the return nearest to a cell, -1 without any, shape (n, 2 h, 2 h).

    Row r and column c are around x = (c + 0.5 - h) cells, y = (r + 0.5 - h) cells.
    """
    returns: FloatArray
    """x, y of each beam's return in the base frame [m], infinity without; (n, num_beams, 2)."""


class DistanceFields:
    """Make distance fields of n robots, in their base frames."""

    def __init__(self, robot: RobotSpec, reach: float) -> None:
        """Look ``reach`` [m] to all sides."""
        self.half = int(np.ceil(reach / RESOLUTION))
        lidar = robot.lidar
        self._beams = np.stack([np.cos(lidar.angles + lidar.yaw), np.sin(lidar.angles + lidar.yaw)])
        self._mount = (lidar.x, lidar.y)

    def __call__(self, scan: FloatArray) -> Fields:
        """Return the fields for clean scans (n, num_beams) [m]; what is beyond is left out."""
        side = 2 * self.half
        fields = Fields(
            np.full((len(scan), side, side), -1, dtype=np.int32),
            np.full((*scan.shape, 2), np.inf),
        )
        work = np.empty((2, side, side), dtype=np.int32), np.empty((2, side + 1))
        _measure(scan, self._beams, self._mount, fields, work)
        return fields


@compiled
def _measure(scan, beams, mount, fields, work):
    """Fill all fields: first the nearest return of each column, then of all columns.

    Felzenszwalb and Huttenlocher, "Distance Transforms of Sampled Functions", 2012.
    """
    numbers, rows = work[0][0], work[0][1]
    side = numbers.shape[0]
    for i in range(scan.shape[0]):
        _enter(scan, beams, mount, fields.returns, i, numbers, rows)
        for r in range(1, side):
            for c in range(side):
                if rows[r, c] < 0:
                    rows[r, c] = rows[r - 1, c]
        for r in range(side - 2, -1, -1):
            for c in range(side):
                above, below = rows[r + 1, c], rows[r, c]
                if above >= 0 and (below < 0 or above - r < r - below):
                    rows[r, c] = above
        for r in range(side):
            _transform_row(fields.nearest, i, r, numbers, rows, work[1])


@compiled(inline=False)
def _enter(scan, beams, mount, returns, i, numbers, rows):
    """Write where robot i's returns are; mark their cells with their numbers and rows, else -1."""
    side = numbers.shape[0]
    for r in range(side):
        for c in range(side):
            numbers[r, c] = rows[r, c] = -1
    for k in range(scan.shape[1]):
        length = scan[i, k]
        if length == np.inf:
            continue
        x, y = mount[0] + length * beams[0, k], mount[1] + length * beams[1, k]
        returns[i, k, 0], returns[i, k, 1] = x, y
        column = int(np.floor(x / RESOLUTION)) + side // 2
        row = int(np.floor(y / RESOLUTION)) + side // 2
        if 0 <= column < side and 0 <= row < side:
            numbers[row, column], rows[row, column] = k, row


@compiled(inline=False)
def _transform_row(nearest, i, r, numbers, rows, work):
    """Write the returns nearest to a row's cells: the lower envelope of the columns' parabolas."""
    side = numbers.shape[0]
    vertices, borders = work[0], work[1]
    last = -1
    for q in range(side):
        if rows[r, q] < 0:
            continue
        border = -np.inf
        while last >= 0:
            border = _meeting(r, rows, q, int(vertices[last]))
            if border > borders[last]:
                break
            last -= 1
            border = -np.inf
        last += 1
        vertices[last], borders[last] = q, border
    if last < 0:
        return
    k = 0
    for q in range(side):
        while k < last and borders[k + 1] < q:
            k += 1
        v = int(vertices[k])
        nearest[i, r, q] = numbers[rows[r, v], v]


@compiled
def _meeting(r, rows, q, v):
    """Return where row r's parabolas over q and over v, which is to its left, meet."""
    own, other = float(r - rows[r, q]), float(r - rows[r, v])
    return (own * own + q * q - other * other - v * v) / (2.0 * (q - v))


@compiled
def distance_at(fields, i, x, y):
    """Return the distance at a place in the base frame [m]; infinity beyond the field."""
    half = fields.nearest.shape[1] // 2
    column = int(np.floor(x / RESOLUTION)) + half
    row = int(np.floor(y / RESOLUTION)) + half
    if not (0 <= column < 2 * half and 0 <= row < 2 * half):
        return np.inf
    k = fields.nearest[i, row, column]
    if k < 0:
        return np.inf
    dx, dy = fields.returns[i, k, 0] - x, fields.returns[i, k, 1] - y
    return np.sqrt(dx * dx + dy * dy)


@compiled
def clearance_at(fields, discs, i, x, y, cos, sin):
    """Return the distance from a footprint's discs to the nearest return, negative inside [m].

    The robot stands at x, y with the heading (cos, sin), all in the base frame.
    """
    least = np.inf
    for k in range(discs.shape[0]):
        px = x + cos * discs[k, 0] - sin * discs[k, 1]
        py = y + sin * discs[k, 0] + cos * discs[k, 1]
        least = min(least, distance_at(fields, i, px, py) - discs[k, 2])
    return least
