# SPDX-License-Identifier: Apache-2.0
"""The footprint of a URDF: the convex hull of its solids, seen from above."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from pm01_nav.errors import InputError
from pm01_nav.geometry import is_convex_counter_clockwise
from pm01_nav.robot_import.urdf import Solid, Urdf, refuse_missing_file

FloatArray = NDArray[np.float64]

CORNERS = 64
"""A circle becomes as many corners, whose polygon is 0.12 % smaller."""
ROUND = 0.97
"""A hull whose nearest point is so much of its farthest is a circle; a 12-gon is just not."""
DIGITS = 4
"""Corners are rounded to 0.1 mm, and what then lies on an edge is dropped."""


def find_outline(
    urdf: Urdf, origin: tuple[float, float], radius: float | None
) -> tuple[dict[str, Any], str, list[str]]:
    """Return a footprint around ``origin``, what it was read from, and warnings.

    Raises:
        InputError: there is no shape to take it from, or ``origin`` lies outside of it.
    """
    if radius is not None:
        return {"shape": "circle", "radius": radius}, "--footprint-radius", []
    solids = urdf.collisions or urdf.visuals
    kind = "collision" if urdf.collisions else "visual"
    warnings = []
    for solid in solids:
        if solid.kind == "mesh":
            refuse_missing_file(solid, urdf.path)
            warnings.append(
                f"link {solid.link!r}: mesh {solid.mesh[:120]!r}: left out of the footprint"
            )
    points = [corners(solid)[:, :2] for solid in solids if solid.kind != "mesh"]
    if not points:
        raise InputError(
            f"{urdf.path}: has no box, cylinder or sphere to take a footprint from; "
            "give --footprint-radius"
        )
    floor = np.concatenate(points) - np.array(origin)
    return _footprint(floor, urdf), f"hull of the {kind} shapes", warnings


def corners(solid: Solid) -> FloatArray:
    """Return points in the robot's frame whose hull is the solid, shape (n, 3) [m]."""
    angle = np.arange(CORNERS) * 2.0 * np.pi / CORNERS
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    if solid.kind == "sphere":
        # Seen from above a ball is a circle, however it is turned.
        flat = np.column_stack([solid.size[0] * circle, np.zeros(CORNERS)])
        return flat + solid.pose.translation
    if solid.kind == "box":
        signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
        return solid.pose.points(0.5 * signs * np.array(solid.size))
    radius, length = solid.size
    ends = [
        np.column_stack([radius * circle, np.full(CORNERS, z)])
        for z in (-0.5 * length, 0.5 * length)
    ]
    return solid.pose.points(np.concatenate(ends))


def _footprint(points: FloatArray, urdf: Urdf) -> dict[str, Any]:
    # Rounded corners may lie on an edge, which only a second hull finds.
    vertices = _hull(np.round(_hull(points), DIGITS))
    if len(vertices) < 3:
        raise InputError(f"{urdf.path}: its shapes cover no area; give --footprint-radius")
    if not is_convex_counter_clockwise(vertices):
        raise InputError(
            f"{urdf.path}: the middle of the axle lies outside of the footprint that its shapes "
            "make; give --footprint-radius"
        )
    edges = np.roll(vertices, -1, axis=0) - vertices
    cross = vertices[:, 0] * edges[:, 1] - vertices[:, 1] * edges[:, 0]
    nearest = float((cross / np.linalg.norm(edges, axis=1)).min())
    farthest = float(np.linalg.norm(points, axis=1).max())
    if nearest > ROUND * farthest:
        return {"shape": "circle", "radius": round(farthest, DIGITS)}
    return {"shape": "polygon", "vertices": [(float(x), float(y)) for x, y in vertices]}


def _hull(points: FloatArray) -> FloatArray:
    """Return the corners of the hull, counter-clockwise; none if it has no area."""
    try:
        return points[ConvexHull(points).vertices]
    except (QhullError, ValueError):
        return np.zeros((0, 2))
