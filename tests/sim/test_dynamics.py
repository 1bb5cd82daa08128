# SPDX-License-Identifier: Apache-2.0
"""How the base moves: closed forms, limits, lag and convergence."""

from __future__ import annotations

import numpy as np
import pytest

from pm01_nav.worlds.world import World
from tests.sim.reference import reference_motion

OPEN = World("open", (-5.0, -5.0, 5.0, 5.0))
AT_ONCE = {
    "limits": {"linear_acceleration": 1e9, "angular_acceleration": 1e9},
    "actuator": {"lag_s": 0.0},
}


def drive(sim, command, steps: int) -> None:
    """Give every robot the same command, ``steps`` times."""
    commands = np.tile(np.asarray(command, dtype=np.float64), (sim.num_envs, 1))
    for _ in range(steps):
        sim.step(commands)


@pytest.mark.parametrize(
    ("v", "w"), [(0.5, 0.0), (-0.2, 0.0), (0.0, 1.5), (0.0, -1.2), (0.5, 1.5), (0.3, -1e-7)]
)
def test_steady_twist_follows_its_arc(make_robot, simulate, v: float, w: float) -> None:
    sim = simulate(make_robot(**AT_ONCE), OPEN, [[1.0, -2.0, 0.7]])
    drive(sim, (v, w), 1)  # From rest to the commanded twist.
    x, y, yaw = sim.state.pose[0]
    drive(sim, (v, w), 20)
    # 20 steps of 0.1 s are 2 s: an arc of radius v / w, or a straight line. The chord of an arc of
    # angle a is 2 v/w sin(a / 2), along the mean heading; written so that a = 0 is no exception.
    a = 2.0 * w
    chord = 2.0 * v * np.sinc(a / 2 / np.pi)
    assert sim.state.pose[0, 0] == pytest.approx(x + chord * np.cos(yaw + a / 2), abs=1e-9)
    assert sim.state.pose[0, 1] == pytest.approx(y + chord * np.sin(yaw + a / 2), abs=1e-9)
    turned = (sim.state.pose[0, 2] - yaw - a) % (2 * np.pi)
    assert min(turned, 2 * np.pi - turned) == pytest.approx(0.0, abs=1e-9)
    assert sim.state.twist[0].tolist() == [v, w]


def test_start_without_inertia_is_nearly_immediate(make_robot, simulate) -> None:
    sim = simulate(make_robot(**AT_ONCE), OPEN, [[0.0, 0.0, 0.0]])
    drive(sim, (0.5, 0.0), 1)
    # 0.05 m, of which the first of at least two integration steps may lose up to a half.
    assert 0.05 * 0.75 - 1e-12 <= sim.state.pose[0, 0] <= 0.05
    assert sim.state.twist[0].tolist() == [0.5, 0.0]


def test_acceleration_limit_is_linear_in_time(make_robot, simulate) -> None:
    robot = make_robot(
        limits={"linear_acceleration": 0.4, "angular_acceleration": 2.0}, actuator={"lag_s": 0.0}
    )
    sim = simulate(robot, OPEN, [[0.0, 0.0, 0.0]])
    twists = []
    for _ in range(15):
        drive(sim, (0.5, -1.5), 1)
        twists.append(sim.state.twist[0].copy())
    # 0.04 m/s and 0.2 rad/s more each step of 0.1 s, up to 0.5 m/s and 1.5 rad/s.
    k = np.arange(1, 16)
    expected = np.stack([np.minimum(0.04 * k, 0.5), -np.minimum(0.2 * k, 1.5)], axis=-1)
    assert np.array(twists) == pytest.approx(expected, abs=1e-12)


def test_distance_while_accelerating(make_robot, simulate) -> None:
    robot = make_robot(limits={"linear_acceleration": 0.4}, actuator={"lag_s": 0.0})
    sim = simulate(robot, OPEN, [[0.0, 0.0, 0.0]])
    drive(sim, (0.5, 0.0), 10)
    # s = a t^2 / 2 = 0.4 / 2, exact because speed is linear in time and trapezoids are too.
    assert sim.state.pose[0, 0] == pytest.approx(0.2, abs=1e-12)


def test_lag_is_first_order(make_robot, simulate) -> None:
    robot = make_robot(
        limits={"linear_acceleration": 1e9, "angular_acceleration": 1e9}, actuator={"lag_s": 0.25}
    )
    sim = simulate(robot, OPEN, [[0.0, 0.0, 0.0]])
    for k in range(1, 11):
        drive(sim, (0.4, 1.0), 1)
        answer = 1.0 - np.exp(-0.1 * k / 0.25)
        assert sim.state.twist[0] == pytest.approx([0.4 * answer, answer], abs=1e-12)


def test_lag_and_limit_together_follow_the_slow_twin(make_robot, simulate) -> None:
    robot = make_robot(limits={"angular_acceleration": 4.0}, actuator={"lag_s": 0.1})
    sim = simulate(robot, OPEN, [[0.3, -0.2, 3.0]], control_dt=0.01)
    rng = np.random.default_rng(1)
    commands = rng.uniform([-0.2, -1.5], [0.5, 1.5], (8, 2))
    for command in commands:
        drive(sim, command, 30)
    pose, twist = reference_motion(robot, [0.3, -0.2, 3.0], [0.0, 0.0], commands, 0.3)
    # The path is 0.7 m long and turns by 2 rad; steps of 5 ms leave errors of 1e-4 of that.
    assert sim.state.pose[0, :2] == pytest.approx(pose[:2], abs=5e-4)
    assert np.cos(sim.state.pose[0, 2] - pose[2]) == pytest.approx(1.0, abs=1e-6)
    assert sim.state.twist[0] == pytest.approx(twist, abs=5e-4)


def test_halving_the_time_step_converges(make_robot, simulate) -> None:
    robot = make_robot(
        limits={"linear_acceleration": 1e9, "angular_acceleration": 1e9}, actuator={"lag_s": 0.3}
    )
    start, command = [0.0, 0.0, 0.0], (0.5, 1.2)
    truth, _ = reference_motion(robot, start, [0.0, 0.0], [command], 1.6)
    errors = []
    for count in (8, 16, 32, 64):
        sim = simulate(robot, OPEN, start, control_dt=1.6 / count)
        drive(sim, command, count)
        errors.append(np.linalg.norm(sim.state.pose[0, :2] - truth[:2]))
    # A mean of two speeds is a trapezoid rule, of second order: each halving divides the error by
    # 4; 3.5 leaves room for the terms of higher order.
    ratios = np.array(errors[:-1]) / errors[1:]
    assert (ratios > 3.5).all()
    assert errors[-1] < 1e-4


@pytest.mark.parametrize(
    ("asked", "given"),
    [
        ((9.0, 0.0), (0.5, 0.0)),
        ((-9.0, 0.0), (-0.2, 0.0)),
        ((0.1, 9.0), (0.1, 1.5)),
        ((0.1, -9.0), (0.1, -1.5)),
        ((np.inf, -np.inf), (0.5, -1.5)),
    ],
)
def test_commands_are_clipped_to_the_limits(make_robot, simulate, asked, given) -> None:
    sim = simulate(make_robot(**AT_ONCE), OPEN, [[0.0, 0.0, 0.0]])
    drive(sim, asked, 5)
    assert sim.state.twist[0].tolist() == list(given)


@pytest.mark.parametrize("w", [1.5, -1.5])
def test_yaw_stays_within_a_turn(make_robot, simulate, w: float) -> None:
    sim = simulate(make_robot(**AT_ONCE), OPEN, [[0.0, 0.0, y] for y in (-np.pi, 0.0, 3.1415)])
    yaws = []
    for _ in range(100):
        drive(sim, (0.1, w), 1)
        yaws.append(sim.state.pose[:, 2].copy())
    yaws = np.array(yaws)
    assert ((yaws >= -np.pi) & (yaws < np.pi)).all()
    # 10 s at 1.5 rad/s are two turns and more: each half is visited.
    assert (yaws.min(axis=0) < -2.9).all()
    assert (yaws.max(axis=0) > 2.9).all()


def test_robots_do_not_influence_each_other(make_robot, simulate) -> None:
    robot = make_robot()
    poses = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
    together, alone = simulate(robot, OPEN, poses), simulate(robot, OPEN, poses[:1])
    for _ in range(20):
        together.step(np.array([[0.4, 0.3], [-0.2, -1.0], [0.5, 1.5]]))
        alone.step(np.array([[0.4, 0.3]]))
    assert together.state.pose[0].tolist() == alone.state.pose[0].tolist()


def test_commands_of_any_kind_of_array_and_of_no_other_shape(make_robot, simulate) -> None:
    poses, robot = np.zeros((3, 3)), make_robot()
    command = np.array([[0.5, 0.25], [0.125, -1.0], [0.25, 0.0]])
    kinds = (
        command,
        command.tolist(),
        command.astype(np.float32),
        np.asfortranarray(command),
        np.repeat(command, 2, axis=0)[::2],
    )
    ends = []
    for kind in kinds:
        sim = simulate(robot, OPEN, poses)
        sim.step(np.zeros((3, 2)))
        sim.step(kind)
        ends.append(sim.state.pose.copy())
    assert all(np.array_equal(end, ends[0]) for end in ends)
    for wrong in (command[:2], command[:, 0], command[None]):
        with pytest.raises(ValueError, match="command: shape"):
            sim.step(wrong)
