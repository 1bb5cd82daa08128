# SPDX-License-Identifier: Apache-2.0
"""A lidar that lies: each lie alone, by hand."""

from __future__ import annotations

import numpy as np
import pytest

from pm01_nav.robot import full_circle
from pm01_nav.worlds.world import OccupancyGrid, World

BOUNDS = (-5.0, -5.0, 5.0, 5.0)
AHEAD = {"num_beams": 1, "angle_min": 0.0, "angle_max": 0.0, "range_max": 10.0}
ROOM = np.array([[-2, -2, 2, -2], [2, -2, 2, 2], [2, 2, -2, 2], [-2, 2, -2, -2]], dtype=float)
TOLERANCE = 1e-5


def wall(x: float) -> World:
    return World("wall", BOUNDS, segments=np.array([[x, -1.0, x, 1.0]]))


def test_error_of_the_yaw_shifts_the_scan(make_robot, simulate) -> None:
    robot = make_robot(lidar=full_circle(360) | {"range_max": 10.0})
    world = World("room", BOUNDS, segments=ROOM)
    exact = simulate(robot, world, [0.3, 0.2, 0.1]).scan[0]
    # Turned to the left by one beam's step, beam k looks where beam k + 1 should.
    crooked = simulate(robot, world, [0.3, 0.2, 0.1], {"lidar_yaw_error": np.radians(1.0)}).scan[0]
    assert crooked == pytest.approx(np.roll(exact, -1), abs=TOLERANCE)


def test_error_of_the_place(make_robot, simulate) -> None:
    lidar = {"num_beams": 2, "angle_min": 0.0, "angle_max": np.pi / 2, "range_max": 10.0}
    world = World("room", BOUNDS, segments=ROOM)
    errors = {"lidar_x_error": 0.1, "lidar_y_error": -0.2}
    # Walls 2 m ahead and to the left; the lidar stands 0.1 m forward and 0.2 m to the right.
    assert simulate(make_robot(lidar=lidar), world, [0.0, 0.0, 0.0], errors).scan[
        0
    ] == pytest.approx([1.9, 2.2], abs=TOLERANCE)


def test_noise_at_one_metre_and_at_three(make_robot, simulate) -> None:
    robot = make_robot(lidar=AHEAD)
    poses = np.zeros((10_000, 3))
    poses[5000:, 0] = -2.0
    errors = {"lidar_noise_std": 0.03, "lidar_noise_share": 0.02}
    ranges = simulate(robot, wall(1.0), poses, errors).scan[:, 0].astype(np.float64)
    # sqrt(0.03^2 + (0.02 x 1)^2) = 0.0360555 m, sqrt(0.03^2 + (0.02 x 3)^2) = 0.0670820 m.
    for part, distance, std in ((ranges[:5000], 1.0, 0.0360555), (ranges[5000:], 3.0, 0.0670820)):
        assert part.mean() == pytest.approx(distance, abs=4 * std / np.sqrt(5000))
        assert part.std() == pytest.approx(std, rel=4 / np.sqrt(2 * 5000))


def test_own_noise_stays_unless_replaced(make_robot, simulate) -> None:
    robot = make_robot(lidar=AHEAD | {"noise_std": 0.1})
    poses = np.zeros((2000, 3))
    assert simulate(robot, wall(1.0), poses, {}).scan.std() == pytest.approx(0.1, rel=4 / 63)
    assert simulate(robot, wall(1.0), poses, {"lidar_noise_std": 0.0}).scan == pytest.approx(1.0)


def test_noise_differs_between_beams_robots_and_scans(make_robot, simulate) -> None:
    robot = make_robot(lidar=full_circle(360) | {"range_max": 10.0})
    world = World("room", BOUNDS, segments=ROOM)
    exact = simulate(robot, world, [0.0, 0.0, 0.0]).scan[0]
    sim = simulate(robot, world, np.zeros((2, 3)), {"lidar_noise_std": 0.05})
    one, two = sim.scan - exact
    sim.step(np.zeros((2, 2)))
    later = sim.scan[0] - exact
    # Independent errors of 360 beams correlate by 1 / sqrt(360) = 0.053 at one sigma.
    for a, b in ((one, two), (one, later), (one[:-1], one[1:]), (one[:-4], one[4:])):
        assert abs(np.corrcoef(a, b)[0, 1]) < 4 * 0.053


@pytest.mark.parametrize("rate", [0.003, 0.1, 0.5])
def test_rate_of_dropout(make_robot, simulate, rate: float) -> None:
    robot = make_robot(lidar=full_circle(360) | {"range_max": 10.0})
    world = World("room", BOUNDS, segments=ROOM)
    lost = simulate(robot, world, np.zeros((400, 3)), {"lidar_dropout": rate}).scan == np.inf
    sigma = np.sqrt(rate * (1 - rate))
    assert lost.mean() == pytest.approx(rate, abs=4 * sigma / np.sqrt(lost.size))
    # Beams are independent: the number lost of 360 has a variance of 360 p (1 - p).
    assert lost.sum(axis=1).var() == pytest.approx(360 * sigma**2, rel=5 * np.sqrt(2 / 400))
    # No beam is favoured: each is lost in p of 400 scans, the farthest off of 360 within 4.5 sigma.
    assert np.abs(lost.mean(axis=0) - rate).max() < max(4.5 * sigma / np.sqrt(400), 0.02)


@pytest.mark.parametrize(("rate", "share"), [(0.0, 0.0), (1.0, 1.0)])
def test_no_and_total_dropout(make_robot, simulate, rate: float, share: float) -> None:
    robot = make_robot(lidar=full_circle(37) | {"range_max": 10.0})
    sim = simulate(robot, World("room", BOUNDS, segments=ROOM), [0.0] * 3, {"lidar_dropout": rate})
    assert (sim.scan == np.inf).mean() == share


def test_lidar_sees_less_far(make_robot, simulate) -> None:
    robot = make_robot(lidar=AHEAD)
    poses = [[-4.9, 0.0, 0.0], [-5.1, 0.0, 0.0]]
    assert simulate(robot, wall(0.0), poses, {"lidar_range_factor": 0.5}).scan[
        :, 0
    ] == pytest.approx([4.9, np.inf])


DISC = World("disc", BOUNDS, discs=np.array([[0.5, 0.0, 0.5]]))
CELLS = np.ones((1, 1), dtype=np.uint8)
GRID = World("grid", BOUNDS, grid=OccupancyGrid(CELLS, 0.4, (0.0, -0.2)))


@pytest.mark.parametrize("world", [wall(0.0), DISC, GRID], ids=["wall", "disc", "grid"])
def test_dark_obstacle_appears_within_its_range(make_robot, simulate, world: World) -> None:
    poses = [[-x, 0.0, 0.0] for x in (0.3, 0.99, 1.01, 3.0)]
    dark = {"dark_share": 1.0, "dark_range": 1.0}
    scan = simulate(make_robot(lidar=AHEAD), world, poses, dark).scan[:, 0]
    assert scan == pytest.approx([0.3, 0.99, np.inf, np.inf], abs=TOLERANCE)
    light = simulate(make_robot(lidar=AHEAD), world, poses, {"dark_share": 0.0}).scan[:, 0]
    assert light == pytest.approx([0.3, 0.99, 1.01, 3.0], abs=TOLERANCE)


def test_dark_obstacle_hides_what_is_behind_it(make_robot, simulate) -> None:
    # Two discs in a row, each dark with probability 1/2: the first 1 m ahead, the second 3 m.
    discs = np.array([[1.5, 0.0, 0.5], [3.5, 0.0, 0.5]])
    world = World("row", BOUNDS, discs=discs)
    dark = {"dark_share": 0.5, "dark_range": 0.9}
    scan = simulate(make_robot(lidar=AHEAD), world, np.zeros((1000, 3)), dark).scan[:, 0]
    # Seen, or nothing at all; never the second one. 4 sigma: 4 x 0.5 / sqrt(1000) = 0.063.
    assert set(np.round(scan, 5)) == {1.0, np.inf}
    assert (scan == np.inf).mean() == pytest.approx(0.5, abs=0.063)


def test_obstacle_stays_dark_for_the_episode(make_robot, simulate) -> None:
    # Sixteen discs in a ring, each met by one beam.
    angles = 2 * np.pi * np.arange(16) / 16
    ring = np.column_stack([2.0 * np.cos(angles), 2.0 * np.sin(angles), np.full(16, 0.1)])
    robot = make_robot(lidar=full_circle(16))
    dark = {"dark_share": 0.5, "dark_range": 0.5}
    sim = simulate(robot, World("ring", BOUNDS, discs=ring), np.zeros((50, 3)), dark)
    first = np.isinf(sim.scan)
    for _ in range(5):
        sim.step(np.zeros((50, 2)))
        assert (np.isinf(sim.scan) == first).all()
    # Of 800 discs half are dark, in each robot's world others.
    assert first.mean() == pytest.approx(0.5, abs=4 * 0.5 / np.sqrt(800))
    assert len(np.unique(first, axis=0)) == 50
    # A new episode chooses anew.
    sim.reset(np.arange(50), np.zeros(50, dtype=np.int64))
    sim.place(np.arange(50), np.zeros((50, 3)), np.zeros((50, 2)))
    assert (np.isinf(sim.scan) != first).any(axis=1).all()


@pytest.mark.parametrize(
    ("delay_s", "dt", "steps"),
    # Rounded to steps: 0.14 s are 1.4 steps of 0.1 s, and seven of 0.02 s.
    [(0.0, 0.1, 0), (0.1, 0.1, 1), (0.3, 0.1, 3), (0.14, 0.1, 1), (0.1, 0.02, 5), (0.14, 0.02, 7)],
)
def test_scan_comes_late(make_robot, simulate, delay_s: float, dt: float, steps: int) -> None:
    robot = make_robot(
        lidar=AHEAD,
        limits={"linear_acceleration": 1e9},
        actuator={"lag_s": 0.0},
    )
    sim = simulate(robot, wall(2.0), [0.0, 0.0, 0.0], {"scan_delay_s": delay_s}, control_dt=dt)
    for _ in range(2):
        sim.place(np.array([0]), np.zeros((1, 3)), np.zeros((1, 2)))
        sim.state.twist[0, 0] = 0.5  # Already under way.
        seen = [float(sim.scan[0, 0])]
        for _ in range(9):
            sim.step(np.array([[0.5, 0.0]]))
            seen.append(float(sim.scan[0, 0]))
        # The wall comes nearer by 0.5 m/s. The first scan of an episode is never late, and nothing
        # of the last episode is seen.
        expected = [2.0 - 0.5 * dt * max(k - steps, 0) for k in range(10)]
        assert seen == pytest.approx(expected, abs=TOLERANCE)
    assert sim.state.nearest[0, 0] == sim.scan[0, 0]


def test_true_scan_knows_no_lies(make_robot, simulate) -> None:
    robot = make_robot(lidar=full_circle(36) | {"range_max": 10.0})
    world = World("room", BOUNDS, segments=ROOM)
    lies = {
        "lidar_noise_std": 0.1,
        "lidar_dropout": 0.5,
        "lidar_yaw_error": 0.3,
        "lidar_x_error": 0.1,
        "dark_share": 0.5,
        "scan_delay_s": 0.1,
        "lidar_range_factor": 0.5,
    }
    sim = simulate(robot, world, [0.3, 0.2, 0.1], lies)
    read = sim.scan.copy()
    assert sim.true_scan()[0] == pytest.approx(simulate(robot, world, [0.3, 0.2, 0.1]).scan[0])
    assert (sim.scan == read).all()
