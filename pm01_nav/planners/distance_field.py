# SPDX-License-Identifier: Apache-2.0
"""How far the nearest return of the present scan is, for each cell of a grid around the robot.

Local planners try out thousands of places a step; each is one look into this grid.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pm01_nav.compilation import compiled
from pm01_nav.robot import RobotSpec

FloatArray = NDArray[np.float64]
RESOLUTION = 0.05
"""Side of a cell [m]."""


class DistanceFields:
    """Distance fields of n robots, in their base frames."""

    def __init__(self, robot: RobotSpec, reach: float) -> None:
        """Look ``reach`` [m] to all sides."""
        self.half = int(np.ceil(reach / RESOLUTION))
        lidar = robot.lidar
        self._beams = np.stack([np.cos(lidar.angles + lidar.yaw), np.sin(lidar.angles + lidar.yaw)])
        self._mount = (lidar.x, lidar.y)

    def __call__(self, scan: FloatArray) -> NDArray[np.float32]:
        """Return distances [m] for clean scans (n, num_beams) [m], shape (n, 2 h, 2 h).

        Row r and column c are around x = (c + 0.5 - h) cells, y = (r + 0.5 - h) cells. Where
        nothing is near the distance is that to the far end of the field, or more.
        """
        side = 2 * self.half
        fields = np.empty((len(scan), side, side), dtype=np.float32)
        work = np.empty((4, side + 1))
        _measure(scan, self._beams, self._mount, fields, work)
        return fields


@compiled
def _measure(scan, beams, mount, fields, work):
    """Fill all fields."""
    side = fields.shape[1]
    far = np.float32(4.0 * side * side)
    for i in range(scan.shape[0]):
        for r in range(side):
            for c in range(side):
                fields[i, r, c] = far
        for k in range(scan.shape[1]):
            length = scan[i, k]
            if length == np.inf:
                continue
            column = int(np.floor((mount[0] + length * beams[0, k]) / RESOLUTION + side // 2))
            row = int(np.floor((mount[1] + length * beams[1, k]) / RESOLUTION + side // 2))
            if 0 <= column < side and 0 <= row < side:
                fields[i, row, column] = 0.0
        for n in range(2 * side):
            _transform_line(fields, i, n % side, n < side, work)
        for r in range(side):
            for c in range(side):
                fields[i, r, c] = np.float32(RESOLUTION) * np.sqrt(fields[i, r, c])


@compiled(inline=False)
def _transform_line(fields, i, line, upright, work):
    """Replace a column or a row of squared distances by the lower envelope of its parabolas.

    Felzenszwalb and Huttenlocher, "Distance Transforms of Sampled Functions", 2012.
    """
    side = fields.shape[1]
    values, vertices, borders = work[0], work[1], work[2]
    for q in range(side):
        values[q] = fields[i, q, line] if upright else fields[i, line, q]
    last = 0
    vertices[0], borders[0], borders[1] = 0, -np.inf, np.inf
    for q in range(1, side):
        border = _meeting(values, q, int(vertices[last]))
        while border <= borders[last]:
            last -= 1
            border = _meeting(values, q, int(vertices[last]))
        last += 1
        vertices[last], borders[last], borders[last + 1] = q, border, np.inf
    k = 0
    for q in range(side):
        while borders[k + 1] < q:
            k += 1
        v = int(vertices[k])
        squared = np.float32((q - v) * (q - v) + values[v])
        if upright:
            fields[i, q, line] = squared
        else:
            fields[i, line, q] = squared


@compiled
def _meeting(values, q, v):
    """Return where the parabolas over q and over v, which is to its left, meet."""
    return (values[q] + q * q - values[v] - v * v) / (2.0 * (q - v))


@compiled
def distance_at(fields, i, x, y):
    """Return the distance at a place in the base frame [m]; infinity beyond the field."""
    half = fields.shape[1] // 2
    column = int(np.floor(x / RESOLUTION)) + half
    row = int(np.floor(y / RESOLUTION)) + half
    if 0 <= column < fields.shape[2] and 0 <= row < fields.shape[1]:
        return float(fields[i, row, column])
    return np.inf
