# SPDX-License-Identifier: Apache-2.0
"""Plans through known maps, and the point on them to drive to next."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from pm01_nav.errors import InputError
from pm01_nav.geometry import rectangle
from pm01_nav.worlds.free_space import FreeSpace, free_space, shortest_path_length
from pm01_nav.worlds.global_plan import Costmap, GlobalPlan, inflate, plan_path
from pm01_nav.worlds.world import World

RADIUS = 0.27
BOUNDS = (0.0, 0.0, 6.0, 6.0)
L_PATH = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 3.0]])
"""4 m along x, then 3 m along y."""


def open_costmap(origin=(-5.0, -5.0)) -> Costmap:
    """Return a free square of 20 m."""
    space = FreeSpace(np.ones((200, 200), dtype=np.bool_), 0.1, origin)
    return inflate(space, RADIUS)


def l_plan() -> GlobalPlan:
    return GlobalPlan(open_costmap(), L_PATH)


def test_look_ahead_on_an_l_by_hand() -> None:
    plan = l_plan()
    assert plan.length == 7.0
    # (position, distance) -> point, deviation, progress.
    for position, distance, point, deviation, progress in (
        ((0.0, 0.0), 2.0, (2.0, 0.0), 0.0, 0.0),
        ((1.0, 0.2), 2.0, (3.0, 0.0), 0.2, 1.0),
        ((2.5, 0.0), 2.0, (4.0, 0.5), 0.0, 2.5),
        # 0.5 m are left to the corner, so 1.5 m of the second leg.
        ((3.5, -0.1), 2.0, (4.0, 1.5), 0.1, 3.5),
        ((4.3, 0.4), 1.0, (4.0, 1.4), 0.3, 4.4),
        # The end is the furthest point.
        ((4.0, 2.2), 2.0, (4.0, 3.0), 0.0, 6.2),
        ((4.0, 2.5), 2.0, (4.0, 3.0), 0.0, 6.5),
        # Beyond the end by 0.5 m, it still is.
        ((4.0, 3.5), 2.0, (4.0, 3.0), 0.5, 7.0),
    ):
        ahead = plan.look_ahead(position, distance)
        assert ahead.point == pytest.approx(np.array(point), abs=1e-9)
        assert ahead.deviation == pytest.approx(deviation, abs=1e-9)
        assert plan.progress == pytest.approx(progress, abs=1e-9)
        assert ahead.visible


def test_progress_never_falls() -> None:
    plan = l_plan()
    plan.progress = 6.5
    ahead = plan.look_ahead((1.0, 0.0), 0.25)
    assert plan.progress == 6.5
    assert ahead.point == pytest.approx(np.array([4.0, 2.75]))
    # From (1, 0) to (4, 2.5).
    assert ahead.deviation == pytest.approx(math.hypot(3.0, 2.5))


def test_loop_of_the_path_is_not_skipped() -> None:
    # There and back beside itself: 5 m out, 0.4 m across, 5 m back.
    path = np.array([[0.0, 0.0], [5.0, 0.0], [5.0, 0.4], [0.0, 0.4]])
    plan = GlobalPlan(open_costmap(), path)
    # Nearer to the way back, but that is 9.4 m of path away.
    ahead = plan.look_ahead((1.0, 0.35), 2.0)
    assert plan.progress == pytest.approx(1.0)
    assert ahead.point == pytest.approx(np.array([3.0, 0.0]))


def test_projection_is_the_nearest_point_of_the_window() -> None:
    rng = np.random.default_rng(0)
    for _ in range(200):
        path = rng.uniform(-4.0, 10.0, (rng.integers(2, 8), 2))
        plan = GlobalPlan(open_costmap(), path)
        before = plan.progress = rng.uniform(0.0, plan.length)
        position, distance = rng.uniform(-4.0, 10.0, 2), rng.uniform(0.1, 6.0)
        ahead = plan.look_ahead(position, distance)
        # The obvious way: walk along the path in steps of 2 mm.
        pieces = np.linalg.norm(np.diff(path, axis=0), axis=1)
        along = np.concatenate([[0.0], np.cumsum(pieces)])
        places = np.arange(before, min(before + distance, plan.length) + 1e-3, 2e-3)
        points = np.stack([np.interp(places, along, path[:, k]) for k in (0, 1)], axis=1)
        gaps = np.linalg.norm(points - position, axis=1)
        assert ahead.deviation == pytest.approx(gaps.min(), abs=2e-3)
        assert before <= plan.progress <= before + distance + 1e-9


def corner_space() -> FreeSpace:
    """Return a bend: free where y < 0.5 m or x > 3.5 m, from (0, -0.5) on."""
    y, x = np.mgrid[-0.45:4.0:0.1, 0.05:5.0:0.1]
    return FreeSpace((y < 0.5) | (x > 3.5), 0.1, (0.0, -0.5))


def test_point_is_visible() -> None:
    plan = GlobalPlan(inflate(corner_space(), RADIUS), L_PATH)
    ahead = plan.look_ahead((2.0, 0.0), 4.0)
    # To (4, y) the line passes x = 3.5 at 0.75 y, which must be below 0.5: y < 0.667. A cell on
    # the way there, and the step of a cell in which the point is sought, are 0.1 m each.
    assert ahead.point[0] == pytest.approx(4.0)
    assert 0.46 < ahead.point[1] < 0.667
    assert ahead.visible


def test_point_behind_a_wall_is_not_taken() -> None:
    plan = GlobalPlan(inflate(corner_space(), RADIUS), L_PATH)
    # Deep inside the closed cells, 0.95 m from the path: nothing is seen.
    ahead = plan.look_ahead((2.0, 1.5), 1.0)
    assert not ahead.visible
    assert np.linalg.norm(ahead.point - [plan.progress + 0.1, 0.0]) < 1e-9


@pytest.mark.parametrize("distance", [0.4, 0.7, 1.2, 1.9, 2.3])
def test_a_robot_that_sees_its_own_place_only_sees_nothing(distance: float) -> None:
    # All cells ahead are closed, and the robot's radius excuses none of them. Going back by cells
    # of 0.1 m from 1.2 m ahead ends at 2e-16 m instead of at nothing.
    free = np.ones((200, 200), dtype=np.bool_)
    free[:, 51:] = False
    costmap = inflate(FreeSpace(free, 0.1, (-5.0, -5.0)), 0.01)
    plan = GlobalPlan(costmap, np.array([[0.05, 0.05], [4.05, 0.05]]))
    ahead = plan.look_ahead((0.05, 0.05), distance)
    assert not ahead.visible
    assert ahead.point == pytest.approx(np.array([0.15, 0.05]))


def test_robot_in_the_inflation_finds_its_way_out() -> None:
    plan = GlobalPlan(inflate(corner_space(), RADIUS), L_PATH)
    # 0.15 m inside the closed cells, which is less than the radius.
    assert plan.look_ahead((2.0, 0.65), 1.0).visible


def wall_world() -> World:
    """Return a wall from the floor up to (3, 4)."""
    return World("wall", BOUNDS, segments=np.array([[3.0, -1.0, 3.0, 4.0]]))


def test_path_goes_from_start_to_goal_through_free_space() -> None:
    space = free_space(wall_world(), RADIUS)
    path = plan_path(inflate(space, RADIUS), (1.0, 1.0), (5.0, 1.0))
    assert path[0].tolist() == [1.0, 1.0]
    assert path[-1].tolist() == [5.0, 1.0]
    # A disc of 0.27 m centred on the path stays off the wall; a cell's half diagonal is 0.07 m.
    points = np.concatenate([np.linspace(a, b, 100) for a, b in pairwise(path)])
    to_wall = np.hypot(points[:, 0] - 3.0, np.maximum(points[:, 1] - 4.0, 0.0))
    assert to_wall.min() >= RADIUS - 0.071


def test_path_keeps_to_the_middle() -> None:
    # The gap over the wall is 2 m wide. The shortest path rolls over the wall's end; the plan
    # keeps away from it, since a detour of a decimetre is cheaper than a metre at four times cost.
    space = free_space(wall_world(), RADIUS)
    path = plan_path(inflate(space, RADIUS), (1.0, 1.0), (5.0, 1.0))
    over = np.interp(3.0, path[:, 0], path[:, 1])
    assert 4.5 <= over <= 5.5
    length = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
    shortest = shortest_path_length(space, (1.0, 1.0), (5.0, 1.0))
    assert shortest <= length <= 1.3 * shortest


def test_open_space_is_crossed_straight() -> None:
    assert len(plan_path(open_costmap(), (0.0, 0.0), (6.3, 4.1))) == 2


def test_inflation_by_hand() -> None:
    # One closed cell of 0.5 m in a row of cells: the first free centre is 0.5 m away.
    free = np.array([[False, True, True, True]])
    costmap = inflate(FreeSpace(free, 0.5, (0.0, 0.0)), RADIUS)
    # 4 (1 - d)^2 for d = 0.5, 1.0, 1.5 m.
    assert costmap.extra[0, 1:].tolist() == [1.0, 0.0, 0.0]


def test_goal_beside_an_obstacle_is_reached_from_the_nearest_free_cell() -> None:
    costmap = inflate(free_space(wall_world(), RADIUS), RADIUS)
    # 0.1 m from the wall: 0.17 m inside the inflation.
    path = plan_path(costmap, (1.0, 1.0), (2.9, 1.0))
    assert path[-1].tolist() == [2.9, 1.0]


BOX = World("box", BOUNDS, polygons=(rectangle(3.0, 3.0, 2.0, 2.0),))
SPLIT = World("split", BOUNDS, segments=np.array([[3.0, 0.0, 3.0, 6.0]]))


@pytest.mark.parametrize(
    ("world", "goal", "message"),
    [
        (SPLIT, (5.0, 1.0), r"goal = \(5\.00, 1\.00\): no way leads there from \(1\.00, 1\.00\)"),
        (BOX, (3.0, 3.0), r"goal = \(3\.00, 3\.00\): a robot of radius 0\.27 m does not fit"),
        (BOX, (9.0, 3.0), r"goal = \(9\.00, 3\.00\): a robot of radius 0\.27 m does not fit"),
        (BOX, (-1e9, 1e9), r"goal = .*does not fit"),
        (BOX, (np.nan, 3.0), r"goal = \[nan, 3\.0\]: must be two finite numbers"),
        (BOX, (1.0, 2.0, 3.0), r"goal = .*: must be two finite numbers"),
    ],
)
def test_goal_that_cannot_be_reached_is_refused(world: World, goal, message: str) -> None:
    costmap = inflate(free_space(world, RADIUS), RADIUS)
    with pytest.raises(InputError, match=message):
        plan_path(costmap, (1.0, 1.0), goal)
    with pytest.raises(InputError, match=r"goal|start"):
        plan_path(costmap, goal, (1.0, 1.0))
