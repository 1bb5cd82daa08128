# SPDX-License-Identifier: Apache-2.0
"""Robots in MuJoCo and PyBullet stand, drive, see and touch as those in the plane do."""

from __future__ import annotations

import numpy as np
import pytest

from pm01_nav.backends.engine import Motion, Scenario
from pm01_nav.backends.physics import PhysicsSimulator
from pm01_nav.robot import load_robot
from pm01_nav.worlds.mover import Mover
from pm01_nav.worlds.world import OccupancyGrid, World
from tests.backends.conftest import Make

FULL, STILL = 1.0, (0.0, 0.0)
DRIVES = {
    "straight": [(1.0, 0.0)] * 40,
    "arc": [(0.8, 0.5)] * 40,
    "spin": [(0.0, 1.0)] * 40,
    "stop": [(1.0, 0.0)] * 10 + [STILL] * 10,
    "back": [(-1.0, 0.0)] * 40,
}
WALL = World("wall", (-10.0, -10.0, 10.0, 10.0), segments=np.array([[1.0, -2.0, 1.0, 2.0]]))


@pytest.mark.parametrize("name", ["pm01", "turtlebot3_burger", "turtlebot3_waffle", "jackal"])
def test_settles_after_a_drop(make: Make, engine: str, name: str) -> None:
    simulator = make(engine, [[0.0, 0.0, 0.5]], robot=name)
    assert isinstance(simulator, PhysicsSimulator)
    motion, still = Motion.of(1), np.zeros((1, 2))
    ranges = np.zeros((1, simulator.state.ranges.shape[1]), dtype=np.float32)
    start = Scenario(0, np.array([0.0, 0.0, 0.5]), np.zeros((0, 2)), height=0.01)
    simulator._engine.reset(0, start)
    poses = []
    for _ in range(110):
        simulator._engine.step(still, np.zeros((5, 1, 0, 2)), motion, ranges)
        poses.append(motion.pose[0].copy())
        if len(poses) > 10:  # at rest a second after the drop
            assert np.abs(motion.twist[0]).max() < 1e-3
    # Ten seconds later it still stands there: within 1 mm, and 2 mrad or 0.1 degrees.
    drift = np.abs(poses[-1] - poses[9])
    assert np.hypot(*drift[:2]) < 1e-3
    assert drift[2] < 2e-3
    assert poses[-1] == pytest.approx([0.0, 0.0, 0.5], abs=3e-3)


@pytest.mark.parametrize("drive", DRIVES)
@pytest.mark.parametrize("name", ["pm01", "turtlebot3_waffle"])
def test_drives_as_in_the_plane(make: Make, engine: str, name: str, drive: str) -> None:
    limits = load_robot(name).limits
    both = [make(backend, [[0.0, 0.0, 0.0]], robot=name) for backend in ("planar", engine)]
    way, turn = 0.0, 0.0
    for v, w in DRIVES[drive]:
        speed = v * (limits.linear_max if v > 0 else -limits.linear_min)
        for simulator in both:
            simulator.step([[speed, w * limits.angular_max]])
        plane, body = (simulator.state for simulator in both)
        way += 0.1 * abs(speed)
        turn += 0.1 * abs(w) * limits.angular_max
        apart = np.linalg.norm(body.pose[0, :2] - plane.pose[0, :2])
        # What wheels slip and servos lag: 1 cm and 1 % of the way, 0.03 rad and 0.5 % of the turn.
        assert apart <= 0.01 + 0.01 * way
        turned = abs((body.pose[0, 2] - plane.pose[0, 2] + np.pi) % (2 * np.pi) - np.pi)
        assert turned <= 0.03 + 0.005 * turn
    assert both[1].state.twist[0] == pytest.approx(both[0].state.twist[0], abs=0.01)


def test_scans_agree_to_a_centimetre(make: Make, engine: str) -> None:
    notch = np.array([[4, 4], [6, 4], [6, 4.5], [4.5, 4.5], [4.5, 6], [4, 6]], dtype=np.float64)
    triangle = np.array([[-3.0, -3.0], [-1.5, -3.0], [-2.5, -1.8]])
    world = World(
        "all",
        (-8.0, -8.0, 8.0, 8.0),
        discs=np.array([[1.5, 0.4, 0.25], [-1.0, 2.0, 0.5]]),
        polygons=(notch, triangle, np.array([[2.0, -2.0], [3.0, -2.0], [3.0, -1.0], [2.0, -1.0]])),
        segments=np.array([[-3.0, 0.0, -2.0, 1.5]]),
        grid=OccupancyGrid(np.array([[1, 1], [0, 1]], dtype=np.uint8), 0.5, (0.0, -3.0)),
    )
    poses = [[0.0, 0.0, 0.0], [0.3, -1.0, 2.1], [3.0, 3.0, -1.0], [5.2, 5.2, 0.4]]
    plane, body = (make(backend, poses, world) for backend in ("planar", engine))
    near, far = plane.scan, body.scan
    # Beams that just touch or just miss an edge may differ by anything; they are few.
    agree = np.isclose(near, far, atol=0.01) | (near == far)
    assert agree.mean() >= 0.99
    assert np.isfinite(near).mean() > 0.3


def test_sees_the_lidar_where_it_is_mounted(make: Make, engine: str) -> None:
    lidar = load_robot("pm01").lidar.model_copy(update={"x": 0.1, "y": 0.05, "yaw": 0.5})
    plane, body = (
        make(backend, [[0.0, 0.0, 0.0]], WALL, lidar=lidar) for backend in ("planar", engine)
    )
    assert body.scan == pytest.approx(plane.scan, abs=0.01)


def test_a_wall_stops_it(make: Make, engine: str) -> None:
    simulator = make(engine, [[0.0, 0.0, 0.0], [0.0, 4.0, 0.0]], WALL)
    touched = np.zeros(2, dtype=np.bool_)
    for _ in range(40):
        simulator.step([[0.5, 0.0], [0.5, 0.0]])
        touched |= simulator.state.contact
    # The wall is at x = 1, the footprint's radius 0.17 m; the other robot passes its end.
    assert touched.tolist() == [True, False]
    assert simulator.state.pose[0, 0] == pytest.approx(0.83, abs=0.02)
    assert simulator.state.pose[1, 0] > 1.5


def test_movers_move_there(make: Make, engine: str) -> None:
    mover = Mover("bounce", 0.3, np.array([[3.0, 0.0]]), speed=0.5, heading=np.pi)
    world = World("lane", (-8.0, -8.0, 8.0, 8.0), movers=(mover,))
    plane, body = (make(backend, [[0.0, 0.0, 0.0]], world) for backend in ("planar", engine))
    place = body.state.mover_position[0, 0]
    place[:] = plane.state.mover_position[0, 0] = 3.0, 0.0
    for target in (plane, body):
        target.state.mover_target[0, 0] = -1.0, 0.0
    for _ in range(20):
        plane.step([[0.0, 0.0]])
        body.step([[0.0, 0.0]])
    # It came 1 m nearer in 2 s: its edge is at 3 - 1 - 0.3 m. Beam 180 looks ahead.
    assert body.scan[0, 180] == pytest.approx(1.7, abs=0.01)
    assert body.scan == pytest.approx(plane.scan, abs=0.02)
    while not body.state.contact[0] and body.state.mover_position[0, 0, 0] > 0.0:
        body.step([[0.0, 0.0]])
    assert body.state.contact[0]


def test_robots_do_not_meet(make: Make, engine: str) -> None:
    alone = make(engine, [[0.0, 0.0, 0.3]])
    among = make(engine, [[0.0, 0.0, 0.3]] * 5)
    for _ in range(15):
        alone.step([[0.5, 0.4]])
        among.step([[0.5, 0.4]] * 5)
    # PyBullet computes far from the origin; that costs some digits.
    assert among.state.pose == pytest.approx(np.tile(alone.state.pose, (5, 1)), abs=1e-6)
    assert np.isinf(among.scan).all()


def test_goes_on_with_some(make: Make, engine: str) -> None:
    poses = [[0.0, 0.0, 0.3], [1.0, 1.0, -2.0], [-2.0, 0.0, 1.0]]
    all_three, two = make(engine, poses), make(engine, poses)
    for _ in range(5):
        all_three.step([[0.5, 0.4]] * 3)
        two.step([[0.5, 0.4]] * 3)
    two.keep(np.array([0, 2]))
    for _ in range(5):
        all_three.step([[0.2, -0.4]] * 3)
        two.step([[0.2, -0.4]] * 2)
    # PyBullet solves the contacts of those who are left in another order.
    exactness = 1e-12 if engine == "mujoco" else 1e-3
    assert two.state.pose == pytest.approx(all_three.state.pose[[0, 2]], abs=exactness)
