# SPDX-License-Identifier: Apache-2.0
"""Bases that go in any direction, in the plane."""

from __future__ import annotations

import numpy as np
import pytest

from pm01_nav.geometry import rectangle
from pm01_nav.worlds.world import World

OPEN = World("open", (-5.0, -5.0, 5.0, 5.0))
AT_ONCE = {
    "limits": {
        "linear_acceleration": 1e9,
        "lateral_acceleration": 1e9,
        "angular_acceleration": 1e9,
    },
    "actuator": {"lag_s": 0.0},
}


@pytest.fixture
def omni(make_robot):
    return lambda **changes: make_robot("omni_disc", **changes)


def drive(sim, command, steps: int) -> None:
    commands = np.tile(np.asarray(command, dtype=np.float64), (sim.num_envs, 1))
    for _ in range(steps):
        sim.step(commands)


def test_goes_sideways_as_seen_from_the_robot(omni, simulate) -> None:
    sim = simulate(omni(**AT_ONCE), OPEN, [[0.0, 0.0, np.pi / 2]])
    drive(sim, (0.0, 0.4, 0.0), 1)  # under way
    x, y, _ = sim.state.pose[0]
    drive(sim, (0.0, 0.4, 0.0), 10)
    # It faces north, so its left is west: 0.4 m/s for 1 s.
    assert sim.state.pose[0] == pytest.approx([x - 0.4, y, np.pi / 2], abs=1e-12)
    assert sim.state.twist[0].tolist() == [0.0, 0.4, 0.0]


def test_steady_twist_follows_its_circle(omni, simulate) -> None:
    v, u, w = 0.2, -0.3, 1.0
    sim = simulate(omni(**AT_ONCE), OPEN, [[0.5, -1.0, 0.7]])
    drive(sim, (v, u, w), 1)
    x, y, yaw = sim.state.pose[0]
    drive(sim, (v, u, w), 15)
    # The instantaneous centre lies at (-u / w, v / w) in base_link; about it all turns by w t.
    cos, sin = np.cos(yaw), np.sin(yaw)
    centre = np.array([x + cos * -u - sin * v, y + sin * -u + cos * v])
    arm, a = np.array([x, y]) - centre, 1.5 * w
    turned = [np.cos(a) * arm[0] - np.sin(a) * arm[1], np.sin(a) * arm[0] + np.cos(a) * arm[1]]
    assert sim.state.pose[0, :2] == pytest.approx(centre + turned, abs=1e-9)
    assert sim.state.pose[0, 2] == pytest.approx(yaw + 1.5, abs=1e-9)


@pytest.mark.parametrize(
    ("shape", "asked", "given"),
    [
        ("ellipse", (0.5, 0.5, 0.0), (0.5 / np.sqrt(2.0), 0.5 / np.sqrt(2.0), 0.0)),
        ("ellipse", (0.3, -0.4, 2.0), (0.3, -0.4, 1.5)),  # On the circle of 0.5 m/s.
        ("ellipse", (-9.0, 0.0, 0.0), (-0.5, 0.0, 0.0)),
        ("box", (0.5, 0.5, -9.0), (0.5, 0.5, -1.5)),
    ],
)
def test_limits_by_hand(omni, simulate, shape, asked, given) -> None:
    robot = omni(limits={**AT_ONCE["limits"], "shape": shape}, actuator={"lag_s": 0.0})
    sim = simulate(robot, OPEN, [[0.0, 0.0, 0.0]])
    drive(sim, asked, 3)
    assert sim.state.twist[0] == pytest.approx(given, abs=1e-12)


def test_kernel_and_drive_agree_on_what_the_base_follows(omni, simulate) -> None:
    commands = np.random.default_rng(2).uniform(-1.0, 1.0, (64, 3)) * [0.8, 0.8, 2.0]
    for low in (-0.2, 0.0):
        limits = {**AT_ONCE["limits"], "linear_min": low, "lateral_max": 0.3}
        robot = omni(limits=limits, actuator={"lag_s": 0.0})
        sim = simulate(robot, OPEN, np.zeros((64, 3)))
        sim.step(commands)
        assert sim.state.twist == pytest.approx(robot.base.clip(commands), abs=1e-12)


def test_acceleration_to_the_side_has_its_own_limit(omni, simulate) -> None:
    limits = {"linear_acceleration": 1.0, "lateral_acceleration": 0.4}
    sim = simulate(omni(limits=limits, actuator={"lag_s": 0.0}), OPEN, [[0.0, 0.0, 0.0]])
    drive(sim, (0.2, 0.3, 0.0), 1)
    assert sim.state.twist[0] == pytest.approx([0.1, 0.04, 0.0], abs=1e-12)


def test_a_wall_to_the_left_stops_it(omni, simulate) -> None:
    wall = World("wall", OPEN.bounds, polygons=(rectangle(0.0, 1.5, 2.0, 1.0),))
    sim = simulate(omni(**AT_ONCE), wall, [[0.0, 0.0, 0.0]])
    drive(sim, (0.0, 0.5, 0.0), 30)
    assert sim.state.contact[0]
    # The disc of 0.17 m touches at y = 0.83; integration steps are 2.5 cm long.
    assert 0.83 - 0.026 <= sim.state.pose[0, 1] <= 0.83
    assert sim.state.twist[0].tolist() == [0.0, 0.0, 0.0]


def test_errors_of_the_wheels_and_of_odometry(omni, simulate) -> None:
    errors = {
        "wheel_left_factor": 0.9,
        "wheel_right_factor": 1.1,
        "slip": 0.0,
        "odometry_scale": 1.05,
    }
    robot = omni(**AT_ONCE)
    sim = simulate(robot, OPEN, [[0.0, 0.0, 0.0]], errors=errors)
    drive(sim, (0.2, 0.1, 0.0), 2)
    # Without a pair of wheels the sides are as far apart as the footprint is wide, 0.34 m:
    # forwards 0.2 x (0.9 + 1.1) / 2, to the side likewise, the turn 0.2 x (1.1 - 0.9) / 0.34.
    expected = [0.2, 0.1, 0.04 / 0.34]
    assert sim.state.twist[0] == pytest.approx(expected, abs=1e-12)
    assert sim.measured_twist[0] == pytest.approx([0.21, 0.105, 0.04 / 0.34], abs=1e-12)


def test_commands_of_another_drive_are_refused(omni, simulate) -> None:
    sim = simulate(omni(), OPEN, [[0.0, 0.0, 0.0]])
    with pytest.raises(ValueError, match=r"shape \(1, 2\), needs \(1, 3\)"):
        sim.step([[0.1, 0.0]])
