# SPDX-License-Identifier: Apache-2.0
"""A base that does not do what its controller thinks, by hand."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from pm01_nav.worlds.world import World

OPEN = World("open", (-5.0, -5.0, 5.0, 5.0))
AT_ONCE = {
    "limits": {"linear_acceleration": 1e9, "angular_acceleration": 1e9},
    "actuator": {"lag_s": 0.0},
}
ORIGIN = [0.0, 0.0, 0.0]


def drive(sim, command, steps: int) -> None:
    for _ in range(steps):
        sim.step(np.tile(np.asarray(command, dtype=np.float64), (sim.num_envs, 1)))


def speeds(sim, command, steps: int) -> NDArray[np.float64]:
    """Return the true twists after each step of one command, shape (steps, num_envs, 2)."""
    rows = []
    for _ in range(steps):
        drive(sim, command, 1)
        rows.append(sim.state.twist.copy())
    return np.array(rows)


def test_larger_right_wheel_drives_an_arc(make_robot, simulate) -> None:
    sim = simulate(make_robot(**AT_ONCE), OPEN, ORIGIN, {"wheel_right_factor": 1.02})
    sim.state.twist[0] = [0.505, 0.01 / 0.28]  # Already under way.
    drive(sim, [0.5, 0.0], 10)
    # The left wheel travels at 0.5 m/s, the right one at 0.51 m/s, 0.28 m apart:
    # v = 0.505 m/s, w = 0.01 / 0.28 = 0.0357143 rad/s, for 1 s on a radius of 14.14 m.
    v, w = 0.505, 0.01 / 0.28
    expected = [v / w * np.sin(w), v / w * (1 - np.cos(w)), w]
    assert sim.state.pose[0] == pytest.approx(expected, abs=1e-12)
    assert sim.state.twist[0] == pytest.approx([v, w])


def test_both_wheels_larger_by_the_same_scale_everything(make_robot, simulate) -> None:
    errors = {"wheel_left_factor": 1.1, "wheel_right_factor": 1.1}
    sim = simulate(make_robot(**AT_ONCE), OPEN, ORIGIN, errors)
    # Commands are kept within the limits before the wheels' errors: 0.5 m/s and 1.5 rad/s.
    drive(sim, [0.9, 2.0], 1)
    assert sim.state.twist[0] == pytest.approx([0.55, 1.65])


def test_wider_wheels_turn_slower(make_robot, simulate) -> None:
    sim = simulate(make_robot(**AT_ONCE), OPEN, ORIGIN, {"wheel_separation_factor": 1.25})
    drive(sim, [0.3, 1.0], 1)
    assert sim.state.twist[0] == pytest.approx([0.3, 0.8])


@pytest.mark.parametrize(
    ("delay_s", "dt", "steps"),
    [(0.0, 0.1, 0), (0.1, 0.1, 1), (0.2, 0.1, 2), (0.3, 0.1, 3), (0.2, 0.05, 4), (0.1, 0.02, 5)],
)
def test_command_comes_late(make_robot, simulate, delay_s: float, dt: float, steps: int) -> None:
    errors = {"command_delay_s": delay_s}
    sim = simulate(make_robot(**AT_ONCE), OPEN, ORIGIN, errors, control_dt=dt)
    given = [0.1, 0.2, 0.3, 0.4, 0.5, -0.1, 0.1, 0.2]
    answered = []
    for speed in given:
        drive(sim, [speed, -speed], 1)
        answered.append(sim.state.twist[0].tolist())
    expected = [0.0] * steps + given[: len(given) - steps]
    assert np.array(answered) == pytest.approx(np.array([[v, -v] for v in expected]))


@pytest.mark.parametrize("dt", [0.1, 0.02])
def test_a_delay_costs_the_same_travel_whatever_a_step_takes(make_robot, simulate, dt) -> None:
    sim = simulate(make_robot(**AT_ONCE), OPEN, ORIGIN, {"command_delay_s": 0.13}, control_dt=dt)
    drive(sim, [0.4, 0.0], round(1.0 / dt))
    # At 0.4 m/s from 0.13 s on, which are 1.3 steps of 0.1 s, or 6.5 of 0.02 s: 0.348 m. The base
    # changes its speed within one integration step, half a control step, at whose mean it drives:
    # it loses a quarter of a control step each time, here once in all.
    assert sim.state.pose[0, 0] == pytest.approx(0.4 * (1.0 - 0.13 - 0.25 * dt), abs=1e-9)


def test_between_two_commands_the_base_is_told_their_mean(make_robot, simulate) -> None:
    sim = simulate(make_robot(**AT_ONCE), OPEN, ORIGIN, {"command_delay_s": 0.125})
    answered = []
    for speed in [0.1, 0.4, 0.9, 0.2]:
        drive(sim, [speed, 0.0], 1)
        answered.append(float(sim.state.twist[0, 0]))
    # In each step the command before the last counts for 0.025 s, the last one for 0.075 s:
    # 0; 0.75 x 0.1; 0.25 x 0.1 + 0.75 x 0.4; 0.25 x 0.4 + 0.75 x 0.5, the limit.
    assert answered == pytest.approx([0.0, 0.075, 0.325, 0.475])


def test_whole_steps_late_is_bit_by_bit_the_same_drive_later(make_robot, simulate) -> None:
    rng = np.random.default_rng(3)
    commands = rng.uniform([-0.3, -1.0], [0.7, 1.0], (12, 2))
    late = simulate(make_robot(), OPEN, ORIGIN, {"command_delay_s": 0.3})
    plain = simulate(make_robot(), OPEN, ORIGIN, {})
    for command in [*commands, *np.zeros((3, 2))]:
        drive(late, command, 1)
    for command in [*np.zeros((3, 2)), *commands]:
        drive(plain, command, 1)
    assert late.state.pose.tobytes() == plain.state.pose.tobytes()


def test_command_on_its_way_ends_with_the_episode(make_robot, simulate) -> None:
    sim = simulate(make_robot(**AT_ONCE), OPEN, [ORIGIN, ORIGIN], {"command_delay_s": 0.2})
    drive(sim, [0.5, 0.0], 3)
    sim.reset(np.array([1]))
    drive(sim, [0.5, 0.0], 1)
    assert sim.state.twist[:, 0] == pytest.approx([0.5, 0.0])


def test_delays_differ_between_robots(make_robot, simulate) -> None:
    errors = {"command_delay_s": (0.0, 0.4)}
    sim = simulate(make_robot(**AT_ONCE), OPEN, np.zeros((400, 3)), errors)
    moving = (speeds(sim, [0.5, 0.0], 4)[:, :, 0] > 0.0).mean(axis=1)
    # A quarter more starts in each step; 4 sigma are at most 4 x 0.5 / 20 = 0.1.
    assert moving == pytest.approx([0.25, 0.5, 0.75, 1.0], abs=0.1)


def test_slip_loses_travel(make_robot, simulate) -> None:
    sim = simulate(make_robot(**AT_ONCE), OPEN, ORIGIN, {"slip": 0.1})
    sim.state.twist[0] = [0.45, 0.0]  # Already under way.
    drive(sim, [0.5, 0.0], 10)
    assert sim.state.pose[0] == pytest.approx([0.45, 0.0, 0.0], abs=1e-12)


def test_noise_of_slip(make_robot, simulate) -> None:
    sim = simulate(
        make_robot(**AT_ONCE), OPEN, np.zeros((500, 3)), {"slip": 0.2, "slip_noise": 0.1}
    )
    v, w = np.moveaxis(speeds(sim, [0.5, 0.0], 20), -1, 0)
    # A wheel loses U(0.1, 0.3) of 0.5 m/s: mean 0.4 m/s, deviation 0.5 x 0.2 / sqrt(12) = 0.028868.
    # v is the mean of two wheels, deviation 0.020412; w their difference over 0.28 m, 0.145802.
    n = v.size
    assert v.mean() == pytest.approx(0.4, abs=4 * 0.020412 / np.sqrt(n))
    assert v.std() == pytest.approx(0.020412, rel=4 / np.sqrt(2 * n))
    assert w.mean() == pytest.approx(0.0, abs=4 * 0.145802 / np.sqrt(n))
    assert w.std() == pytest.approx(0.145802, rel=4 / np.sqrt(2 * n))
    assert v.min() >= 0.35
    assert v.max() <= 0.45


def test_slip_never_gains_travel(make_robot, simulate) -> None:
    sim = simulate(make_robot(**AT_ONCE), OPEN, np.zeros((200, 3)), {"slip_noise": 0.2})
    v = speeds(sim, [0.5, 0.0], 1)[0, :, 0]
    assert v.max() <= 0.5
    assert (v < 0.5).any()


def test_jitter_of_the_control_period(make_robot, simulate) -> None:
    sim = simulate(make_robot(**AT_ONCE), OPEN, np.zeros((5000, 3)), {"control_jitter": 0.2})
    sim.state.twist[:] = [0.5, 0.0]  # Already under way.
    drive(sim, [0.5, 0.0], 1)
    travelled = sim.state.pose[:, 0]
    # 0.05 m x U(0.8, 1.2): mean 0.05, deviation 0.05 x 0.4 / sqrt(12) = 0.0057735.
    assert travelled.min() >= 0.04
    assert travelled.max() <= 0.06 + 1e-12
    assert travelled.mean() == pytest.approx(0.05, abs=4 * 0.0057735 / np.sqrt(5000))
    assert travelled.std() == pytest.approx(0.0057735, rel=4 / np.sqrt(2 * 5000))


def test_heavy_robot_accelerates_slower(make_robot, simulate) -> None:
    robot = make_robot(actuator={"lag_s": 0.0})
    sim = simulate(robot, OPEN, ORIGIN, {"acceleration_factor": 0.5})
    drive(sim, [0.5, 1.5], 1)
    # Half of 2 m/s^2 and of 8 rad/s^2, for 0.1 s.
    assert sim.state.twist[0] == pytest.approx([0.1, 0.4])


def test_lag_replaces_the_robots_own(make_robot, simulate) -> None:
    robot = make_robot(limits=AT_ONCE["limits"], actuator={"lag_s": 0.05})
    # After one time constant of 0.1 s 1 - 1/e of the step is done; the robot's own does 1 - 1/e^2.
    for lag, left in ((0.1, np.exp(-1)), (None, np.exp(-2)), (0.0, 0.0)):
        errors = {} if lag is None else {"actuator_lag": lag}
        sim = simulate(robot, OPEN, ORIGIN, errors)
        drive(sim, [0.5, 1.0], 1)
        assert sim.state.twist[0] == pytest.approx([0.5 * (1 - left), 1 - left], abs=1e-12)
