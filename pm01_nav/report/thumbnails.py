# SPDX-License-Identifier: Apache-2.0
"""A stored episode as a small picture: the world, the way driven, start, goal and end."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from pm01_nav.benchmark.trace import Trace

SIDE = 100.0
"""Longer side of a picture [units]."""
TRAIL_POINTS = 60
MAX_SHAPES = 400
"""Obstacles beyond so many are left out; the replay has them all."""


class _Plane:
    """World coordinates as those of a picture; the world's y points up."""

    def __init__(self, bounds: NDArray[np.floating]) -> None:
        x_min, y_min, x_max, y_max = (float(b) for b in bounds)
        self.scale = SIDE / max(x_max - x_min, y_max - y_min, 1e-3)
        self._left, self._top = x_min, y_max
        self.width, self.height = self.scale * (x_max - x_min), self.scale * (y_max - y_min)

    def path(self, points: NDArray[np.floating], digits: int = 1) -> str:
        """Return a polyline through points (n, 2) [m]."""
        pixels = (np.asarray(points, dtype=np.float64) - [self._left, self._top]) * self.scale
        steps = [f"{x:.{digits}f} {-y:.{digits}f}" for x, y in np.nan_to_num(pixels).tolist()]
        return "M" + "L".join(steps) if steps else ""

    def dot(self, point: NDArray[np.floating], radius: float, name: str) -> str:
        """Return a disc of ``radius`` [units] of a CSS class."""
        x, y = self.path(point[None, :2])[1:].split(" ")
        return f'<circle class="{name}" cx="{x}" cy="{y}" r="{max(radius, 0.0):.1f}"/>'


def thumbnail(trace: Trace) -> Markup:
    """Return an SVG element; all that is in it are numbers."""
    plane = _Plane(trace.bounds)
    kept = np.unique(np.linspace(0, len(trace.pose) - 1, TRAIL_POINTS).round().astype(int))
    goal = max(float(trace.about["goal_radius"]) * plane.scale, 2.5)
    parts = [
        f'<path class="solid" d="{_areas(trace, plane)}"/>',
        *(plane.dot(disc, disc[2] * plane.scale, "solid") for disc in trace.discs[:MAX_SHAPES]),
        f'<path class="wall" d="{_walls(trace, plane)}"/>',
        plane.dot(trace.goal, goal, "goal"),
        f'<path class="trail" d="{plane.path(trace.pose[kept, :2])}"/>',
        plane.dot(trace.pose[-1], 2.5, "end"),
    ]
    box = f"-2 -2 {plane.width + 4:.1f} {plane.height + 4:.1f}"
    svg = f'<svg class="thumb" viewBox="{box}" aria-hidden="true">{"".join(parts)}</svg>'
    return Markup(svg)  # noqa: S704


def _areas(trace: Trace, plane: _Plane) -> str:
    """Return polygons and the solid cells of the grid, a row's neighbours in one piece."""
    ends = np.cumsum(trace.corner_counts)[:-1]
    polygons = np.split(trace.corners, ends)[:MAX_SHAPES]
    areas = [plane.path(corners) + "Z" for corners in polygons if len(corners)]
    if trace.grid.size:
        areas += [plane.path(cells, 0) + "Z" for cells in _runs(trace)]
    return "".join(areas)


def _runs(trace: Trace) -> list[NDArray[np.float64]]:
    """Return rectangles (4, 2) that cover the solid cells of a grid, thinned to a few rows."""
    x0, y0, side = (float(value) for value in trace.grid_frame)
    every = max(1, -(-max(trace.grid.shape) // 100))
    coarse = trace.grid[::every, ::every] != 0
    side *= every
    runs = []
    for row, cells in enumerate(coarse):
        edges = np.flatnonzero(np.diff(cells.astype(np.int8), prepend=0, append=0))
        for begin, end in edges.reshape(-1, 2).tolist():
            left, right, low = x0 + side * begin, x0 + side * end, y0 + side * row
            high = low + side
            runs.append(np.array([[left, low], [right, low], [right, high], [left, high]]))
    return runs


def _walls(trace: Trace, plane: _Plane) -> str:
    return "".join(plane.path(ends.reshape(2, 2)) for ends in trace.segments[:MAX_SHAPES])
