# SPDX-License-Identifier: Apache-2.0
"""Costmaps made on the way: what is marked, cleared, carried along and forgotten."""

from __future__ import annotations

import numpy as np
import pytest

from pm01_nav.planners import make_planner
from pm01_nav.planners.rolling_costmap import CostmapParams, RollingCostmap
from pm01_nav.robot import full_circle, load_robot

BEAMS = 36
PARAMS = CostmapParams(resolution=0.1, size=40, obstacle_range=1.5, padding=0.0)
REST = np.zeros((1, 2))
BLIND = np.full((1, BEAMS), np.nan)


def make(count: int = 1) -> RollingCostmap:
    robot = load_robot("pm01")
    lidar = robot.lidar.model_copy(update=full_circle(BEAMS))
    return RollingCostmap(robot.model_copy(update={"lidar": lidar}), 0.1, count, PARAMS)


def looking(**ranges: float) -> np.ndarray:
    """Return a scan of no returns but for some of the beams ahead, left, behind and right."""
    beams = {"behind": 0, "right": 9, "ahead": 18, "left": 27}
    scan = np.full((1, BEAMS), np.inf)
    for name, value in ranges.items():
        scan[0, beams[name]] = value
    return scan


def blocked(costmap: RollingCostmap, x: float, y: float, i: int = 0) -> bool:
    space = costmap.costmaps(i)[0].space
    cell = space.cell(x, y)
    assert cell is not None
    return not space.free[cell]


def test_a_return_blocks_a_disc_around_it() -> None:
    costmap = make()
    costmap.observe(looking(ahead=1.05), REST)
    # PM01's radius is 0.17 m; cells are looked at from centre to centre.
    for x, expected in ((0.8, False), (0.95, True), (1.05, True), (1.15, True), (1.3, False)):
        assert blocked(costmap, x, 0.0) == expected, x
    assert not blocked(costmap, 0.0, 1.05)


def test_walls_stay_where_they_are_in_their_cells() -> None:
    # 0.17 m before 1.09 m is 0.92 m: the cell around 0.95 m is closed, that around 0.85 m is not.
    # Before 1.01 m it is 0.84 m, and the cell around 0.85 m is closed, too.
    for ahead, expected in ((1.09, False), (1.01, True)):
        costmap = make()
        costmap.observe(looking(ahead=ahead), REST)
        assert blocked(costmap, 0.85, 0.0) == expected
        assert blocked(costmap, 0.95, 0.0)


def test_straight_lines_need_half_a_cell_more_than_ways_from_cell_to_cell() -> None:
    costmap = make()
    costmap.observe(looking(ahead=1.05), REST)
    ways, lines = (c.space for c in costmap.costmaps(0))
    cell = ways.cell(0.85, 0.05)
    # 0.206 m from the return, 0.036 m more than the radius.
    assert ways.free[cell]
    assert not lines.free[cell]


def test_beams_clear_what_has_gone() -> None:
    costmap = make()
    costmap.observe(looking(ahead=1.05), REST)
    costmap.observe(looking(), REST)
    assert not blocked(costmap, 1.05, 0.0)


def test_nothing_is_cleared_behind_a_return_nor_by_a_beam_that_says_nothing() -> None:
    costmap = make()
    costmap.observe(looking(ahead=1.25, left=1.05), REST)
    costmap.observe(looking(ahead=0.55, left=np.nan), REST)
    assert blocked(costmap, 0.55, 0.0)
    assert blocked(costmap, 1.25, 0.0)
    assert blocked(costmap, 0.0, 1.05)


def test_far_returns_are_not_marked() -> None:
    costmap = make()
    costmap.observe(looking(ahead=1.65), REST)
    assert not blocked(costmap, 1.65, 0.0)


def test_too_close_is_marked_where_the_lidar_begins_to_see() -> None:
    costmap = make()
    costmap.observe(looking(ahead=-np.inf), REST)
    assert blocked(costmap, 0.12, 0.0)


def test_the_map_stays_where_the_robot_moves() -> None:
    costmap = make()
    costmap.observe(looking(left=1.0), REST)
    ahead = np.array([[1.0, 0.0]])
    for _ in range(12):
        costmap.observe(BLIND, ahead)
    # Half a step at first, when the speed rises from 0 to 1 m/s: 0.05 + 11 x 0.1 m.
    assert costmap.pose[0] == pytest.approx([1.15, 0.0, 0.0])
    # More than a quarter of 4 m: the map moved, and what is on it did not.
    corner = costmap.costmaps(0)[0].space.origin
    assert corner == pytest.approx((-0.9, -2.0))
    assert blocked(costmap, 0.0, 1.0)


def test_what_is_left_behind_is_forgotten() -> None:
    costmap = make()
    costmap.observe(looking(behind=1.0), REST)
    for _ in range(25):
        costmap.observe(BLIND, np.array([[1.0, 0.0]]))
    for _ in range(25):
        costmap.observe(BLIND, np.array([[-1.0, 0.0]]))
    assert costmap.pose[0, :2] == pytest.approx([0.0, 0.0], abs=0.06)
    assert not blocked(costmap, -1.0, 0.0)


def test_robots_have_maps_of_their_own() -> None:
    costmap = make(2)
    scans = np.concatenate([looking(ahead=1.0), looking(left=1.0)])
    costmap.observe(scans, np.zeros((2, 2)))
    assert [blocked(costmap, 1.0, 0.0, i) for i in range(2)] == [True, False]
    costmap.keep(np.array([1]))
    assert not blocked(costmap, 1.0, 0.0)
    assert blocked(costmap, 0.0, 1.0)


def test_odometry_tells_how_far_a_robot_came_in_a_pause() -> None:
    costmap = make()
    costmap.observe(looking(left=1.05), REST)
    # Pushed 0.5 m ahead and turned to the left: what lay 1.05 m to the left is ahead now, and half
    # a metre to the left. The map keeps it at (0, 1.05).
    costmap.observe(BLIND, REST, seconds=60.0, motion=np.array([[0.5, 0.0, np.pi / 2]]))
    assert costmap.pose[0] == pytest.approx([0.5, 0.0, np.pi / 2])
    assert blocked(costmap, 0.0, 1.05)
    costmap.observe(looking(ahead=0.75), REST, motion=np.zeros((1, 3)))
    assert blocked(costmap, 0.5, 0.75)


def test_a_planner_keeps_its_map_through_a_pause_if_it_knows_the_odometry() -> None:
    robot = load_robot("pm01")
    scan, goal, rest = np.full(robot.lidar.num_beams, 3.0), (2.0, 0.0), (0.0, 0.0)
    for told, x in (((5.0, 0.0, 0.0), (5.4, 0.0, 0.0)), 0.4), ((None, None), 0.0):
        planner = make_planner("vfh", robot, 0.1)
        planner.act(scan, goal, (0.3, 0.0), now=1.0, pose=told[0])
        before = planner._map
        planner.act(scan, goal, rest, now=3.0, pose=told[1])
        assert planner._map.pose[0, 0] == pytest.approx(x)
        assert (planner._map is before) == (told[0] is not None)
