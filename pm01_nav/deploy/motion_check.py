# SPDX-License-Identifier: Apache-2.0
"""Where a motion would lead among the returns of a raw scan, and how fast it may be."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pm01_nav.deploy.messages import Scan
from pm01_nav.geometry import after_twist, to_frame, to_world, wrap_angle
from pm01_nav.readings import is_valid

if TYPE_CHECKING:
    from pm01_nav.robot import Footprint

FloatArray = NDArray[np.float64]
STEP = 0.01
"""So far the outline moves between two looks [m]..."""
MAX_LOOKS = 64
"""... unless there were more looks than this: a fast robot takes longer steps, and more room."""
NEARER = 1e-5
"""A point that already is too close may come so much closer unnoticed [m]."""
TOO_CLOSE = 0.05
"""What is too close lies no nearer than this: on the lidar itself it would lie in no direction."""
CONE = math.pi / 4 + 1e-6
"""What lies that way is what lies within this angle of it [rad]."""
BLIND_GAP = math.radians(10.0) + 1e-6
"""So wide a gap between the beams that tell something hides a leg half a metre away [rad]."""
BLIND_STEPS = 2.5
"""A gap is wider than so many steps between beams: one beam that is lost makes two."""
AHEAD_AND_BEHIND = (0.0, math.pi)


class Outline:
    """A circle, or a convex polygon, in base_link."""

    def __init__(self, footprint: Footprint) -> None:
        """Take over what a robot's description says of its outline."""
        self.radius = footprint.circumscribed_radius
        """Distance from base_link to the farthest point of the outline [m]."""
        self.turning_radius = 0.0 if footprint.shape == "circle" else self.radius
        """How far turning moves a point of the outline to another place, for each radian [m]."""
        self._normals: FloatArray | None = None
        if footprint.shape == "polygon":
            corners = np.array(footprint.vertices)
            edges = np.roll(corners, -1, axis=0) - corners
            # Counter-clockwise, so the outside is to the right.
            outward = np.stack([edges[:, 1], -edges[:, 0]], axis=-1)
            self._normals = outward / np.linalg.norm(outward, axis=1, keepdims=True)
            self._offsets = (self._normals * corners).sum(axis=1)

    def clearance(self, points: FloatArray) -> FloatArray:
        """Return how far points (..., 2) are outside [m]; negative inside, shape (...).

        Beside a polygon's corner it is less than the true distance, never more.
        """
        if self._normals is None:
            return np.hypot(points[..., 0], points[..., 1]) - self.radius
        return (points @ self._normals.T - self._offsets).max(axis=-1)


def returns_as_points(scan: Scan, mount: FloatArray) -> FloatArray:
    """Return where a raw scan met something, in base_link, shape (n, 2) [m].

    ``mount`` (3,) is the lidar's pose in base_link [m, m, rad]. What is too close (-inf) lies at
    range_min, or ``TOO_CLOSE`` if that is less; what is invalid (NaN, out of range) says nothing.
    """
    ranges = np.asarray(scan.ranges, dtype=np.float32)
    # In float32, as the driver wrote it: its range_min must not fall below our float64 one.
    met = (ranges >= np.float32(scan.range_min)) & (ranges <= np.float32(scan.range_max))
    too_close = ranges == -np.inf
    shown = np.flatnonzero(met | too_close)
    nearest = max(scan.range_min, TOO_CLOSE)
    distance = np.where(too_close[shown], nearest, ranges[shown]).astype(np.float64)
    angle = scan.angle_min + scan.angle_increment * shown
    points = np.stack([distance * np.cos(angle), distance * np.sin(angle)], axis=-1)
    return to_world(points, mount)


def seen_share(
    scan: Scan, mount_yaw: float, courses: Sequence[float] = AHEAD_AND_BEHIND
) -> tuple[float, ...]:
    """Return how much a scan tells of what lies on each course, a direction in base_link [rad].

    It is the number of valid beams within ``CONE``, as a share of those that a lidar which looks
    there would have; and 0 where a gap between them is wider than ``BLIND_GAP``.
    """
    if scan.angle_increment == 0.0:
        return (0.0,) * len(courses)
    ranges = np.asarray(scan.ranges, dtype=np.float32)
    valid = is_valid(ranges, np.float32(scan.range_min), np.float32(scan.range_max))
    beams = (len(ranges), mount_yaw + scan.angle_min, scan.angle_increment)
    return tuple(_share_within(_cone(*beams, course), valid) for course in courses)


class _Cone(NamedTuple):
    """The beams of a lidar as seen from the middle of a cone, from right to left."""

    order: NDArray[np.int64]
    angles: FloatArray
    """Those beyond the cone, or beyond what the lidar sees of it, are moved to its edge [rad]."""
    within: NDArray[np.bool_]
    step: float
    """[rad]"""


@lru_cache(maxsize=16)
def _cone(count: int, first: float, increment: float, middle: float) -> _Cone | None:
    """Return the beams around the direction ``middle`` [rad]; None if there are none."""
    beams = np.arange(count, dtype=np.float64)
    angles: FloatArray = wrap_angle(first + increment * beams - middle)
    order = np.argsort(angles)
    angles = angles[order]
    within = np.abs(angles) <= CONE
    if not within.any():
        return None
    edges = angles[within][[0, -1]]
    return _Cone(order, np.clip(angles, *edges), within, abs(increment))


def _share_within(cone: _Cone | None, valid: NDArray[np.bool_]) -> float:
    if cone is None:
        return 0.0
    valid = valid[cone.order]
    # The cone's edges bound the gaps beside the outermost beams that tell something.
    told = np.concatenate([cone.angles[:1], cone.angles[valid], cone.angles[-1:]])
    if (told[1:] - told[:-1]).max() > max(BLIND_GAP, BLIND_STEPS * cone.step):
        return 0.0
    return float(np.count_nonzero(valid & cone.within)) * cone.step / (2.0 * CONE)


def time_to_contact(
    outline: Outline,
    points: FloatArray,
    twist: Sequence[float] | FloatArray,
    horizon: float,
    padding: float = 0.0,
    obstacle_speed: float = 0.0,
) -> float:
    """Return when the outline may first touch a point on the arc of ``twist`` [s]; inf if never.

    ``points`` (n, 2) in base_link [m], ``twist`` v, w or vx, vy, w [m/s, rad/s], ``horizon`` [s]
    is how far it looks. The outline is ``padding`` [m] larger to every side, and points may come
    nearer at ``obstacle_speed`` [m/s]. A point that is inside from the start counts where it comes
    nearer. The answer may be early, by the time of two looks; it is never late.
    """
    *linear, turn = map(float, twist)
    travel = math.hypot(*linear)
    speed = travel + abs(turn) * outline.turning_radius
    steps = min(math.ceil(speed * horizon / STEP), MAX_LOOKS)
    if steps == 0:
        return math.inf
    # Between two looks the outline may come nearer by half of what it moves.
    between = 0.5 * speed * horizon / steps
    reach = outline.radius + padding + between + (travel + obstacle_speed) * horizon
    points = points[np.hypot(points[:, 0], points[:, 1]) <= reach]
    if len(points) == 0:
        return math.inf
    times = np.linspace(0.0, horizon, steps + 1)
    poses = after_twist(np.zeros((steps + 1, 3)), np.array([[*linear, turn]]), times)
    clearance = outline.clearance(to_frame(points, poses[:, None])) - padding
    free = clearance - obstacle_speed * times[:, None] - between
    start = clearance[0]
    hit = np.where(start <= 0.0, clearance < start - NEARER, free <= 0.0)[1:].any(axis=1)
    return float(times[hit.argmax()]) if hit.any() else math.inf


def allowed_share(
    contact: float, reaction: float, braking: float, time_to_collision: float
) -> float:
    """Return how much of a twist is safe, 0 to 1, if the whole of it leads to ``contact`` [s].

    At the share s the robot needs s ``reaction`` + s^2 ``braking`` / 2 of the way's time [s] to
    stop, where ``braking`` [s] is how long it brakes from the whole twist; and ``contact`` / s is
    its time to collision, which is kept at ``time_to_collision`` [s] or more.
    """
    if math.isinf(contact):
        return 1.0
    if braking > 0.0:
        stopping = (math.sqrt(reaction**2 + 2.0 * braking * contact) - reaction) / braking
    else:
        stopping = contact / reaction
    return min(1.0, stopping, contact / time_to_collision)
