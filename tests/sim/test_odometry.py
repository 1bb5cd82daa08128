# SPDX-License-Identifier: Apache-2.0
"""Where the robot believes to be, by hand."""

from __future__ import annotations

import numpy as np
import pytest

from pm01_nav.geometry import to_frame
from pm01_nav.worlds.world import World

OPEN = World("open", (-5.0, -5.0, 5.0, 5.0))
AT_ONCE = {
    "limits": {"linear_acceleration": 1e9, "angular_acceleration": 1e9},
    "actuator": {"lag_s": 0.0},
}


def drive(sim, command, steps: int) -> None:
    """Give a command to robots that already move as it says."""
    sim.state.twist[:] = command
    for _ in range(steps):
        sim.step(np.tile(np.asarray(command, dtype=np.float64), (sim.num_envs, 1)))


def test_drift_after_five_metres_straight(make_robot, simulate) -> None:
    errors = {"odometry_drift_per_m": 0.02, "odometry_scale": 1.01}
    sim = simulate(make_robot(**AT_ONCE), OPEN, [0.0, 0.0, 0.0], errors)
    drive(sim, [0.5, 0.0], 100)
    # In truth 5 m straight. Odometry turns by 5 m x 0.02 = 0.1 rad on an arc of 5.05 m, so its
    # radius is 50.5 m.
    assert sim.state.pose[0] == pytest.approx([5.0, 0.0, 0.0], abs=1e-12)
    expected = [50.5 * np.sin(0.1), 50.5 * (1 - np.cos(0.1)), 0.1]
    # A step's chord stands for its arc: too long by 0.001^2 / 24 of itself.
    assert sim.measured_pose[0] == pytest.approx(expected, abs=1e-6)
    assert sim.measured_twist[0] == pytest.approx([0.505, 0.01])
    assert sim.state.twist[0].tolist() == [0.5, 0.0]


def test_reversing_undoes_the_drift(make_robot, simulate) -> None:
    sim = simulate(make_robot(**AT_ONCE), OPEN, [0.0, 0.0, 0.0], {"odometry_drift_per_m": 0.1})
    drive(sim, [0.2, 0.0], 20)
    assert sim.measured_pose[0, 2] == pytest.approx(0.04)
    drive(sim, [-0.2, 0.0], 20)
    assert sim.measured_pose[0] == pytest.approx([0.0, 0.0, 0.0], abs=1e-12)


def test_drift_of_a_turn_on_the_spot(make_robot, simulate) -> None:
    sim = simulate(make_robot(**AT_ONCE), OPEN, [1.0, 2.0, 0.5], {"odometry_drift_per_rad": -0.1})
    drive(sim, [0.0, 1.0], 10)
    # One radian to the left is seen as 0.9.
    assert sim.measured_pose[0] == pytest.approx([1.0, 2.0, 1.4], abs=1e-12)
    assert sim.measured_twist[0] == pytest.approx([0.0, 0.9])


def test_goal_is_seen_from_where_the_robot_believes_to_be(make_robot, simulate) -> None:
    errors = {"odometry_drift_per_m": 0.1, "odometry_drift_per_rad": 0.05, "odometry_scale": 0.97}
    sim = simulate(make_robot(), OPEN, [[0.5, -1.0, 2.0]], errors)
    sim.place(np.array([0]), [[0.5, -1.0, 2.0]], [[3.0, 1.5]])
    rng = np.random.default_rng(2)
    for _ in range(40):
        drive(sim, rng.uniform([0.0, -1.5], [0.5, 1.5]), 1)
        x, y = to_frame(np.array([3.0, 1.5]), sim.measured_pose[0])
        polar = [np.hypot(x, y), np.arctan2(y, x)]
        assert sim.measured_goal[0] == pytest.approx(polar, abs=1e-12)
        x, y = to_frame(np.array([3.0, 1.5]), sim.state.pose[0])
        assert sim.state.goal_polar[0] == pytest.approx([np.hypot(x, y), np.arctan2(y, x)])
    assert np.abs(sim.measured_goal - sim.state.goal_polar).max() > 0.05


def test_without_errors_odometry_is_right(make_robot, simulate) -> None:
    poses = np.random.default_rng(0).uniform(-3, 3, (20, 3))
    sim = simulate(make_robot(), OPEN, poses, {})
    rng = np.random.default_rng(1)
    for _ in range(100):
        sim.step(rng.uniform([-0.2, -1.5], [0.5, 1.5], (20, 2)))
    # 100 sums of numbers of about 1, each rounded to 1e-16.
    assert sim.measured_pose == pytest.approx(sim.state.pose, abs=1e-12)
    assert sim.measured_goal == pytest.approx(sim.state.goal_polar, abs=1e-12)
    assert (sim.measured_twist == sim.state.twist).all()


def test_goal_error_has_its_length_and_any_direction(make_robot, simulate) -> None:
    sim = simulate(
        make_robot(lidar={"num_beams": 1}), OPEN, np.zeros((4000, 3)), {"goal_error": 0.3}
    )
    error = sim.errors.odometry_goal - sim.state.goal
    assert np.hypot(*error.T) == pytest.approx(0.3)
    # Each part is 0.3 x cos of a uniform angle: mean 0, deviation 0.3 / sqrt(2) = 0.2121.
    assert error.mean(axis=0) == pytest.approx([0.0, 0.0], abs=4 * 0.2121 / np.sqrt(4000))
    # Of the squares, 0.045 +- 0.09 / sqrt(8), the mean likewise.
    assert (error**2).mean(axis=0) == pytest.approx([0.045] * 2, abs=4 * 0.0318 / np.sqrt(4000))


def test_new_episode_starts_without_drift(make_robot, simulate) -> None:
    sim = simulate(make_robot(), OPEN, [0.0, 0.0, 0.0], {"odometry_drift_per_m": 0.1})
    drive(sim, [0.5, 0.5], 20)
    assert np.abs(sim.measured_pose - sim.state.pose).max() > 0.05
    sim.reset()
    assert (sim.measured_pose == sim.state.pose).all()
