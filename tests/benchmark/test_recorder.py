# SPDX-License-Identifier: Apache-2.0
"""Figures of merit of scripted drives, worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from pm01_nav.benchmark.recorder import EpisodeResults, Recorder
from pm01_nav.envs.spaces import resolve_task
from pm01_nav.task.navigation import NavigationBatch
from pm01_nav.worlds.mover import Mover
from pm01_nav.worlds.pool import build_pool
from pm01_nav.worlds.world import World

BOUNDS = (0.0, 0.0, 20.0, 20.0)
WALL = np.array([[0.0, 0.0, 20.0, 0.0]])
# Without lag and with limits that nothing reaches, a command is a speed at once.
IDEAL = {
    "actuator": {"lag_s": 0.0},
    "limits": {"linear_acceleration": 1e6, "angular_acceleration": 1e6, "linear_max": 2.0},
}


def record(world: World, commands, pose=(5.0, 5.0, 0.0), goal=(15.0, 15.0)) -> EpisodeResults:
    """Drive one ideal robot by a list of commands, or until its episode ends."""
    config = resolve_task("static", {"robot_changes": IDEAL})
    config = config.model_copy(update={"time_limit_s": 0.1 * len(commands)})
    batch = NavigationBatch(config, build_pool([world], radius=0.1), 1, autoreset=False)
    batch.reset([0], np.array([0]))
    batch.simulator.place(np.array([0]), np.array([pose]), np.array([goal]))
    recorder = Recorder.begin(batch)
    for command in commands:
        recorder.record(batch, np.array([command]))
    assert not recorder.active[0]
    return recorder.results(np.zeros(1, dtype=np.int64), np.zeros(1), np.full(1, np.nan))


def test_clearance_of_a_drive_away_from_a_wall() -> None:
    # 1 m/s for ten steps of 0.1 m away from a wall at 1 m; PM01's radius is 0.17 m.
    results = record(
        World("wall", BOUNDS, segments=WALL), [(1.0, 0.0)] * 10, pose=(5.0, 1.0, np.pi / 2)
    )
    assert results.min_clearance[0] == pytest.approx(0.83)
    # 1.1, 1.2, ..., 2.0 m after the steps, 1.55 m on average, less what the start costs: in the
    # first of four parts of a step, 25 ms, it goes at 0.5 m/s on average.
    assert results.mean_clearance[0] == pytest.approx(1.55 - 0.0125 - 0.17)
    assert results.path_length[0] == pytest.approx(1.0 - 0.0125)


def test_jerk_of_a_stop() -> None:
    world = World("wall", BOUNDS, segments=WALL)
    # v: 0, 1, 1, 0, 0. Second differences from the second step on: -1, -1, 1; over dt^2 = 0.01.
    results = record(world, [(1.0, 0.0), (1.0, 0.0), (0.0, 0.0), (0.0, 0.0)])
    assert results.jerk[0] == pytest.approx(100.0)


def test_turns_to_the_other_side_are_counted_whatever_lies_between() -> None:
    world = World("wall", BOUNDS, segments=WALL)
    turns = [1.0, 1.0, 0.0, -1.0, 0.1, -1.0, 0.15, 0.1, 1.0, -0.1, 1.0, -0.5]
    # Left, right (1), right, left (2), left, right (3) in 1.2 s.
    results = record(world, [(0.0, w) for w in turns])
    assert results.turn_reversals[0] == pytest.approx(3 / 1.2 * 60)


def test_personal_space() -> None:
    # A pedestrian of radius 0.3 m goes back and forth between x = 9 and x = 13, far from the robot.
    route = np.array([[9.0, 5.0], [13.0, 5.0]])
    walker = Mover("pedestrian", 0.3, route, speed=1.0)
    far = World("far", BOUNDS, segments=WALL, movers=(walker,))
    assert record(far, [(0.0, 0.0)] * 10, pose=(3.0, 3.0, 0.0)).intrusion[0] == 0.0
    # 0.4 m beside its way: nearer than 0.5 m in some steps, and further away in others.
    near = record(far, [(0.0, 0.0)] * 60, pose=(11.0, 5.0 + 0.17 + 0.3 + 0.4, 0.0)).intrusion[0]
    assert 0.0 < near < 1.0


def test_carts_have_no_personal_space() -> None:
    route = np.array([[9.0, 5.0], [13.0, 5.0]])
    cart = World("cart", BOUNDS, segments=WALL, movers=(Mover("loop", 0.3, route, speed=1.0),))
    assert np.isnan(record(cart, [(0.0, 0.0)] * 10, pose=(3.0, 3.0, 0.0)).intrusion[0])


def test_a_world_without_pedestrians_says_nothing_about_them() -> None:
    world = World("wall", BOUNDS, segments=WALL)
    assert np.isnan(record(world, [(0.0, 0.0)]).intrusion[0])
