# SPDX-License-Identifier: Apache-2.0
"""The length of the way to the goal: by hand, and against scipy's Dijkstra on the same raster."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from pm01_nav.robot import load_robot
from pm01_nav.sim.settings import Features
from pm01_nav.sim.simulator import PlanarSimulator
from pm01_nav.task.randomization import RandomizationConfig
from pm01_nav.worlds.free_space import shortest_path_length
from pm01_nav.worlds.mover import Mover
from pm01_nav.worlds.pool import WorldPool, build_pool, generate_pool
from pm01_nav.worlds.suites import suites
from pm01_nav.worlds.world import World

RADIUS = 0.27
WAYS = Features(path_distances=True)


def simulator(pool: WorldPool, num_envs: int = 1) -> PlanarSimulator:
    sim = PlanarSimulator(load_robot("pm01"), pool, num_envs, features=WAYS)
    sim.seed(np.arange(num_envs))
    sim.reset()
    return sim


def wall_with_a_gap() -> World:
    """Return a room of 6 m x 4 m, cut by a wall at x = 3 m that ends 1.5 m before the top."""
    walls = np.array(
        [[0, 0, 6, 0], [6, 0, 6, 4], [6, 4, 0, 4], [0, 4, 0, 0], [3, 0, 3, 2.5]], dtype=float
    )
    return World("gap", (0.0, 0.0, 6.0, 4.0), segments=walls)


def test_way_around_a_wall() -> None:
    sim = simulator(build_pool([wall_with_a_gap()], RADIUS))
    sim.place(np.array([0]), [[2.0, 1.0, 0.0]], [[4.0, 1.0]])
    # Around the end of the wall at 0.27 m: the tangents from (2, 1) and (4, 1) to a circle around
    # (3, 2.5), each sqrt(3.25 - 0.0729) = 1.782 m, and an arc of 0.27 m x 0.88 rad between them.
    shortest = 2 * 1.782 + 0.27 * 0.88
    # Steps to eight neighbours lengthen a way by 8.3 % at most; ends and bend cost half a cell.
    assert shortest - 0.1 <= sim.state.path_distance[0] <= 1.083 * shortest + 0.3
    assert sim.state.goal_polar[0, 0] == pytest.approx(2.0)


def test_driving_along_the_way_shortens_it() -> None:
    sim = simulator(build_pool([wall_with_a_gap()], RADIUS))
    goal = [[4.0, 1.0]]
    distances = []
    for x, y in [(2.0, 1.0), (2.4, 1.8), (2.7, 2.7), (3.0, 2.9), (3.4, 2.6), (4.0, 1.6)]:
        sim.place(np.array([0]), [[x, y, 0.0]], goal)
        distances.append(float(sim.state.path_distance[0]))
    assert (np.diff(distances) < 0.0).all()
    # Straight above the goal nothing is in the way.
    assert distances[-1] == pytest.approx(0.6, abs=0.1)


def test_next_to_the_goal_it_is_the_straight_distance() -> None:
    sim = simulator(build_pool([wall_with_a_gap()], RADIUS))
    sim.place(np.array([0]), [[1.0, 1.0, 0.0]], [[1.3, 1.0]])
    assert sim.state.path_distance[0] == pytest.approx(0.3)


def test_field_equals_dijkstra() -> None:
    pool = generate_pool(suites()["maze"].generator, range(8), RADIUS)
    sim = simulator(pool, 16)
    for i in range(16):
        w = int(sim.state.world[i])
        begin, end = pool.arrays.way_begin[w], pool.arrays.way_begin[w + 1]
        x, y, size, width, height = pool.arrays.way_frame[w]
        free = pool.arrays.way_cells[begin:end].reshape(int(height), int(width)) != 0
        field = sim.state.path_field[i, : end - begin].reshape(free.shape)
        expected = independent_field(free, (x, y), size, sim.state.goal[i])
        assert field[free] == pytest.approx(expected[free], abs=1e-3)
        assert np.isinf(field[~free]).all()


def independent_field(free, origin, size, goal):
    """Dijkstra over a sparse graph: the cells, and the goal joined to the cells around it."""
    height, width = free.shape
    index = np.arange(free.size).reshape(free.shape)
    rows, columns, weights = [], [], []
    for dr, dc in [(0, 1), (1, 0), (1, 1), (1, -1)]:
        a = index[: height - dr, max(-dc, 0) : width - max(dc, 0)]
        b = index[dr:, max(dc, 0) : width + min(dc, 0)]
        both = free.ravel()[a] & free.ravel()[b]
        rows.append(a[both])
        columns.append(b[both])
        weights.append(np.full(both.sum(), size * np.hypot(dr, dc)))
    column, row = ((goal - np.array(origin)) / size).astype(int)
    for r in range(row - 1, row + 2):
        for c in range(column - 1, column + 2):
            if free[r, c]:
                centre = np.array(origin) + size * (np.array([c, r]) + 0.5)
                rows.append([free.size])
                columns.append([index[r, c]])
                weights.append([np.linalg.norm(centre - goal)])
    graph = coo_array(
        (np.concatenate(weights), (np.concatenate(rows), np.concatenate(columns))),
        shape=(free.size + 1, free.size + 1),
    )
    return dijkstra(graph.tocsr(), directed=False, indices=free.size)[:-1].reshape(free.shape)


def test_it_is_close_to_the_shortest_path() -> None:
    pool = generate_pool(suites()["rooms"].generator, range(6), RADIUS)
    sim = simulator(pool, 24)
    for i in range(24):
        space = pool.free_space(int(sim.state.world[i]))
        start, goal = tuple(sim.state.pose[i, :2]), tuple(sim.state.goal[i])
        shortest = shortest_path_length(space, start, goal)
        # Coarse cells may close up to one fine cell early and lengthen slanted ways by 8.3 %.
        assert 0.95 * shortest - 0.2 <= sim.state.path_distance[i] <= 1.083 * shortest + 0.3


def test_without_path_distances_it_is_straight() -> None:
    pool = build_pool([wall_with_a_gap()], RADIUS)
    sim = PlanarSimulator(load_robot("pm01"), pool, 4)
    sim.seed(np.arange(4))
    sim.reset()
    assert (sim.state.path_distance == sim.state.goal_polar[:, 0]).all()


def test_a_huge_world_has_no_raster() -> None:
    # 16384 cells of at most 0.4 m cover 51 m x 51 m.
    huge = World("huge", (0.0, 0.0, 60.0, 60.0))
    pool = build_pool([huge, wall_with_a_gap()], RADIUS)
    assert np.diff(pool.arrays.way_begin)[0] == 0
    sim = PlanarSimulator(load_robot("pm01"), pool, 2, features=WAYS)
    sim.seed(np.arange(2))
    sim.reset(worlds=np.array([0, 1]))
    assert sim.state.path_distance[0] == sim.state.goal_polar[0, 0]
    assert sim.state.path_distance[1] >= sim.state.goal_polar[1, 0]


@pytest.mark.parametrize("how", ["planar", "movers", "errors"])
def test_an_episode_off_the_raster_begins_with_the_straight_distance(how: str) -> None:
    world = replace(wall_with_a_gap(), discs=np.array([[1.0, 3.2, 0.5]]))
    if how == "movers":
        still = Mover("bounce", 0.1, np.array([[5.5, 3.5]]), speed=0.1, heading=0.0)
        world = replace(world, movers=(still,))
    sim = PlanarSimulator(load_robot("pm01"), build_pool([world], RADIUS), 1, features=WAYS)
    if how == "errors":
        sim.perturb(RandomizationConfig().ranges(sim.robot, 0.1))
    sim.seed([0])
    sim.reset()
    way = np.array([0]), [[2.0, 1.0, 0.0]], [[4.0, 1.0]]
    sim.place(*way)
    around = float(sim.state.path_distance[0])
    assert around > 3.0
    # In the middle of the disc no cell around is free: 4 m and 3 m to the sides of the goal.
    sim.place(np.array([0]), [[1.0, 3.2, 0.0]], [[5.0, 0.2]])
    assert sim.state.path_distance[0] == pytest.approx(5.0)
    sim.place(*way)
    assert sim.state.path_distance[0] == around
