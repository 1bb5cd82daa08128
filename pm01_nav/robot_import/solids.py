# SPDX-License-Identifier: Apache-2.0
"""The points that span a URDF's solids: boxes, cylinders, spheres and meshes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pm01_nav.errors import InputError
from pm01_nav.meshes import load_mesh
from pm01_nav.robot_import.elements import Solid
from pm01_nav.robot_import.packages import Packages

FloatArray = NDArray[np.float64]

CORNERS = 64
"""A circle becomes as many corners, whose polygon is 0.12 % smaller."""
BELOW = 0.01
"""What lies deeper than this under the floor [m] is no part of the footprint."""


class Solids:
    """Reads solids; meshes come from files."""

    def __init__(self, packages: Packages) -> None:
        """Look for meshes through ``packages``."""
        self._packages = packages

    def points(self, solid: Solid) -> FloatArray:
        """Return points in the robot's frame whose hull is that of the solid, shape (n, 3) [m].

        Raises:
            InputError: its mesh cannot be found or read.
        """
        if solid.kind == "mesh":
            return self._triangles(solid).reshape(-1, 3)
        return _corners(solid)

    def points_above(self, solid: Solid, floor: float) -> FloatArray:
        """Return points whose hull is that of the part above the floor, shape (n, 3) [m].

        Raises:
            InputError: its mesh cannot be found or read.
        """
        if solid.kind == "mesh":
            return _cut(self._triangles(solid), floor - BELOW)
        points = _corners(solid)
        return points if points[:, 2].max() > floor - BELOW else points[:0]

    def _triangles(self, solid: Solid) -> FloatArray:
        path, name = self._packages.path(solid.mesh), f"mesh {solid.mesh[:120]!r}"
        if path is None or not _is_file(path):
            raise InputError(f"{name}: not found")
        try:
            triangles = load_mesh(path)
        except InputError as error:
            raise InputError(f"{name}: {str(error).removeprefix(f'{path}: ')}") from error
        return solid.pose.points(triangles * np.array(solid.scale))


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    # A ValueError is a null byte in the name.
    except (OSError, ValueError):
        return False


def _corners(solid: Solid) -> FloatArray:
    angle = np.arange(CORNERS) * 2.0 * np.pi / CORNERS
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    if solid.kind == "sphere":
        # Its widest level is all that counts from above; top and bottom are for heights.
        (radius,) = solid.size
        level = np.column_stack([radius * circle, np.zeros(CORNERS)])
        poles = np.array([[0.0, 0.0, -radius], [0.0, 0.0, radius]])
        return solid.pose.translation + np.concatenate([level, poles])
    if solid.kind == "box":
        signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
        return solid.pose.points(0.5 * signs * np.array(solid.size))
    radius, length = solid.size
    ends = [
        np.column_stack([radius * circle, np.full(CORNERS, z)])
        for z in (-0.5 * length, 0.5 * length)
    ]
    return solid.pose.points(np.concatenate(ends))


def _cut(triangles: FloatArray, level: float) -> FloatArray:
    """Return the corners above a level, and where edges cross it, shape (n, 3) [m]."""
    starts = triangles.reshape(-1, 3)
    ends = np.roll(triangles, -1, axis=1).reshape(-1, 3)
    above, beyond = starts[:, 2] >= level, ends[:, 2] >= level
    crossing = above != beyond
    a, b = starts[crossing], ends[crossing]
    share = (level - a[:, 2:]) / (b[:, 2:] - a[:, 2:])
    return np.concatenate([starts[above], a + share * (b - a)])
