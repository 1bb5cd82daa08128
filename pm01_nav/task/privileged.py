# SPDX-License-Identifier: Apache-2.0
"""What a simulator knows and no robot does, for a critic that only the training needs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pm01_nav.arrays import array_namespace

REACH = 5.0
"""Distances and speeds are divided by this [m, m/s]; a mover further away looks like none."""
NEAR = 0.3
"""Clearance c is shown as (d - c) / (d + c) with this d [m], as scans are."""
MAX_MOVERS = 4


@dataclass(frozen=True)
class Privileged:
    """The nearest movers beside the true clearance, goal and motion of a robot."""

    movers: int = MAX_MOVERS
    """How many are shown; rows of zeros stand for those that are not there."""

    @property
    def size(self) -> int:
        """How many numbers there are for a robot."""
        return 6 + 5 * self.movers

    def observe(self, state: Any, indices: Any = slice(None)) -> Any:
        """Return true numbers of robots, float32, shape (n, size), each within [-1, 1] or near.

        Clearance as nearness; distance, sine and cosine of the goal; v and w [m/s, rad/s] over
        ``REACH``; then for each mover, the nearest first, its place and velocity in ``base_link``
        over ``REACH`` and its radius [m].
        """
        goal, twist = state.goal_polar[indices], state.twist[indices]
        xp = array_namespace(goal)
        clearance = xp.maximum(state.clearance[indices], 0.0)
        columns = [
            (NEAR - clearance) / (NEAR + clearance),
            xp.minimum(goal[:, 0] / REACH, 1.0),
            xp.sin(goal[:, 1]),
            xp.cos(goal[:, 1]),
            twist[:, 0] / REACH,
            twist[:, -1] / REACH,
        ]
        shown = xp.zeros((goal.shape[0], self.size), dtype=xp.float32)
        shown[:, : len(columns)] = xp.stack(columns, axis=-1)
        movers = self._movers(xp, state, indices)
        shown[:, len(columns) : len(columns) + movers.shape[1]] = movers
        return shown

    def _movers(self, xp: Any, state: Any, indices: Any) -> Any:
        """Return the nearest movers' numbers, shape (n, at most 5 * movers)."""
        pose, heading = state.pose[indices], state.heading[indices]
        away = state.mover_position[indices] - pose[:, None, :2]
        distance = xp.hypot(away[..., 0], away[..., 1])
        there = xp.arange(distance.shape[1])[None] < state.mover_count[indices][:, None]
        order = xp.argsort(xp.where(there, distance, xp.inf), axis=1)[:, : self.movers]
        rows = xp.arange(pose.shape[0])[:, None]
        velocity = state.mover_velocity[indices][rows, order]
        parts = [
            *_turned(away[rows, order], heading),
            *_turned(velocity, heading),
            state.mover_radius[indices][rows, order] * REACH,
        ]
        near = (there & (distance < REACH))[rows, order]
        numbers = xp.stack(parts, axis=-1) / REACH * near[..., None]
        return xp.reshape(numbers, (pose.shape[0], -1))


def _turned(vectors: Any, heading: Any) -> tuple[Any, Any]:
    """Return vectors (n, k, 2) in the world as seen from ``base_link``, forward and left."""
    cos, sin = heading[:, None, 0], heading[:, None, 1]
    x, y = vectors[..., 0], vectors[..., 1]
    return cos * x + sin * y, cos * y - sin * x
