# SPDX-License-Identifier: Apache-2.0
"""The lidar: known rooms, the slow twin, and what happens at the edges of range and obstacle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from pm01_nav.geometry import points_in_polygon, rectangle
from pm01_nav.robot import full_circle
from pm01_nav.sim.lidar import ANGLE_ERROR, direction, nearest_in_sectors
from pm01_nav.sim.state import lidar_params
from pm01_nav.task.scans import pool_sectors
from pm01_nav.worlds.world import OccupancyGrid, World
from tests.sim.reference import reference_scan

BOUNDS = (-5.0, -5.0, 5.0, 5.0)
TOLERANCE = 1e-5
"""Ranges are float32, whose spacing at 30 m is 2e-6 m; the rest is left for the arithmetic."""
FRONT = {"angle_min": -2.35619, "angle_max": 2.35619}
BEAMS = [1, 20, 37, 360, 720]


def square_room(half: float) -> World:
    """Return four walls at x, y = +-half."""
    a = half
    walls = [(-a, -a, a, -a), (a, -a, a, a), (a, a, -a, a), (-a, a, -a, -a)]
    return World("square", BOUNDS, segments=np.array(walls))


def random_world(rng: np.random.Generator, index: int) -> World:
    """Draw discs, walls and boxes; every second world has a grid as well, half of them turned."""
    boxes = tuple(
        rectangle(*rng.uniform(-4, 4, 2), *rng.uniform(0.1, 1.5, 2), rng.uniform(-np.pi, np.pi))
        for _ in range(rng.integers(0, 4))
    )
    ends = rng.uniform(-5, 5, (rng.integers(0, 6), 4))
    discs = np.column_stack([rng.uniform(-4, 4, (8, 2)), rng.uniform(0.05, 0.8, 8)])
    world = World(
        "random", BOUNDS, discs=discs[: rng.integers(0, 9)], polygons=boxes, segments=ends
    )
    if index % 2:
        return world
    # From sparse to dense, so that a walk along a ray both leaps over empty space and steps.
    cells = (rng.random((18, 25)) < rng.choice([0.01, 0.05, 0.2])).astype(np.uint8)
    origin = float(rng.uniform(-4, 1)), float(rng.uniform(-4, 1))
    yaw = float(rng.uniform(-np.pi, np.pi)) if index % 4 else 0.0
    grid = OccupancyGrid(cells, float(rng.choice([0.05, 0.15, 0.3])), origin, yaw)
    return replace(world, grid=grid)


@pytest.fixture(scope="module")
def worlds() -> list[World]:
    rng = np.random.default_rng(7)
    return [random_world(rng, index) for index in range(36)]


@pytest.mark.parametrize("num_beams", BEAMS)
def test_square_room(make_robot, simulate, num_beams: int) -> None:
    robot = make_robot(lidar=full_circle(num_beams) | {"range_min": 0.0, "range_max": 10.0})
    yaw = 0.3
    sim = simulate(robot, square_room(2.0), [[0.5, -0.25, yaw]])
    # The walls are 1.5 m ahead in x, 2.5 m behind, 2.25 m above and 1.75 m below; along a
    # direction (c, s) each is met at its distance over c or s, and the nearest counts.
    c, s = np.cos(yaw + robot.lidar.angles), np.sin(yaw + robot.lidar.angles)
    to_x = np.where(c > 0, 1.5, 2.5) / np.maximum(np.abs(c), 1e-12)
    to_y = np.where(s > 0, 2.25, 1.75) / np.maximum(np.abs(s), 1e-12)
    assert sim.scan[0] == pytest.approx(np.minimum(to_x, to_y), abs=TOLERANCE)


@pytest.mark.parametrize("num_beams", [20, 720])
def test_disc(make_robot, simulate, num_beams: int) -> None:
    robot = make_robot(lidar=full_circle(num_beams))
    world = World("disc", BOUNDS, discs=np.array([[2.0, 0.0, 0.5]]))
    sim = simulate(robot, world, [[0.0, 0.0, 0.0]])
    # Law of cosines: 0.25 = t^2 + 4 - 4 t cos(a), so t = 2 cos(a) - sqrt(0.25 - 4 sin(a)^2), for
    # |sin(a)| < 0.25 in front. No beam is at that limit: asin(0.25) = 14.4775 degrees.
    a = robot.lidar.angles
    under = 0.25 - 4 * np.sin(a) ** 2
    seen = (under >= 0) & (np.cos(a) > 0)
    expected = np.where(seen, 2 * np.cos(a) - np.sqrt(np.maximum(under, 0)), np.inf)
    assert seen.sum() >= 1
    assert sim.scan[0] == pytest.approx(expected, abs=TOLERANCE)


def test_disc_room_seen_from_its_middle(make_robot, simulate) -> None:
    robot = make_robot(lidar=full_circle(360) | {"range_max": 10.0})
    # A ring of 64 walls that touch a circle of radius 2 m: from the middle every range lies
    # between 2 and 2 / cos(pi / 64) = 2.00241.
    angles = 2 * np.pi * np.arange(65) / 64
    ring = 2 / np.cos(np.pi / 64) * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    world = World("ring", BOUNDS, segments=np.concatenate([ring[:-1], ring[1:]], axis=1))
    sim = simulate(robot, world, [[0.0, 0.0, 0.1]])
    assert sim.scan.min() >= 2.0 - TOLERANCE
    assert sim.scan.max() <= 2.00241 + TOLERANCE


def test_corridor(make_robot, simulate) -> None:
    robot = make_robot(lidar=full_circle(360))
    walls = np.array([[-50.0, 1.0, 50.0, 1.0], [-50.0, -1.0, 50.0, -1.0]])
    sim = simulate(robot, World("corridor", BOUNDS, segments=walls), [[0.0, 0.0, 0.0]])
    # A wall 1 m to the side is met at 1 / |sin a|; pm01 sees 3.5 m, so not below 16.6 degrees.
    s = np.abs(np.sin(robot.lidar.angles))
    expected = np.where(s > 1 / 3.5, 1 / np.maximum(s, 1e-9), np.inf)
    assert sim.scan[0] == pytest.approx(expected, abs=TOLERANCE)


def grazes(world: World, robot, pose: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Tell which beams change by more than the tolerance when turned by 2e-7 rad."""
    x, y, yaw = pose
    right, ahead, left = (reference_scan(world, robot, (x, y, yaw + d)) for d in (-2e-7, 0, 2e-7))
    steady = [np.isclose(ahead, turned, atol=TOLERANCE, rtol=0) for turned in (right, left)]
    return ~(steady[0] & steady[1])


def free_pose(world: World, robot, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return a pose from which the lidar looks around outside of all polygons."""
    while True:
        x, y, yaw = rng.uniform([-6, -6, -np.pi], [6, 6, np.pi])
        cos, sin = np.cos(yaw), np.sin(yaw)
        lidar = robot.lidar
        place = np.array([[x + cos * lidar.x - sin * lidar.y, y + sin * lidar.x + cos * lidar.y]])
        if not any(points_in_polygon(place, polygon)[0] for polygon in world.polygons):
            return np.array([x, y, yaw])


@pytest.mark.parametrize("view", ["circle", "front"])
@pytest.mark.parametrize("num_beams", BEAMS)
def test_fast_equals_slow(
    make_robot, simulate, worlds: list[World], num_beams: int, view: str
) -> None:
    # 36 worlds for each of 10 lidars: 360 scans, about 82 000 ranges.
    rng = np.random.default_rng([num_beams, view == "front"])
    lidar = full_circle(num_beams) if view == "circle" else FRONT | {"num_beams": num_beams}
    mount = {"x": 0.1, "y": -0.07, "yaw": float(rng.uniform(-3, 3))}
    range_max = float(rng.uniform(2, 12))
    robot = make_robot(lidar=lidar | mount | {"range_min": 0.15, "range_max": range_max})
    poses = np.array([free_pose(world, robot, rng) for world in worlds])
    sim = simulate(robot, worlds, poses)
    grazing = 0
    for world, pose, fast in zip(worlds, poses, sim.scan, strict=True):
        slow = reference_scan(world, robot, pose)
        # A return within the tolerance of a range limit may fall on either side of it.
        for limit, beyond in ((range_max, np.inf), (0.15, -np.inf)):
            at_limit = (np.abs(slow - limit) < TOLERANCE) | (np.abs(fast - limit) < TOLERANCE)
            slow = np.where(at_limit & (fast == beyond), beyond, slow)
        wrong = ~np.isclose(fast, slow, atol=TOLERANCE, rtol=0)
        if wrong.any():
            assert not (wrong & ~grazes(world, robot, pose)).any()
            grazing += int(wrong.sum())
    # A beam within 2e-7 rad of an edge is met about once in a million; one may chance to be here.
    assert grazing <= 1


def test_return_at_range_max_counts_and_beyond_is_none(make_robot, simulate) -> None:
    # One beam ahead; 3.5 and 4.0 are exact in float32, so "exactly at range_max" has a meaning.
    robot = make_robot(lidar={"num_beams": 1, "angle_min": 0.0, "angle_max": 0.0})
    wall = np.array([[3.5, -1.0, 3.5, 1.0]])
    world = World("wall", BOUNDS, segments=wall)
    poses = [[0.0, 0.0, 0.0], [-1e-3, 0.0, 0.0], [1e-3, 0.0, 0.0]]
    assert simulate(robot, world, poses).scan[:, 0] == pytest.approx([3.5, np.inf, 3.499])


def test_disc_at_range_max_counts(make_robot, simulate) -> None:
    robot = make_robot(lidar={"num_beams": 1, "angle_min": 0.0, "angle_max": 0.0})
    world = World("disc", BOUNDS, discs=np.array([[4.0, 0.0, 0.5]]))
    poses = [[0.0, 0.0, 0.0], [-1e-3, 0.0, 0.0]]
    assert simulate(robot, world, poses).scan[:, 0].tolist() == [3.5, np.inf]


def test_below_range_min_is_too_close(make_robot, simulate) -> None:
    robot = make_robot(lidar={"num_beams": 1, "angle_min": 0.0, "angle_max": 0.0})
    world = World("wall", BOUNDS, segments=np.array([[1.0, -1.0, 1.0, 1.0]]))
    # pm01's lidar sees from 0.12 m on; the wall is 0.119, then 0.121 m ahead.
    poses = [[0.881, 0.0, 0.0], [0.879, 0.0, 0.0]]
    assert simulate(robot, world, poses).scan[:, 0] == pytest.approx([-np.inf, 0.121])


@pytest.mark.parametrize("num_beams", [20, 360])
def test_inside_a_disc_everything_is_too_close(make_robot, simulate, num_beams: int) -> None:
    robot = make_robot(lidar=full_circle(num_beams))
    world = World("disc", BOUNDS, discs=np.array([[1.0, 1.0, 0.5]]))
    assert (simulate(robot, world, [[1.2, 0.9, 0.4]]).scan == -np.inf).all()


def test_grid_from_outside_and_inside(make_robot, simulate) -> None:
    lidar = {"num_beams": 4, "angle_min": -np.pi, "angle_max": np.pi / 2, "range_max": 30.0}
    robot = make_robot(lidar=lidar)
    # 4 x 3 cells of 0.5 m from (1, 1) to (3, 2.5); only the cell x [2, 2.5], y [1.5, 2] is solid.
    cells = np.zeros((3, 4), dtype=np.uint8)
    cells[1, 2] = 1
    world = World("grid", BOUNDS, grid=OccupancyGrid(cells, 0.5, (1.0, 1.0)))
    poses = [
        [-4.0, 1.75, 0.0],  # Outside on the left: 6 m ahead.
        [4.0, 1.75, np.pi],  # Outside on the right: 1.5 m ahead.
        [2.25, -3.0, np.pi / 2],  # Outside below: 4.5 m ahead.
        [-4.0, 4.0, 0.0],  # Outside, every beam misses the grid.
        [1.25, 1.75, 0.0],  # Inside, in a free cell: 0.75 m ahead.
        [2.25, 1.75, 0.0],  # Inside the solid cell.
    ]
    # The beams look back, right, ahead and left.
    none = np.inf
    expected = [
        [none, none, 6.0, none],
        [none, none, 1.5, none],
        [none, none, 4.5, none],
        [none, none, none, none],
        [none, none, 0.75, none],
        [-none, -none, -none, -none],
    ]
    scan = simulate(robot, world, poses).scan
    assert scan == pytest.approx(np.array(expected), abs=TOLERANCE)


def test_turned_grid(make_robot, simulate) -> None:
    lidar = {"num_beams": 4, "angle_min": -np.pi, "angle_max": np.pi / 2, "range_max": 30.0}
    # A cell of 1 m, 2 to 3 m along a grid that is turned left by 30 degrees about (1, 1). Seen from
    # its origin along its rows the cell is 2 m away. From (1, 1) along x: the cell's lower right
    # corner is 3 m away in the direction of 30 degrees, all others further left; nothing is hit.
    cells = np.array([[0, 0, 1]], dtype=np.uint8)
    world = World("grid", BOUNDS, grid=OccupancyGrid(cells, 1.0, (1.0, 1.0), np.pi / 6))
    # Half a metre to the left of the origin, so that the beam runs along the middle of the row.
    across = 1.0 + 0.5 * np.array([-np.sin(np.pi / 6), np.cos(np.pi / 6)])
    poses = [[*across, np.pi / 6], [1.0, 1.0, 0.0]]
    scan = simulate(make_robot(lidar=lidar), world, poses).scan
    none = np.inf
    expected = np.array([[none, none, 2.0, none], [none, none, none, none]])
    assert scan == pytest.approx(expected, abs=TOLERANCE)


@pytest.mark.parametrize("yaw", [0.0, 0.7])
def test_beyond_a_closed_grid_all_is_solid(make_robot, simulate, yaw: float) -> None:
    # 100 x 80 cells, of which 6 x 4 are free, but for one: only these and a ring are kept.
    cells = np.ones((80, 100), dtype=np.uint8)
    cells[40:44, 30:36] = 0
    cells[41, 33] = 1
    edge = np.zeros((4, 6), dtype=np.uint8)
    edge[1, 3] = 1
    rng = np.random.default_rng(0)
    for grid in (
        OccupancyGrid(cells, 0.5, (-5.0, -6.0), yaw, closed=True),
        OccupancyGrid(edge, 0.5, (1.0, 2.0), yaw, closed=True),
    ):
        world = World("map", (-60.0, -60.0, 60.0, 60.0), grid=grid)
        assert grid.known.occupied.shape == (6, 8)
        first = np.argwhere(grid.occupied == 0)[0][::-1]
        # In the lower two columns, which hold no solid cell.
        places = grid.to_world(first + rng.uniform(0.0, [2.0, 4.0], (20, 2)))
        poses = np.column_stack([places, rng.uniform(-np.pi, np.pi, 20)])
        robot = make_robot(lidar=full_circle(90))
        scan = simulate(robot, world, poses).scan
        twin = [reference_scan(world, robot, pose) for pose in poses]
        assert scan == pytest.approx(np.array(twin), abs=TOLERANCE)
        assert np.isfinite(scan[scan > 0.0]).all()


@pytest.mark.parametrize("num_beams", [20, 360])
def test_no_beam_slips_through_a_corner(make_robot, simulate, num_beams: int) -> None:
    robot = make_robot(lidar=full_circle(num_beams) | {"range_max": 30.0})
    rng = np.random.default_rng(3)
    places = rng.uniform(-1.5, 1.5, (200, 2))
    # Beam 0 looks backwards; the heading turns it exactly onto a corner of the room.
    corners = np.array([[2.0, 2.0], [-2.0, 2.0], [-2.0, -2.0], [2.0, -2.0]])[np.arange(200) % 4]
    toward = corners - places
    yaw = np.arctan2(toward[:, 1], toward[:, 0]) + np.pi
    sim = simulate(robot, square_room(2.0), np.column_stack([places, yaw]))
    # Float64 places the beam within 1e-15 rad of the corner, on either side or on it.
    assert sim.scan[:, 0] == pytest.approx(np.linalg.norm(toward, axis=1), abs=TOLERANCE)
    assert np.isfinite(sim.scan).all()


def test_noise_has_the_declared_deviation(make_robot, simulate) -> None:
    lidar = full_circle(720) | {"range_max": 10.0}
    noisy = make_robot(lidar=lidar | {"noise_std": 0.05})
    exact = make_robot(lidar=lidar | {"noise_std": 0.0})
    poses = np.tile([0.2, 0.1, 0.0], (20, 1))
    truth = simulate(exact, square_room(2.0), poses).scan
    errors = (simulate(noisy, square_room(2.0), poses).scan - truth).astype(np.float64)
    # 14 400 draws: 4 sigma of the mean are 4 x 0.05 / 120 = 0.0017, of the deviation
    # 4 x 0.05 / sqrt(2 x 14 400) = 0.0012.
    assert errors.mean() == pytest.approx(0.0, abs=0.0017)
    assert errors.std() == pytest.approx(0.05, abs=0.0012)
    # No two robots, and no two scans of one robot, share their errors.
    assert abs(np.corrcoef(errors[0], errors[1])[0, 1]) < 4 / np.sqrt(720)
    # Without noise, equal poses see the same to the last bit.
    assert (truth == truth[0]).all()


def test_noise_does_not_make_returns_out_of_nothing(make_robot, simulate) -> None:
    robot = make_robot(lidar=full_circle(360) | {"noise_std": 0.5})
    empty = World("empty", BOUNDS)
    assert (simulate(robot, empty, [[0.0, 0.0, 0.0]]).scan == np.inf).all()


def test_direction_is_as_good_as_it_says() -> None:
    angles = np.linspace(-np.pi, np.pi, 20_001)[1:-1]
    for length in (1e-3, 1.0, 50.0):
        found = [direction(length * np.cos(a), length * np.sin(a)) for a in angles]
        assert np.abs(np.array(found) - angles).max() <= ANGLE_ERROR


def test_nearest_in_sectors(make_robot) -> None:
    lidar = lidar_params(make_robot(lidar={"num_beams": 6, "range_min": 0.5, "range_max": 8.0}))
    ranges = np.array([[9, 5, np.inf, 8.1, 8, 6], [1, 2, 3, 4, 0.4, 5]], dtype=np.float32)
    nearest = np.zeros((2, 3), dtype=np.float32)
    for i in range(2):
        nearest_in_sectors(lidar, ranges, nearest, i)
    assert nearest.tolist() == [[5.0, np.inf, 6.0], [1.0, 3.0, -np.inf]]


@pytest.mark.parametrize(("beams", "sectors"), [(541, 36), (811, 72), (1081, 36), (37, 36), (7, 5)])
def test_nearest_in_uneven_sectors_is_what_a_policy_pools(
    make_robot, beams: int, sectors: int
) -> None:
    lidar = lidar_params(make_robot(lidar=full_circle(beams) | {"range_max": 8.0}))
    ranges = np.random.default_rng(beams).uniform(1.0, 9.0, (1, beams)).astype(np.float32)
    nearest = np.zeros((1, sectors), dtype=np.float32)
    nearest_in_sectors(lidar, ranges, nearest, 0)
    # Beam b lies in the last sector s that begins at or before it: s beams / sectors <= b.
    expected = [[] for _ in range(sectors)]
    for beam, value in enumerate(ranges[0].tolist()):
        expected[((beam + 1) * sectors - 1) // beams].append(value if value <= 8.0 else np.inf)
    assert nearest[0].tolist() == [min(values) for values in expected]
    pooled = pool_sectors(np.where(ranges <= 8.0, ranges, np.inf), sectors)
    assert nearest.tolist() == pooled.tolist()
