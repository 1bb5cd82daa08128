# SPDX-License-Identifier: Apache-2.0
"""Traps stand where they must, and let nobody through."""

from __future__ import annotations

import numpy as np
import pytest

from pm01_nav.worlds.free_space import free_space, shortest_path_length
from pm01_nav.worlds.pool import generate_pool
from pm01_nav.worlds.suites.layout import Layout
from pm01_nav.worlds.suites.traps import _blind_alley, _bowl, _hook, _u, u_traps

SHAPES = {"u": _u, "blind_alley": _blind_alley, "bowl": _bowl, "hook": _hook}
BOUNDS = (-5.0, -5.0, 5.0, 5.0)


@pytest.mark.parametrize("name", sorted(SHAPES))
def test_a_trap_is_open_in_front_and_closed_behind(name: str) -> None:
    for seed in range(30):
        trap = SHAPES[name](np.random.default_rng(seed))
        layout = Layout(BOUNDS)
        trap.put(layout, (0.0, 0.0), 0.0)
        space = free_space(layout.world(name), 0.27, resolution=0.05)
        inside, before = (0.1 * trap.depth, 0.0), (-4.5, 0.0)
        way_out = shortest_path_length(space, inside, before)
        # Out through the mouth, which faces -x, and almost straight.
        assert 4.5 + inside[0] <= way_out < 1.25 * (4.5 + inside[0]) + 0.6
        behind = (4.5, 0.0)
        # To the other side the way leads back through the mouth and around: an end of an arm is at
        # least half the mouth of 0.8 m, less what the U may narrow, from the axis.
        assert shortest_path_length(space, inside, behind) > 4.5 + 0.5 * trap.depth + 0.3


def test_start_and_goal_lie_on_either_side_of_a_trap() -> None:
    count = 60
    pool = generate_pool(u_traps, range(1, 2 * count, 2), 0.27)
    arrays, longer, restricted = pool.arrays, [], 0
    for index, world in enumerate(pool.worlds):
        assert (world.start_area is None) == (world.goal_area is None)
        if world.start_area is None:
            continue
        restricted += 1
        for area in (world.start_area, world.goal_area):
            assert area[2] - area[0] == pytest.approx(1.0)
            assert min(area[:2]) >= 0.0
            assert max(area[2:]) <= 10.0
        start = arrays.starts[arrays.start_begin[index]]
        goal = arrays.goals[arrays.goal_begin[index]]
        way = shortest_path_length(pool.free_space(index), tuple(start), tuple(goal))
        longer.append(way / np.hypot(*(goal - start)))
    # With probability 0.85: 51 +- sqrt(60 x 0.85 x 0.15) = 2.8.
    assert abs(restricted - 0.85 * count) < 4 * 2.8
    assert np.mean(np.array(longer) > 1.05) > 0.8
    assert np.median(longer) > 1.2


def test_start_is_often_inside() -> None:
    """Where the start is drawn inside the trap, what is around it closes most directions."""
    closed = []
    for seed in range(60):
        world = u_traps(np.random.default_rng(seed))
        if world.start_area is None:
            continue
        x = 0.5 * (world.start_area[0] + world.start_area[2])
        y = 0.5 * (world.start_area[1] + world.start_area[3])
        layout = Layout(world.bounds, [world.segments[4:]], polygons=list(world.polygons))
        angles = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
        rays = [layout.ray(np.array([x, y]), np.array([np.cos(a), np.sin(a)])) for a in angles]
        closed.append(np.mean(np.array(rays) < 2.5))
    # Inside with probability 0.35 / 0.85 = 0.41; of 51 worlds the deviation is 0.07.
    assert abs(np.mean(np.array(closed) > 0.5) - 0.41) < 4 * 0.07
