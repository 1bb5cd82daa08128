# SPDX-License-Identifier: Apache-2.0
"""Distances in a world, measured in a slow and obvious way."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from pm01_nav.worlds.world import World

FloatArray = NDArray[np.float64]
Distance = Callable[[World, FloatArray], FloatArray]


@pytest.fixture(scope="session")
def distance() -> Distance:
    """Return a function that measures points (n, 2) to the nearest solid thing, 0 inside one."""
    return _distance


def _distance(world: World, points: FloatArray) -> FloatArray:
    x, y = points.T
    least = np.full(len(points), np.inf)
    for cx, cy, radius in world.discs:
        least = np.minimum(least, np.hypot(x - cx, y - cy) - radius)
    for x1, y1, x2, y2 in world.all_segments:
        length = np.hypot(x2 - x1, y2 - y1)
        ux, uy = (x2 - x1) / length, (y2 - y1) / length
        along = np.clip((x - x1) * ux + (y - y1) * uy, 0.0, length)
        least = np.minimum(least, np.hypot(x - x1 - along * ux, y - y1 - along * uy))
    for polygon in world.polygons:
        # Inside, the angles under which the corners are seen add up to a whole turn.
        corners = polygon[None] - points[:, None]
        angles = np.arctan2(corners[..., 1], corners[..., 0])
        turns = np.diff(np.concatenate([angles, angles[:, :1]], axis=1), axis=1)
        turns = (turns + np.pi) % (2 * np.pi) - np.pi
        least = np.where(np.abs(turns.sum(axis=1)) > np.pi, 0.0, least)
    return np.maximum(least, 0.0)
