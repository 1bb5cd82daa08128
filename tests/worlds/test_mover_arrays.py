# SPDX-License-Identifier: Apache-2.0
"""Loops and splines at times worked out by hand, and how movers are packed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from pm01_nav.worlds.mover import Mover
from pm01_nav.worlds.mover_arrays import (
    BOUNCE,
    PEDESTRIAN,
    TRACK,
    loop_position,
    pack_movers,
    spline_position,
)
from pm01_nav.worlds.world import World

BOUNDS = (0.0, 0.0, 10.0, 10.0)
SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
LOOP = Mover("loop", 0.2, SQUARE, speed=0.5)
CORNER = Mover(
    "spline",
    0.2,
    np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 2.0]]),
    times=np.array([0.0, 1.0, 3.0]),
)


def test_loop_by_hand() -> None:
    # A round of 4 m at 0.5 m/s takes 8 s; after 3 s 1.5 m are driven, after 7 s 3.5 m.
    times = np.array([0.0, 1.0, 2.0, 3.0, 7.0, 8.0])
    expected = [(0.0, 0.0), (0.5, 0.0), (1.0, 0.0), (1.0, 0.5), (0.0, 0.5), (0.0, 0.0)]
    assert loop_position(LOOP, times) == pytest.approx(np.array(expected))


def test_spline_by_hand() -> None:
    # Tangents: half of (1, 0), of (1, 2) and of (0, 2). In the middle of an interval the curve is
    # the middle of both keys and an eighth of the tangents' difference, so (0.5, 0) plus an eighth
    # of (0, -1), and (1, 1) plus an eighth of (0.5, 0).
    expected = [(0.0, 0.0), (0.5, -0.125), (1.0, 0.0), (1.0625, 1.0), (1.0, 2.0)]
    places = spline_position(CORNER, np.array([0.0, 0.5, 1.0, 2.0, 3.0]))
    assert places == pytest.approx(np.array(expected), abs=1e-12)


def test_closed_spline_by_hand() -> None:
    # The first and the last tangent are half of (1, 0) - (0, 1), the way from the last but one key
    # to the second. In the middle of the first interval: (0.5, 0) + ((0.5, -0.5) - (0, 0.5)) / 8.
    keys = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.0, 0.0]])
    closed = Mover("spline", 0.2, keys, times=np.array([0.0, 1.0, 2.0, 4.0]))
    place = spline_position(closed, np.array([0.5]))[0]
    assert place == pytest.approx([0.5625, -0.125])


def test_spline_equals_scipy() -> None:
    rng = np.random.default_rng(0)
    keys, times = rng.uniform(0, 10, (7, 2)), np.cumsum(rng.uniform(0.5, 3.0, 7))
    mover = Mover("spline", 0.2, keys, times=times - times[0])
    tangents = [0.5 * (keys[min(k + 1, 6)] - keys[max(k - 1, 0)]) for k in range(7)]
    u = rng.uniform(0, 1, 20)
    for k in range(6):
        curve = CubicHermiteSpline([0, 1], keys[k : k + 2], tangents[k : k + 2])
        places = spline_position(mover, mover.times[k] + u * (times[k + 1] - times[k]))
        assert places == pytest.approx(curve(u), abs=1e-9)


def test_packing() -> None:
    flyer = Mover("bounce", 0.3, np.array([[2.0, 3.0]]), speed=1.5, heading=np.pi / 2)
    walker = Mover("pedestrian", 0.25, np.array([[1.0, 1.0], [9.0, 9.0]]), speed=1.2)
    crowd = World("crowd", BOUNDS, movers=(flyer, walker))
    tracks = World("tracks", BOUNDS, movers=(LOOP, CORNER))
    arrays = pack_movers([World("empty", BOUNDS), crowd, tracks], random_phase=False)
    assert arrays.mover_begin.tolist() == [0, 0, 2, 4]
    assert arrays.mover_kind.tolist() == [BOUNCE, PEDESTRIAN, TRACK, TRACK]
    assert arrays.mover_period.tolist() == [0.0, 0.0, 8.0, 3.0]
    assert arrays.mover_jumps.tolist() == [False, False, False, True]
    assert arrays.mover_direction[0] == pytest.approx([0.0, 1.0])
    # 8 s and 3 s in pieces of 0.05 s, both ends included.
    assert np.diff(arrays.mover_point_begin).tolist() == [1, 2, 161, 61]
    assert arrays.mover_speed[:3] == pytest.approx([1.5, 1.2, 0.5])
    # The corner's fastest piece is faster than the 2 m in 2 s of its second half.
    assert 1.0 < arrays.mover_speed[3] < 1.5
    assert not arrays.mover_random_phase


def test_places_are_free_and_only_where_someone_walks() -> None:
    walker = Mover("pedestrian", 0.4, np.array([[1.0, 1.0]]), speed=1.2)
    disc = np.array([[5.0, 5.0, 2.0]])
    world = World("crowd", BOUNDS, discs=disc, movers=(walker,))
    empty = replace(world, movers=(LOOP,))
    arrays = pack_movers([empty, world])
    assert arrays.mover_place_begin.tolist() == [0, 0, 256]
    away = np.linalg.norm(arrays.mover_places - (5.0, 5.0), axis=1)
    assert (away >= 2.0 + 0.4 - 1e-9).all()
    assert np.ptp(arrays.mover_places, axis=0) == pytest.approx([10.0, 10.0], abs=0.6)
