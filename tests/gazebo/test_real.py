# SPDX-License-Identifier: Apache-2.0
"""Robots in the real Gazebo Harmonic; skipped where it is not installed."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import numpy as np
import pytest

from pm01_nav.arrays import NUMPY
from pm01_nav.backends import make_simulator
from pm01_nav.backends.physics import PhysicsSimulator
from pm01_nav.geometry import rectangle
from pm01_nav.robot import load_robot
from pm01_nav.task.tasks import task_config
from pm01_nav.task.worlds import world_pool
from pm01_nav.worlds.mover import Mover
from pm01_nav.worlds.world import World

pytestmark = pytest.mark.gazebo

FIELD = World("field", (-40.0, -40.0, 40.0, 40.0), discs=np.array([[35.0, 35.0, 0.3]]))
WALL = World("wall", (-9.0, -9.0, 9.0, 9.0), polygons=(rectangle(2.5, 0.0, 1.0, 10.0),))
GREATEST = np.array([0.5, 1.5])
DRIVES = {
    "straight": [(1.0, 0.0)] * 30 + [(0.0, 0.0)] * 10,
    "arc": [(0.8, 0.5)] * 30 + [(0.0, 0.0)] * 10,
    "spin": [(0.0, 1.0)] * 30 + [(0.0, 0.0)] * 10,
}


@pytest.mark.parametrize("drive", DRIVES)
def test_drives_as_in_the_plane(gazebo, drive: str) -> None:
    start = [[1.0, 2.0, 0.5]]
    body, plane = gazebo(start, FIELD), gazebo(start, FIELD, backend="planar")
    way, turn = 0.0, 0.0
    for command in DRIVES[drive]:
        v, w = np.array(command) * GREATEST
        for simulator in (body, plane):
            simulator.step([[v, w]])
        way, turn = way + 0.1 * v, turn + 0.1 * w
        apart = np.linalg.norm(body.state.pose[0, :2] - plane.state.pose[0, :2])
        turned = body.state.pose[0, 2] - plane.state.pose[0, 2]
        # 1 cm and 1 % of the way; 0.03 rad and 0.5 % of the turn, as for the other engines.
        assert apart <= 0.01 + 0.01 * way
        assert abs((turned + np.pi) % (2.0 * np.pi) - np.pi) <= 0.03 + 0.005 * turn
    assert np.abs(body.state.twist[0]).max() < 0.01
    # What the wheels say is near to the truth, and counts from where the robot was put.
    assert body.measured_pose[0, :2] == pytest.approx(body.state.pose[0, :2], abs=0.02)


def test_scans_are_those_of_the_plane(gazebo) -> None:
    pool = world_pool(task_config("static"), "held_out", 6, 1)
    scans = []
    for backend in ("gazebo", "planar"):
        simulator = make_simulator(backend, NUMPY, load_robot("pm01"), pool, 1)
        for world in range(6):
            simulator.seed([world])
            simulator.reset(worlds=np.array([world]))
            scans.append(simulator.scan[0].astype(np.float64))
    drawn, cast = np.array(scans[:6]), np.array(scans[6:])
    assert (np.isfinite(drawn) == np.isfinite(cast)).mean() > 0.99
    both = np.isfinite(drawn) & np.isfinite(cast)
    off = np.abs(drawn[both] - cast[both])
    assert np.median(off) < 0.005
    # A beam that grazes something may be off by as much as its neighbours differ, no more.
    near = np.stack([np.roll(cast, shift, axis=1) for shift in (-1, 0, 1)])
    near = np.where(np.isfinite(near), near, 3.5)
    low, high = near.min(axis=0) - 0.02, near.max(axis=0) + 0.02
    inside = (low <= drawn) & ((drawn <= high) | (high >= 3.5))
    assert inside.mean() > 0.999
    # Least of all beside the edges of the cube map, 45 degrees beside the axes.
    seams = [44, 45, 46, 134, 135, 136, 224, 225, 226, 314, 315, 316]
    assert inside[:, seams].all()


def test_the_scan_is_the_one_of_the_steps_end(gazebo) -> None:
    simulator = gazebo([[0.0, 0.0, 0.0]], WALL)
    for _ in range(12):
        simulator.step([[0.5, 0.0]])
        # The wall's face is at x = 2; 5 cm a step would show at once.
        ahead = float(simulator.scan[0, 180])
        assert ahead == pytest.approx(2.0 - simulator.state.pose[0, 0], abs=0.012)


def test_driving_into_a_wall_is_a_contact(gazebo) -> None:
    simulator = gazebo([[1.5, 0.0, 0.0]], WALL)
    touched = []
    for _ in range(15):
        simulator.step([[0.5, 0.0]])
        touched.append(bool(simulator.state.contact[0]))
    # The footprint's radius is 0.17 m: 0.33 m to go at 0.5 m/s.
    first = touched.index(True)
    assert 6 <= first <= 9
    assert simulator.state.pose[0, 0] == pytest.approx(1.83, abs=0.03)
    # Put elsewhere it touches nothing.
    simulator.place(np.array([0]), [[-2.0, 0.0, 0.0]], [[1.0, 0.0]])
    simulator.step([[0.1, 0.0]])
    assert not simulator.state.contact[0]


def test_the_same_start_gives_the_same_drive(gazebo) -> None:
    runs = []
    for _ in range(2):
        simulator = gazebo([[0.0, 0.0, 0.3]], WALL)
        run = [simulator.scan.copy()]
        for k in range(10):
            simulator.step([[0.3, 0.2 * (-1) ** k]])
            run += [simulator.state.pose.copy(), simulator.scan.copy()]
        runs.append(run)
    for first, second in zip(*runs, strict=True):
        assert first == pytest.approx(second, abs=1e-4)


def test_movers_are_seen_where_the_plane_has_them(gazebo) -> None:
    walker = Mover("bounce", 0.3, np.array([[2.0, 0.0]]), speed=0.5)
    world = World("walk", (-9.0, -9.0, 9.0, 9.0), movers=(walker,))
    simulator = gazebo([[0.0, 0.0, 0.0]], world)
    places = []
    for _ in range(10):
        simulator.step([[0.0, 0.0]])
        x, y, radius = simulator.movers(0)[0]
        places.append((x, y))
        distance = np.hypot(x, y)
        bearing = round(np.degrees(np.arctan2(y, x)) + 180.0) % 360
        assert simulator.scan[0, bearing] == pytest.approx(distance - radius, abs=0.02)
    assert np.linalg.norm(np.subtract(places[-1], places[0])) == pytest.approx(0.45, abs=0.01)


def test_a_server_that_is_killed_costs_the_episode(gazebo) -> None:
    simulator = gazebo([[0.0, 0.0, 0.0]], WALL)
    assert isinstance(simulator, PhysicsSimulator)
    simulator.step([[0.1, 0.0]])
    engine = simulator._engine
    os.kill(engine._robots[0]._worker.process_id, signal.SIGKILL)
    simulator.step([[0.1, 0.0]])
    assert "died in the middle of the episode" in simulator.faults[0]
    simulator.reset()
    simulator.step([[0.1, 0.0]])
    assert not simulator.faults


def test_a_picture_shows_the_robot_and_its_goal(gazebo) -> None:
    simulator = gazebo([[0.0, 0.0, 0.0]], WALL)
    picture = simulator.picture(0, np.array([-2.0, 0.0, 2.0]), (160, 120))
    assert picture.shape == (120, 160, 3)
    red, green, blue = picture.astype(int).reshape(-1, 3).T
    # The blue hull and the green marker of the goal, 5 m to the left, out of sight.
    assert ((blue > red + 30) & (blue > green)).sum() > 50


@pytest.mark.slow
def test_memory_stays_flat_over_many_resets(gazebo) -> None:
    pool = world_pool(task_config("static"), "train", 16)
    simulator = make_simulator("gazebo", NUMPY, load_robot("pm01"), pool, 1)
    simulator.seed([0])

    def resident() -> int:
        process = simulator._engine._robots[0]._worker.process_id
        return int(Path(f"/proc/{process}/statm").read_text().split()[1])

    sizes = []
    for number in range(400):
        simulator.reset()
        if number % 100 == 99:
            sizes.append(resident())
    assert sizes[-1] < 1.05 * sizes[0]
