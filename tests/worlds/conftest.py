# SPDX-License-Identifier: Apache-2.0
"""Worlds for property tests: a few obstacles of every kind, turned and placed at random."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import strategies as st

from pm01_nav.geometry import rectangle
from pm01_nav.worlds.mover import Mover
from pm01_nav.worlds.world import World

place = st.floats(-4.0, 4.0)
points = st.tuples(place, place)
# An L and an arrow: neither rectangles nor convex.
OUTLINES = (
    ((0.0, 0.0), (2.0, 0.0), (2.0, 0.7), (0.6, 0.7), (0.6, 1.5), (0.0, 1.5)),
    ((0.0, 0.0), (1.0, -1.0), (0.5, 0.0), (1.0, 1.0)),
    ((0.0, 0.0), (1.0, 0.0), (0.2, 0.9)),
)


def turned(outline: tuple, at: tuple[float, float], yaw: float) -> np.ndarray:
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.array(outline) @ np.array([[cos, sin], [-sin, cos]]) + np.array(at)


discs = st.lists(st.tuples(place, place, st.floats(0.01, 1.5)), max_size=4)
boxes = st.builds(
    rectangle, place, place, st.floats(0.05, 3.0), st.floats(0.05, 3.0), st.floats(-3.2, 3.2)
)
outlines = st.builds(turned, st.sampled_from(OUTLINES), points, st.floats(-3.2, 3.2))
walls = st.lists(st.tuples(place, place, place, place), max_size=4)
times = st.lists(st.floats(0.01, 9.0), min_size=1, max_size=4).map(
    lambda steps: np.cumsum([0.0, *steps])
)


@st.composite
def movers(draw: st.DrawFn) -> Mover:
    motion = draw(st.sampled_from(["bounce", "loop", "spline", "pedestrian"]))
    radius, speed = draw(st.floats(0.05, 0.6)), draw(st.floats(0.1, 2.0))
    if motion == "spline":
        at = draw(times)
        row = draw(st.lists(points, min_size=len(at), max_size=len(at)))
        return Mover("spline", radius, np.array(row), times=at)
    row = draw(st.lists(points, min_size=2, max_size=4))
    heading = draw(st.floats(-3.0, 3.0)) if motion == "bounce" else 0.0
    return Mover(motion, radius, np.array(row), speed=speed, heading=heading)


@st.composite
def worlds(draw: st.DrawFn) -> World:
    return World(
        draw(st.sampled_from(["lab", "room_1"])),
        (-5.0, -5.0, 5.0, 5.0),
        discs=np.array(draw(discs), dtype=np.float64).reshape(-1, 3),
        polygons=tuple(draw(st.lists(boxes | outlines, max_size=4))),
        segments=np.array(draw(walls), dtype=np.float64).reshape(-1, 4),
        movers=tuple(draw(st.lists(movers(), max_size=3))),
        start=draw(st.none() | st.tuples(place, place, place)),
        start_area=draw(st.none() | st.just((-2.0, -0.3, -1.5, 0.7))),
        goal_area=draw(st.none() | st.just((-1.0, 0.1, 2.5, 0.3))),
    )


@pytest.fixture(scope="session")
def any_world() -> st.SearchStrategy[World]:
    """A strategy for worlds without a grid."""
    return worlds()
