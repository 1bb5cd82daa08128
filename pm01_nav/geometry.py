# SPDX-License-Identifier: Apache-2.0
"""Angles, frames and polygons: pure functions on arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def wrap_angle(angle: Array | float) -> Array:
    """Return the same direction in [-pi, pi) [rad], any shape."""
    wrapped = (np.asarray(angle) + np.pi) % (2.0 * np.pi) - np.pi
    # Just below -pi the remainder rounds up to a whole turn.
    return np.where(wrapped >= np.pi, -np.pi, wrapped)


def to_frame(points: Array, pose: Array) -> Array:
    """Express world points in the frame of ``pose``.

    ``points`` (..., 2) [m] and ``pose`` (..., 3) [m, m, rad] broadcast; returns (..., 2) [m].
    """
    delta = np.asarray(points) - np.asarray(pose)[..., :2]
    cos, sin = np.cos(np.asarray(pose)[..., 2]), np.sin(np.asarray(pose)[..., 2])
    forward = cos * delta[..., 0] + sin * delta[..., 1]
    left = -sin * delta[..., 0] + cos * delta[..., 1]
    return np.stack([forward, left], axis=-1)


def to_world(points: NDArray[np.floating], pose: NDArray[np.floating]) -> Array:
    """Return points in the frame of ``pose`` as points in the world: the inverse of ``to_frame``.

    ``points`` (..., 2) [m] and ``pose`` (..., 3) [m, m, rad] broadcast; returns (..., 2) [m].
    """
    points, pose = np.asarray(points), np.asarray(pose)
    cos, sin = np.cos(pose[..., 2]), np.sin(pose[..., 2])
    x = pose[..., 0] + cos * points[..., 0] - sin * points[..., 1]
    y = pose[..., 1] + sin * points[..., 0] + cos * points[..., 1]
    return np.stack([x, y], axis=-1)


def relative_pose(pose: Array, origin: Array) -> Array:
    """Return ``pose`` (..., 3) [m, m, rad] as seen from the pose ``origin`` (..., 3)."""
    place = to_frame(pose[..., :2], origin)
    return np.concatenate([place, wrap_angle(pose[..., 2:] - origin[..., 2:])], axis=-1)


def compose_poses(origin: Array, relative: Array) -> Array:
    """Return where ``relative`` (..., 3), seen from ``origin`` (..., 3), is [m, m, rad]."""
    place = to_world(relative[..., :2], origin)
    return np.concatenate([place, origin[..., 2:] + relative[..., 2:]], axis=-1)


def after_twist(pose: Array, twist: Array, dt: float | Array) -> Array:
    """Return poses (..., 3) [m, m, rad] after ``dt`` [s] on an arc of constant twist.

    ``twist`` (..., 2) or (..., 3): forwards, to the left if it has three, and the turn, in the
    frame of the pose [m/s, rad/s]; ``dt`` broadcasts with them.
    """
    turn = twist[..., -1] * dt
    along = pose[..., 2] + 0.5 * turn
    cos, sin = np.cos(along), np.sin(along)
    share = np.sinc(0.5 * turn / np.pi)
    ahead = twist[..., 0] * dt * share
    if twist.shape[-1] == 2:
        return pose + np.stack([ahead * cos, ahead * sin, turn], axis=-1)
    left = twist[..., 1] * dt * share
    return pose + np.stack([ahead * cos - left * sin, ahead * sin + left * cos, turn], axis=-1)


def rectangle(x: float, y: float, length: float, width: float, yaw: float = 0.0) -> Array:
    """Return the corners of a rectangle around (x, y), counter-clockwise, shape (4, 2) [m]."""
    half = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * np.array([length, width]) / 2.0
    cos, sin = np.cos(yaw), np.sin(yaw)
    return half @ np.array([[cos, sin], [-sin, cos]]) + np.array([x, y])


def polygon_edges(vertices: Array) -> Array:
    """Return a polygon's edges as segments (x1, y1, x2, y2), shape (num_vertices, 4) [m]."""
    return np.concatenate([vertices, np.concatenate([vertices[1:], vertices[:1]])], axis=1)


def is_convex_counter_clockwise(vertices: Array) -> bool:
    """Tell whether ``vertices`` (n, 2) are a strictly convex polygon around the origin."""
    if vertices.ndim != 2 or vertices.shape[0] < 3 or vertices.shape[1] != 2:
        return False
    edges = np.roll(vertices, -1, axis=0) - vertices
    following = np.roll(edges, -1, axis=0)
    turns = edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0]
    around_origin = vertices[:, 0] * edges[:, 1] - vertices[:, 1] * edges[:, 0]
    # A star-shaped outline turns left everywhere too; only a convex one turns 360 deg in all.
    headings = np.arctan2(edges[:, 1], edges[:, 0])
    total = wrap_angle(np.roll(headings, -1) - headings).sum()
    return bool((turns > 0).all() and (around_origin > 0).all() and abs(total - 2 * np.pi) < 1e-6)


def points_in_polygon(points: Array, vertices: Array) -> NDArray[np.bool_]:
    """Tell which ``points`` (n, 2) lie inside a simple polygon (k, 2), by counting crossings."""
    x, y = points[:, 0], points[:, 1]
    inside = np.zeros(len(points), dtype=bool)
    for x1, y1, x2, y2 in polygon_edges(vertices):
        if y1 == y2:
            continue
        crosses = (y1 > y) != (y2 > y)
        inside ^= crosses & (x < x1 + (y - y1) * (x2 - x1) / (y2 - y1))
    return inside
