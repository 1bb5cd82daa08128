# SPDX-License-Identifier: Apache-2.0
"""Where episodes start and end, and the ways between."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import ndimage

from pm01_nav.errors import InputError
from pm01_nav.geometry import points_in_polygon, rectangle
from pm01_nav.robot import full_circle, load_robot
from pm01_nav.sim.simulator import PlanarSimulator
from pm01_nav.task.config import TaskConfig
from pm01_nav.task.tasks import task_config
from pm01_nav.task.worlds import world_pool, world_seeds
from pm01_nav.worlds import pool as pool_module
from pm01_nav.worlds.free_space import free_space, shortest_path, shortest_path_length
from pm01_nav.worlds.pool import WorldPool, build_pool, generate_pool
from pm01_nav.worlds.suites import suites
from pm01_nav.worlds.world import OccupancyGrid, World
from tests.sim.reference import reference_clearance

RADIUS = 0.27
"""pm01's 0.17 m and the task's margin of 0.1 m."""
BOUNDS = (0.0, 0.0, 6.0, 6.0)
DIAGONAL = 0.05 * math.sqrt(2.0)
"""From the middle of a raster cell of 0.1 m to its corner [m]."""


def robot_of_few_beams():
    return task_config("static").model_copy(update={"robot_changes": {"lidar": full_circle(4)}})


def episodes(pool: WorldPool, count: int, **arguments) -> PlanarSimulator:
    """Start ``count`` episodes."""
    simulator = PlanarSimulator(robot_of_few_beams().robot_spec(), pool, count, **arguments)
    simulator.seed(np.arange(count))
    simulator.reset()
    return simulator


@pytest.fixture(scope="module")
def pool() -> WorldPool:
    return generate_pool(suites()["static"].generator, range(6), RADIUS)


def test_places_are_free(pool: WorldPool) -> None:
    robot = load_robot("pm01")
    arrays = pool.arrays
    rng = np.random.default_rng(0)
    for w, world in enumerate(pool.worlds):
        for begin, rows in ((arrays.start_begin, arrays.starts), (arrays.goal_begin, arrays.goals)):
            own = rows[begin[w] : begin[w + 1]]
            assert len(own) > 1000
            for x, y in rng.choice(own, 30):
                # The footprint of 0.17 m keeps the margin of 0.1 m.
                assert reference_clearance(world, robot, (x, y, 0.0)) >= 0.1 - 1e-9


def test_no_place_is_inside_a_box(pool: WorldPool) -> None:
    # A box of 2 m: from its middle each edge is a metre away, so clearance alone would not tell.
    box = rectangle(3.0, 3.0, 2.0, 2.0)
    arrays = build_pool([World("box", BOUNDS, polygons=(box,))], RADIUS).arrays
    for rows in (arrays.starts, arrays.goals):
        assert (np.abs(rows - 3.0).max(axis=1) > 1.0).all()


def test_jittered_episodes_are_free_and_spread(pool: WorldPool) -> None:
    simulator = episodes(pool, 600)
    robot = load_robot("pm01")
    state = simulator.state
    # A start is drawn from the whole cell around a free centre: of the margin of 0.1 m at least
    # 0.1 - 0.0707 is left.
    assert (state.clearance >= 0.1 - DIAGONAL - 1e-9).all()
    for i in range(0, 600, 10):
        pose = (*state.goal[i], 0.0)
        left = reference_clearance(pool.worlds[state.world[i]], robot, pose)
        assert left >= 0.1 - DIAGONAL - 1e-9
    within_cell = state.pose[:, 0] % 0.1
    # 600 draws of U(0, 0.1): mean 0.05 +- 4 x 0.1 / sqrt(12 x 600); deviation 0.0289.
    assert within_cell.mean() == pytest.approx(0.05, abs=0.0048)
    assert within_cell.std() == pytest.approx(0.0289, rel=0.1)


def test_starts_keep_the_margin(pool: WorldPool) -> None:
    assert (episodes(pool, 2000).state.clearance >= 0.1 - 1e-9).all()


def test_no_margin_still_starts_free() -> None:
    config = robot_of_few_beams().model_copy(update={"margin": 0.0})
    assert (episodes(world_pool(config, "train", 6), 2000).state.clearance > 0.0).all()


def test_starts_and_goals_are_connected(pool: WorldPool) -> None:
    simulator = episodes(pool, 40)
    state = simulator.state
    for i in range(40):
        space = pool.free_space(state.world[i])
        assert math.isfinite(shortest_path_length(space, state.pose[i, :2], state.goal[i]))
    # Straight from the definition: one region, counted with 4 neighbours, holds them all.
    for w in range(len(pool)):
        space = pool.free_space(w)
        labels, _ = ndimage.label(space.free)
        own = pool.arrays.starts[pool.arrays.start_begin[w] : pool.arrays.start_begin[w + 1]]
        column, row = np.floor((own - space.origin) / space.resolution + 1e-9).astype(int).T
        assert set(labels[row, column].tolist()) == {labels[row[0], column[0]]}


@pytest.mark.parametrize("resolution", [0.05, 0.1, 0.25])
def test_places_on_a_grid_are_free_for_the_footprint(resolution: float) -> None:
    assert_grid_places_are_free(resolution)


def test_places_on_a_coarse_grid_are_free_for_the_footprint() -> None:
    assert_grid_places_are_free(0.5)


def assert_grid_places_are_free(resolution: float) -> None:
    """Every place on a random grid is free for pm01's footprint."""
    count = round(6.0 / resolution)
    # About 18 solid cells, whatever their size.
    cells = np.random.default_rng(3).random((count, count)) < 18 / count**2
    world = World("grid", BOUNDS, grid=OccupancyGrid(cells.astype(np.uint8), resolution, (0, 0)))
    pool = build_pool([world], RADIUS)
    robot = load_robot("pm01")
    clearances = [reference_clearance(world, robot, (x, y, 0.0)) for x, y in pool.arrays.starts]
    assert min(clearances) > 0.0


def room_map(around: int) -> World:
    """A map of a room of 6 m x 6 m with a pillar, and so many cells of nothing around it."""
    cells = np.zeros((120, 120), dtype=np.uint8)
    cells[50:60, 50:60] = 1
    cells = np.pad(cells, around, constant_values=1)
    corner = -0.05 * around
    grid = OccupancyGrid(cells, 0.05, (corner, corner), closed=True)
    return World("room", grid.extent(), grid=grid)


def test_nothing_around_a_map_costs_nothing() -> None:
    small, large = (build_pool([room_map(around)], RADIUS) for around in (2, 400))
    # 6 m of free space and a ring of one cell.
    assert large.arrays.grid_cells.size == small.arrays.grid_cells.size == 122**2
    assert large.arrays.grid_frame == pytest.approx(small.arrays.grid_frame, abs=1e-12)
    assert large.free_space(0).free.size == small.free_space(0).free.size == 60**2
    assert large.free_space(0) is large.free_space(0)
    assert np.sort(large.arrays.starts, axis=0) == pytest.approx(
        np.sort(small.arrays.starts, axis=0), abs=1e-9
    )


def test_rasters_that_are_kept_are_not_too_many(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pool_module, "MAX_SPACES", 2)
    pool = build_pool([World(str(k), BOUNDS) for k in range(3)], RADIUS)
    first = pool.free_space(0)
    assert pool.free_space(1) is pool.free_space(1)
    assert pool.free_space(0) is first
    pool.free_space(2)
    assert pool.free_space(0) is not first


@pytest.mark.parametrize("yaw", [0.0, 0.3, 3.14])
@pytest.mark.parametrize("closed", [False, True])
def test_places_in_a_turned_map_are_free(yaw: float, closed: bool) -> None:
    cells = np.zeros((60, 80), dtype=np.uint8)
    cells[10:20, 30:35] = cells[40:44, 50:80] = 1
    grid = OccupancyGrid(cells, 0.1, (2.0, -1.0), yaw, closed)
    world = World("map", grid.extent(), grid=grid)
    pool = build_pool([world], RADIUS)
    robot = load_robot("pm01")
    rng = np.random.default_rng(0)
    for x, y in rng.choice(np.concatenate([pool.arrays.starts, pool.arrays.goals]), 60):
        assert reference_clearance(world, robot, (x, y, 0.0)) >= 0.1 - 1e-9


@pytest.mark.parametrize("limits", [(2.0, math.inf), (0.0, 5.0), (1.0, 4.0)])
def test_goal_distance_is_respected(pool: WorldPool, limits: tuple[float, float]) -> None:
    distance = episodes(pool, 500, goal_distance=limits).state.goal_polar[:, 0]
    # The limits hold for the middle of the goal's cell; the goal itself may be 7.1 cm off.
    assert (distance >= limits[0] - DIAGONAL).all()
    assert (distance <= limits[1] + DIAGONAL).all()


def test_goal_distance_is_respected_with_its_jitter(pool: WorldPool) -> None:
    distance = episodes(pool, 2000, goal_distance=(2.0, 2.5)).state.goal_polar[:, 0]
    # From a corner behind obstacles nothing may lie at that distance; then the nearest is taken.
    assert ((distance >= 2.0) & (distance <= 2.5)).mean() > 0.998
    assert ((distance >= 1.8) & (distance <= 2.7)).all()


def test_near_goals_are_respected(pool: WorldPool) -> None:
    distance = episodes(pool, 500, goal_distance=(0.0, 1.5)).state.goal_polar[:, 0]
    assert (distance <= 1.5 + DIAGONAL).all()


def test_fixed_start_and_goal() -> None:
    world = World("fixed", BOUNDS, start=(1.0, 2.0, 0.5), goal_area=(4.0, 5.0, 4.0, 5.0))
    state = episodes(build_pool([world], RADIUS), 20).state
    assert (state.pose == [1.0, 2.0, 0.5]).all()
    assert (state.goal == [4.0, 5.0]).all()


def test_goal_area_is_filled_and_kept() -> None:
    world = World("area", BOUNDS, start=(1.0, 1.0, 0.0), goal_area=(3.0, 2.0, 5.0, 3.0))
    goals = episodes(build_pool([world], RADIUS), 1000).state.goal
    assert ((goals >= [3.0, 2.0]) & (goals <= [5.0, 3.0])).all()
    # 1000 uniform draws miss a margin of 5 % of each side with probability 0.95^1000 < 1e-22.
    assert (goals.min(axis=0) < [3.1, 2.05]).all()
    assert (goals.max(axis=0) > [4.9, 2.95]).all()


def test_start_area_is_filled_and_kept() -> None:
    world = World("area", BOUNDS, start_area=(1.0, 1.0, 2.0, 3.0), goal_area=(4.0, 4.0, 5.0, 5.0))
    simulator = episodes(build_pool([world], RADIUS), 1000)
    starts = simulator.state.pose[:, :2]
    assert ((starts >= [1.0, 1.0]) & (starts <= [2.0, 3.0])).all()
    # As above: 1000 uniform draws reach all edges to 5 % of the side.
    assert (starts.min(axis=0) < [1.05, 1.1]).all()
    assert (starts.max(axis=0) > [1.95, 2.9]).all()
    assert (np.abs(simulator.state.pose[:, 2]).max()) > 3.0
    assert ((simulator.state.goal >= [4.0, 4.0]) & (simulator.state.goal <= [5.0, 5.0])).all()


def test_start_area_decides_which_region_counts() -> None:
    # The wall at x = 2 leaves the smaller part to the left; most of the area lies there.
    wall = np.array([[2.0, 0.0, 2.0, 6.0]])
    world = World("split", BOUNDS, segments=wall, start_area=(0.5, 1.0, 2.8, 3.0))
    arrays = build_pool([world], RADIUS).arrays
    assert (arrays.starts[:, 0] < 2.0).all()
    assert (arrays.goals[:, 0] < 2.0).all()
    # Goals are anywhere in that part.
    assert arrays.goals[:, 1].max() > 5.5


def test_start_wins_over_start_area() -> None:
    world = World("both", BOUNDS, start=(1.0, 1.0, 0.5), start_area=(3.0, 3.0, 4.0, 4.0))
    assert build_pool([world], RADIUS).arrays.starts.tolist() == [[1.0, 1.0]]


def test_headings_cover_the_circle(pool: WorldPool) -> None:
    yaw = episodes(pool, 800).state.pose[:, 2]
    assert ((yaw >= -np.pi) & (yaw < np.pi)).all()
    # U(-pi, pi) has deviation pi / sqrt(3) = 1.814; the mean's is 1.814 / sqrt(800) = 0.064.
    assert yaw.mean() == pytest.approx(0.0, abs=4 * 0.064)
    counts, _ = np.histogram(yaw, bins=8, range=(-np.pi, np.pi))
    assert (np.abs(counts - 100) < 4 * np.sqrt(800 / 8 * 7 / 8)).all()


def test_worlds_are_drawn_evenly(pool: WorldPool) -> None:
    counts = np.bincount(episodes(pool, 1200).state.world, minlength=6)
    # Binomial: 200 +- sqrt(1200 x 1/6 x 5/6) = 12.9.
    assert (np.abs(counts - 200) < 4 * 12.9).all()


WALL = np.array([[3.0, 0.0, 3.0, 6.0]])


@pytest.mark.parametrize(
    ("world", "message"),
    [
        (World("full", BOUNDS, discs=np.array([[3.0, 3.0, 9.0]])), "no free space"),
        (
            World("split", BOUNDS, segments=WALL, start=(1, 3, 0), goal_area=(5.0, 3.0, 5.0, 3.0)),
            "not connected",
        ),
        (
            World("split", BOUNDS, segments=WALL, start=(1, 3, 0), goal_area=(4, 1, 5, 5)),
            "no goal in its goal area",
        ),
        (World("start", BOUNDS, start=(9, 3, 0), goal_area=(5, 3, 5, 3)), "not in free space"),
        (World("goal", BOUNDS, start=(1, 3, 0), goal_area=(9, 3, 9, 3)), "not connected"),
        (World("goal", BOUNDS, start=(1, 3, 0), goal_area=(7, 3, 9, 5)), "no goal in its goal"),
        (World("start", BOUNDS, start_area=(7, 3, 9, 5)), "no start in its start area"),
        (
            World("split", BOUNDS, segments=WALL, start_area=(1, 1, 2, 2), goal_area=(4, 1, 5, 5)),
            "no goal in its goal area",
        ),
    ],
)
def test_unusable_world_is_refused(world: World, message: str) -> None:
    with pytest.raises(InputError, match=message):
        build_pool([world], RADIUS)


@pytest.mark.parametrize(
    "world",
    [
        World("outside", BOUNDS, start=(9, 3, 0)),
        World("inside", BOUNDS, discs=np.array([[1.0, 3.0, 0.8]]), start=(1, 3, 0)),
    ],
    ids=lambda world: world.name,
)
def test_unusable_start_without_a_goal_area_is_refused(world: World) -> None:
    with pytest.raises(InputError, match="start"):
        build_pool([world], RADIUS)


def test_generator_that_never_works_is_given_up() -> None:
    def hopeless(rng: np.random.Generator) -> World:
        return World("hopeless", (0.0, 0.0, 1.0, 1.0), discs=np.array([[0.5, 0.5, 2.0]]))

    with pytest.raises(InputError, match="world seed 7"):
        generate_pool(hopeless, [7], RADIUS)


def test_train_and_held_out_worlds_differ() -> None:
    seeds = [set(world_seeds(s, 65_536, run)) for s in ("train", "held_out") for run in (0, 1, 2)]
    assert sum(len(s) for s in seeds) == len(set().union(*seeds)) == 6 * 65_536


def test_pools_of_the_splits_differ() -> None:
    config: TaskConfig = task_config("static")
    train, held_out = (world_pool(config, split, 3) for split in ("train", "held_out"))
    first = {tuple(w.discs.ravel().tolist()) for w in train.worlds}
    second = {tuple(w.discs.ravel().tolist()) for w in held_out.worlds}
    assert not first & second


def test_unknown_suite_and_missing_file_are_refused() -> None:
    config = task_config("static")
    with pytest.raises(InputError, match="suite = 'moon': unknown; allowed: article"):
        world_pool(config.model_copy(update={"suite": "moon"}), "train", 1)
    with pytest.raises(InputError, match="--map PATH"):
        world_pool(task_config("map"), "train", 1)


def test_straight_path() -> None:
    space = free_space(World("open", BOUNDS), RADIUS)
    # 3-4-5.
    assert shortest_path_length(space, (1.0, 1.0), (4.0, 5.0)) == pytest.approx(5.0, abs=1e-9)
    assert shortest_path_length(space, (1.0, 1.0), (1.0, 1.0)) == 0.0


def test_path_around_a_wall() -> None:
    # The wall stands from the floor up to (3, 4). A disc of 0.27 m rolls from (1, 1) to (5, 1)
    # over its end: a tangent to the circle of 0.27 m around (3, 4), an arc, and a tangent again.
    world = World("wall", BOUNDS, segments=np.array([[3.0, -1.0, 3.0, 4.0]]))
    across, up = 2.0, 3.0
    away = math.hypot(across, up)
    tangent = math.sqrt(away**2 - RADIUS**2)
    # Seen from the wall's end, the start lies atan(3 / 2) below the horizontal and the point of
    # tangency acos(r / d) from that direction; the arc is what is left of half a turn over the top.
    arc = math.pi + 2 * math.atan(up / across) - 2 * math.acos(RADIUS / away)
    shortest = 2 * tangent + RADIUS * arc
    # 2 x 3.5955 + 0.27 x 2.1156.
    assert shortest == pytest.approx(7.762, abs=1e-3)
    found = shortest_path_length(free_space(world, RADIUS), (1.0, 1.0), (5.0, 1.0))
    # Cells are free or not as their centres are: a path may cut the corner by a cell's half
    # diagonal, which saves less than 1 %; 8 % is the most that 8 directions can cost.
    assert 0.99 * shortest <= found <= 1.08 * shortest


def test_path_has_its_ends_and_its_length() -> None:
    world = World("wall", BOUNDS, segments=np.array([[3.0, -1.0, 3.0, 4.0]]))
    space = free_space(world, RADIUS)
    path = shortest_path(space, (1.02, 1.03), (5.01, 1.04))
    assert path[0].tolist() == [1.02, 1.03]
    assert path[-1].tolist() == [5.01, 1.04]
    length = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
    assert length == shortest_path_length(space, (1.02, 1.03), (5.01, 1.04))
    assert shortest_path(space, (1.0, 1.0), (9.0, 1.0)).shape == (0, 2)


def test_cells_inside_polygons_are_not_free() -> None:
    rng = np.random.default_rng(0)
    for _ in range(30):
        # Star-shaped (no gap of half a turn), and partly outside the bounds.
        count = rng.integers(3, 9)
        angles = (2.0 * np.arange(count) + rng.uniform(0.0, 1.0, count)) * np.pi / count
        around = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        polygon = rng.uniform(0.0, 6.0, 2) + rng.uniform(0.5, 3.0, (len(angles), 1)) * around
        space = free_space(World("polygon", BOUNDS, polygons=(polygon,)), 1e-9)
        rows, columns = np.indices(space.free.shape)
        inside = points_in_polygon(space.centre(rows.ravel(), columns.ravel()), polygon)
        assert (space.free.ravel() == ~inside).all()


def test_no_path() -> None:
    space = free_space(World("split", BOUNDS, segments=WALL), RADIUS)
    assert shortest_path_length(space, (1.0, 1.0), (5.0, 1.0)) == math.inf
    assert shortest_path_length(space, (1.0, 1.0), (9.0, 1.0)) == math.inf


@pytest.mark.parametrize(
    "arguments",
    [
        {"discs": np.array([[1.0, 1.0, 0.0]])},
        {"discs": np.array([[np.nan, 1.0, 0.5]])},
        {"segments": np.array([[0.0, 0.0, np.inf, 1.0]])},
        {"polygons": (np.array([[0.0, 0.0], [1.0, 0.0]]),)},
        {"bounds": (1.0, 0.0, 1.0, 2.0)},
        {"bounds": (0.0, 0.0, np.inf, 2.0)},
    ],
)
def test_impossible_world_is_refused(arguments) -> None:
    with pytest.raises(InputError, match="world bad: "):
        World("bad", **({"bounds": BOUNDS} | arguments))
