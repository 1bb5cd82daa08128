# SPDX-License-Identifier: Apache-2.0
"""Scans that are taken on the way, compared with a slow twin that casts each part by itself."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from pm01_nav.geometry import rectangle
from pm01_nav.robot import RobotSpec, full_circle
from pm01_nav.sim.lidar_errors import SEGMENT_NUMBERS, is_dark, patch_number
from pm01_nav.worlds.world import OccupancyGrid, World
from tests.sim.reference import reference_scan

BOUNDS = (-5.0, -5.0, 5.0, 5.0)
TOLERANCE = 2e-5
"""Ranges are float32 and robots have moved by sums of small steps before they look."""
DT = 0.1
AT_ONCE = {
    "limits": {
        "linear_min": -2.0,
        "linear_max": 2.0,
        "angular_max": 5.0,
        "linear_acceleration": 1e9,
        "angular_acceleration": 1e9,
    },
    "actuator": {"lag_s": 0.0},
    # So small that it never meets anything: a stopped robot has no simple motion.
    "footprint": {"radius": 1e-6},
}


def random_world(rng: np.random.Generator, index: int) -> World:
    boxes = (rectangle(*rng.uniform(-3, 3, 2), *rng.uniform(0.1, 1.5, 2), rng.uniform(-3, 3)),)
    discs = np.column_stack([rng.uniform(-4, 4, (7, 2)), rng.uniform(0.05, 0.8, 7)])
    world = World(
        "random", BOUNDS, discs=discs, polygons=boxes, segments=rng.uniform(-5, 5, (5, 4))
    )
    if index % 3:
        return world
    cells = (rng.random((16, 16)) < 0.05).astype(np.uint8)
    return replace(world, grid=OccupancyGrid(cells, 0.25, (-2.0, -2.0)))


def pose_on_arc(pose, command, t: float) -> NDArray[np.float64]:
    """Return where a robot is after ``t`` seconds of a constant twist."""
    (x, y, yaw), (v, w) = pose, command
    end = yaw + w * t
    if w == 0.0:
        return np.array([x + v * t * np.cos(yaw), y + v * t * np.sin(yaw), yaw])
    radius = v / w
    return np.array(
        [x + radius * (np.sin(end) - np.sin(yaw)), y - radius * (np.cos(end) - np.cos(yaw)), end]
    )


def parts(num_beams: int) -> list[slice]:
    """Cut a scan into at most 8 parts of whole blocks of 8 beams."""
    size = 8 * math.ceil(math.ceil(num_beams / 8) / 8)
    return [slice(b, min(b + size, num_beams)) for b in range(0, num_beams, size)]


def swept(world: World, robot: RobotSpec, pose, command, share: float, turned: float = 0.0):
    """Return a scan that takes the last ``share`` of a control step after ``pose``."""
    n = robot.lidar.num_beams
    ranges = np.empty(n)
    for part in parts(n):
        middle = 0.5 * (part.start + part.stop) / n
        there = pose_on_arc(pose, command, DT * (1.0 - share * (1.0 - middle)))
        ranges[part] = reference_scan(world, robot, there + np.array([0.0, 0.0, turned]))[part]
    return ranges


def drive_and_compare(simulate, robot, worlds, share: float, rng, twin) -> None:
    """Compare scans after one step at constant twists with ``twin(i, pose, command, turned)``."""
    poses = rng.uniform([-4, -4, -np.pi], [4, 4, np.pi], (len(worlds), 3))
    commands = rng.uniform([-2, -5], [2, 5], (len(worlds), 2))
    commands[::5, 1] = 0.0
    sim = simulate(robot, worlds, poses, share)
    poses = sim.state.pose.copy()
    sim.state.twist[:] = commands  # Already under way.
    sim.step(commands)
    bad = 0
    for i, fast in enumerate(sim.scan):
        if sim.state.contact[i]:
            continue
        slow = twin(sim, i, poses[i], commands[i], 0.0)
        wrong = ~np.isclose(fast, slow, atol=TOLERANCE, rtol=0)
        if wrong.any():
            # Only where turning the beams by a hair changes what they meet.
            near = [twin(sim, i, poses[i], commands[i], d) for d in (-1e-6, 1e-6)]
            steady = [np.isclose(slow, other, atol=TOLERANCE, rtol=0) for other in near]
            assert not (wrong & steady[0] & steady[1]).any()
            bad += int(wrong.sum())
    assert bad <= 3


@pytest.mark.parametrize("num_beams", [1, 20, 61, 360])
@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
def test_each_part_is_cast_from_its_own_place(
    make_robot, simulate, num_beams: int, share: float
) -> None:
    rng = np.random.default_rng([num_beams, int(10 * share)])
    worlds = [random_world(rng, i) for i in range(24)]
    mount = {"x": 0.15, "y": -0.1, "yaw": 0.4, "range_min": 0.0, "range_max": 6.0}
    robot = make_robot(lidar=full_circle(num_beams) | mount, **AT_ONCE)

    def twin(sim, i, pose, command, turned):
        return swept(worlds[i], robot, pose, command, share, turned)

    def simulated(robot, worlds, poses, share):
        return simulate(robot, worlds, poses, {"scan_sweep_s": 0.1 * share})

    drive_and_compare(simulated, robot, worlds, share, rng, twin)


def test_dark_obstacles_on_the_way(make_robot, simulate) -> None:
    rng = np.random.default_rng(8)
    worlds = [random_world(rng, i) for i in range(24)]
    lidar = full_circle(360) | {"range_min": 0.0, "range_max": 6.0}
    robot = make_robot(lidar=lidar, **AT_ONCE)
    near = 1.5

    def dark_part(sim, i: int, *, dark: bool) -> World:
        """Return the world of the dark obstacles of robot i, or that of the others."""
        world, arrays = worlds[i], sim.pool.arrays

        def chosen(number: int) -> bool:
            return is_dark(sim.errors, sim.drawn, i, number) == dark

        first_disc, first_wall = arrays.disc_begin[i], arrays.segment_begin[i]
        discs = [chosen(first_disc + k) for k in range(len(world.discs))]
        walls = [chosen(SEGMENT_NUMBERS + first_wall + k) for k in range(len(world.all_segments))]
        grid = world.grid
        if grid is not None:
            # Two by two cells of 0.25 m are one patch of 0.5 m.
            cells = [
                [solid and chosen(patch_number(*centre(grid, c, r), arrays, i)) for c, solid in row]
                for r, row in enumerate(map(enumerate, grid.occupied))
            ]
            grid = replace(grid, occupied=np.array(cells, dtype=np.uint8))
        segments = world.all_segments[walls]
        return World("part", BOUNDS, discs=world.discs[discs], segments=segments, grid=grid)

    def twin(sim, i, pose, command, turned):
        dark, light = (
            swept(dark_part(sim, i, dark=d), robot, pose, command, 0.7, turned)
            for d in (True, False)
        )
        return np.where(dark < light, np.where(dark <= near, dark, np.inf), light)

    def simulated(robot, worlds, poses, share):
        errors = {"scan_sweep_s": 0.1 * share, "dark_share": 0.5, "dark_range": near}
        return simulate(robot, worlds, poses, errors)

    drive_and_compare(simulated, robot, worlds, 0.7, rng, twin)


def centre(grid: OccupancyGrid, column: int, row: int) -> tuple[float, float]:
    size = grid.resolution
    return grid.origin[0] + (column + 0.5) * size, grid.origin[1] + (row + 0.5) * size


def test_robot_that_turns_sees_a_turned_room(make_robot, simulate) -> None:
    # A wall 1 m ahead of a robot that turns left at 5 rad/s: beam 180 of 360 looks ahead. In a
    # sweep of the whole step its part, beams 144 to 191 (48 each), is taken at (168 / 360) of it,
    # 0.2333 rad on; the robot has turned 0.5 rad by then, and the wall is square to the start.
    robot = make_robot(lidar=full_circle(360) | {"range_max": 6.0}, **AT_ONCE)
    world = World("wall", BOUNDS, segments=np.array([[1.0, -4.0, 1.0, 4.0]]))
    sim = simulate(robot, world, [0.0, 0.0, 0.0], {"scan_sweep_s": 0.1})
    sim.state.twist[0] = [0.0, 5.0]
    sim.step(np.array([[0.0, 5.0]]))
    assert sim.scan[0, 180] == pytest.approx(1 / np.cos(0.5 * 168 / 360), abs=TOLERANCE)
    still = simulate(robot, world, [0.0, 0.0, 0.0], {"scan_sweep_s": 0.0})
    still.state.twist[0] = [0.0, 5.0]
    still.step(np.array([[0.0, 5.0]]))
    assert still.scan[0, 180] == pytest.approx(1 / np.cos(0.5), abs=TOLERANCE)


@pytest.mark.parametrize("dt", [0.1, 0.02])
def test_a_sweep_takes_its_seconds_whatever_a_step_takes(make_robot, simulate, dt: float) -> None:
    # As above, but the robot has turned at 5 rad/s for long. The last beam looks at the end of the
    # step, 0.1 s after the first: beams 144 to 191 are taken (1 - 168 / 360) x 0.1 s before it.
    robot = make_robot(lidar=full_circle(360) | {"range_max": 6.0}, **AT_ONCE)
    world = World("wall", BOUNDS, segments=np.array([[1.0, -4.0, 1.0, 4.0]]))
    errors = {"scan_sweep_s": 0.1}
    sim = simulate(robot, world, [0.0, 0.0, 0.0], errors, control_dt=dt)
    sim.state.twist[0] = [0.0, 5.0]
    for _ in range(round(0.1 / dt)):
        sim.step(np.array([[0.0, 5.0]]))
    assert sim.scan[0, 180] == pytest.approx(1 / np.cos(0.5 * 168 / 360), abs=TOLERANCE)
