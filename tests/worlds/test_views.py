# SPDX-License-Identifier: Apache-2.0
"""Lists of what can be seen: nothing that is seen may be missing, and little else be there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from pm01_nav.geometry import points_in_polygon, rectangle
from pm01_nav.robot import load_robot
from pm01_nav.sim.lidar import BEAM_ERROR
from pm01_nav.sim.simulator import PlanarSimulator
from pm01_nav.worlds.pool import build_pool
from pm01_nav.worlds.suites import suites
from pm01_nav.worlds.views import CELL, MARGIN, Views, list_views
from pm01_nav.worlds.world import World
from tests.sim.reference import reference_clearance, reference_scan

BOUNDS = (0.0, 0.0, 4.0, 4.0)


def listed(views: Views, column: int, row: int) -> tuple[list[int], list[int]]:
    """Return the segments and the discs that a cell of the only world lists, sorted."""
    cell = 1 + row * int(views.view_frame[0, 3]) + column
    parts = (
        (views.seen_segments, views.seen_segment_begin),
        (views.seen_discs, views.seen_disc_begin),
    )
    rows = [sorted(rows[begin[cell] : begin[cell + 1]].tolist()) for rows, begin in parts]
    return rows[0], rows[1]


def test_backs_and_what_is_behind_are_not_listed() -> None:
    # Counter-clockwise boxes: edges 0 to 3 (and 4 to 7) are bottom, right, top and left.
    near, far = rectangle(1.5, 2.0, 0.2, 3.0), rectangle(2.5, 2.25, 0.2, 0.9)
    world = World("boxes", BOUNDS, polygons=(near, far), discs=np.array([[3.0, 2.0, 0.1]]))
    views = list_views([world], 10.0)
    # From the left, at half height, the near box shows its left side only and hides the rest.
    assert listed(views, 0, 4) == ([3], [])
    # From the right of both the near one's right side is seen beside the far one, and the disc.
    assert listed(views, 7, 4) == ([1, 5], [0])
    # From below its bottom side is seen, too, and still it hides the rest.
    assert listed(views, 0, 0) == ([0, 3], [])


def test_the_solid_side_does_not_depend_on_the_direction_of_the_corners() -> None:
    # As wide as a widened cell, and a little more.
    box = rectangle(2.25, 2.25, 0.9, 0.9)
    one, other = (list_views([World("b", BOUNDS, polygons=(p,))], 9.0) for p in (box, box[::-1]))
    assert listed(one, 0, 4)[0] == [3]
    assert listed(one, 4, 0)[0] == [0]
    # Backwards the edges are top, right, bottom and left.
    assert listed(other, 0, 4)[0] == [3]
    assert listed(other, 4, 0)[0] == [2]


def test_thin_walls_are_seen_from_both_sides_and_only_within_range() -> None:
    wall = np.array([[2.0, 0.0, 2.0, 4.0]])
    views = list_views([World("wall", BOUNDS, segments=wall)], 1.0)
    width = round(4.0 / CELL)
    # The middle of a cell, up to half a diagonal of the widened cell nearer than 1 m to the wall.
    for column in range(width):
        middle = (column + 0.5) * CELL
        near = abs(middle - 2.0) <= 1.0 + np.hypot(0.5 * CELL + MARGIN, 0.5 * CELL + MARGIN)
        assert listed(views, column, 3)[0] == ([0] if near else [])


def test_a_pool_by_itself_lists_everything_in_one_cell_a_world() -> None:
    worlds = [suites()["rooms"].generator(np.random.default_rng(seed)) for seed in range(3)]
    arrays = build_pool(worlds, radius=0.27).arrays
    assert arrays.view_begin.tolist() == [0, 1, 2]
    assert arrays.seen_segments.tolist() == list(range(len(arrays.segments)))
    assert arrays.seen_segment_begin.tolist() == arrays.segment_begin.tolist()
    assert arrays.seen_discs.tolist() == list(range(len(arrays.discs)))
    assert arrays.seen_disc_begin.tolist() == arrays.disc_begin.tolist()


def test_world_with_nothing_in_it() -> None:
    views = list_views([World("nothing", BOUNDS)] * 2, 3.0)
    assert views.view_begin.tolist() == [0, 1]
    assert views.seen_segment_begin.tolist() == views.seen_disc_begin.tolist() == [0, 0, 0]


def free_places(world: World, rng: np.random.Generator, count: int) -> NDArray[np.float64]:
    """Return places in and around a world that are in no polygon, shape (n, 2) [m]."""
    x_min, y_min, x_max, y_max = world.bounds
    places = rng.uniform((x_min - 1.0, y_min - 1.0), (x_max + 1.0, y_max + 1.0), (count, 2))
    for polygon in world.polygons:
        places = places[~points_in_polygon(places, polygon)]
    return places


@pytest.mark.parametrize("suite", ["static", "rooms", "maze", "u_traps", "barn_like", "warehouse"])
def test_nothing_that_is_seen_is_missing(suite: str) -> None:
    # 6 worlds of a suite from 40 places: each scan and clearance as with all obstacles.
    rng = np.random.default_rng(0)
    robot = load_robot("pm01")
    robot = robot.model_copy(
        update={"lidar": robot.lidar.model_copy(update={"noise_std": 0.0, "range_max": 2.5})}
    )
    for seed in range(6):
        world = replace(suites()[suite].generator(np.random.default_rng(seed)), movers=())
        places = free_places(world, rng, 40)
        simulator = PlanarSimulator(robot, build_pool([world], radius=0.01), len(places))
        simulator.seed(np.arange(len(places)))
        simulator.reset()
        poses = np.column_stack([places, rng.uniform(-np.pi, np.pi, len(places))])
        simulator.place(np.arange(len(places)), poses, np.zeros_like(places))
        for pose, scan, clearance in zip(
            poses, simulator.scan, simulator.state.clearance, strict=True
        ):
            slow = reference_scan(world, robot, pose)
            off = np.flatnonzero(~np.isclose(scan, slow, atol=2e-6, rtol=0))
            if len(off):
                # Beams may be turned by BEAM_ERROR, which matters where they graze something.
                right = reference_scan(world, robot, pose - np.array([0.0, 0.0, BEAM_ERROR]))
                left = reference_scan(world, robot, pose + np.array([0.0, 0.0, BEAM_ERROR]))
                near, far = np.minimum(right, left) - 2e-6, np.maximum(right, left) + 2e-6
                off = off[~((scan[off] >= near[off]) & (scan[off] <= far[off]))]
            # A beam in a thousand may meet a corner, or the range limit.
            assert len(off) <= 1
            assert clearance == pytest.approx(reference_clearance(world, robot, pose), abs=1e-9)


def test_clearance_is_exact_beyond_what_the_lidar_sees(make_near_sighted) -> None:
    world = World("far", (0.0, 0.0, 20.0, 20.0), polygons=(rectangle(16.0, 10.0, 2.0, 2.0),))
    simulator = make_near_sighted(world, [[5.0, 10.0, 0.0]])
    # From the circle's rim at 5.17 m to the box's left side at 15 m.
    assert simulator.state.clearance[0] == pytest.approx(15.0 - 5.0 - 0.17)


@pytest.fixture
def make_near_sighted():
    """Return a simulator of robots at chosen poses that see 1 m."""

    def make(world: World, poses) -> PlanarSimulator:
        robot = load_robot("pm01")
        lidar = robot.lidar.model_copy(update={"range_max": 1.0})
        robot = robot.model_copy(update={"lidar": lidar})
        simulator = PlanarSimulator(robot, build_pool([world], radius=0.01), len(poses))
        simulator.seed(np.arange(len(poses)))
        simulator.reset()
        simulator.place(np.arange(len(poses)), np.array(poses), np.zeros((len(poses), 2)))
        return simulator

    return make
