# SPDX-License-Identifier: Apache-2.0
"""Drives of bases that are known, with what real recordings have: spikes, gaps, limits, rests."""

from __future__ import annotations

import numpy as np
import pytest

from pm01_nav.deploy.base_fit import fit_base, fit_drives
from pm01_nav.deploy.base_model import prepare
from pm01_nav.deploy.base_rows import commands_known
from pm01_nav.deploy.identification import identified_ranges, identified_robot
from pm01_nav.robot import load_robot
from pm01_nav.task.randomization import RandomizationConfig

PROGRAM = ((1.0, 0.0), (0.0, 0.8), (0.0, 0.0), (-1.0, 0.0), (0.0, -0.8), (1.0, 0.4))


def driven(ask, limit, seconds=70.0, acceleration=(1.0, 3.0)):
    """Commands at 10 Hz and odometry at 20 Hz of a base without lag, in steps of 1 ms.

    Its program goes ahead, turns, rests, goes back, turns and drives an arc, 2.5 s each; ``ask``
    is the speed asked for and ``limit`` what the base gives.
    """
    times, speeds, v, w = np.arange(0.0, seconds, 0.001), [], 0.0, 0.0
    most = 0.001 * acceleration[0], 0.001 * acceleration[1]
    for t in times.tolist():
        ahead, turn = PROGRAM[int(t / 2.5) % 6]
        v += min(max(min(max(ahead * ask, -limit), limit) - v, -most[0]), most[0])
        w += min(max(turn - w, -most[1]), most[1])
        speeds.append((v, w))
    sent = np.arange(0.0, seconds, 0.1)
    asked = [PROGRAM[int((t + 1e-9) / 2.5) % 6] for t in sent]
    commands = np.array([(t, v * ask, w) for t, (v, w) in zip(sent, asked, strict=True)])
    odometry = np.c_[times + 0.001, speeds][::50]
    odometry[:, 1:] += np.random.default_rng(0).normal(0.0, [0.005, 0.01], (len(odometry), 2))
    return commands, odometry


@pytest.fixture(scope="module")
def slow_robot():
    """A robot that is described with 0.3 m/s."""
    robot = load_robot("pm01")
    limits = robot.limits.model_copy(update={"linear_max": 0.3, "linear_min": -0.3})
    return robot.model_copy(update={"limits": limits})


def holds(estimate, truth):
    return estimate.low <= truth <= estimate.high


@pytest.mark.parametrize("name", ["turtlebot3_waffle", "pm01"])
def test_a_ramp_is_found_whatever_the_robot_file_says(name):
    # 0.6 m/s is more than either robot is described with; 3 rad/s^2 is the turtlebot's limit.
    fit = fit_base(*driven(0.6, 0.6), load_robot(name))
    for factor in ("wheel_left_factor", "wheel_right_factor", "wheel_separation_factor"):
        assert fit.estimates[factor].value == pytest.approx(1.0, abs=0.01), factor
    assert fit.estimates["linear_acceleration"].value == pytest.approx(1.0, rel=0.02)
    assert fit.estimates["angular_acceleration"].value == pytest.approx(3.0, rel=0.03)
    for time in ("command_delay_s", "actuator_lag"):
        assert holds(fit.estimates[time], 0.0), time
        assert fit.estimates[time].high < 0.03, time


def test_commands_beyond_the_limit_show_the_limit_and_no_scale(slow_robot):
    fit = fit_base(*driven(0.5, 0.3), slow_robot)
    shown = {name: one for name, one in fit.estimates.items() if name not in fit.not_shown}
    for limit in ("linear_max", "linear_min"):
        assert holds(shown[limit], 0.3), limit
    assert "limit of speed" in fit.not_shown["wheel_left_factor"]
    assert fit.estimates["wheel_left_factor"].value == pytest.approx(1.0, abs=0.01)
    # 0.8 rad/s was asked for and driven.
    assert "angular_max" in fit.not_shown
    robot = identified_robot(slow_robot, shown)
    assert robot["limits"]["linear_min"] == pytest.approx(-0.3, rel=0.02)
    ranges = RandomizationConfig.model_validate(identified_ranges(slow_robot, shown))
    assert ranges.wheel_left_factor == (1.0, 1.0)


def test_spikes_a_gap_and_a_robot_that_was_held_are_left_out(slow_robot):
    commands, odometry = driven(0.3, 0.3)
    odometry[[250, 500, 900], 1:] = 3.4, -1.1
    # From 46.2 to 49.8 s, driving back and turning, somebody holds it.
    held = (odometry[:, 0] > 46.2) & (odometry[:, 0] < 49.8)
    odometry[held, 1:] = 0.0
    # From 16 to 19 s, driving ahead, no command comes: it stops half a second after the last one.
    commands = commands[(commands[:, 0] < 16.0) | (commands[:, 0] > 19.0)]
    odometry[(odometry[:, 0] > 16.5) & (odometry[:, 0] < 19.0), 1:] = 0.0
    fit = fit_base(commands, odometry, slow_robot)
    assert fit.spikes == 3
    assert not fit.used[[250, 500, 900]].any()
    assert fit.used.mean() > 0.8
    reasons = {segment.reason: segment for segment in fit.segments}
    assert set(reasons) == {"no commands came", "did not follow its commands"}
    assert 16.0 < reasons["no commands came"].begin < reasons["no commands came"].end < 20.2
    assert 44.0 <= reasons["did not follow its commands"].begin < 49.0
    for name in ("wheel_left_factor", "wheel_right_factor", "wheel_separation_factor"):
        assert holds(fit.estimates[name], 1.0), name


def test_a_base_that_drives_on_without_commands_is_believed(slow_robot):
    commands, odometry = driven(0.3, 0.3)
    # Commands come when they change, and half a second long.
    commands = commands[(commands[:, 0] + 1e-9) % 2.5 < 0.5]
    fit = fit_base(commands, odometry, slow_robot)
    assert fit.segments == ()
    assert fit.used.all()
    assert holds(fit.estimates["wheel_left_factor"], 1.0)


def test_several_drives_tell_more_than_each():
    ahead, turning = driven(0.3, 0.3, 40.0), driven(0.0, 0.3, 40.0)
    straight = tuple(rows * [1.0, 1.0, 0.0] for rows in ahead)
    robot = load_robot("pm01")
    assert "wheel_separation_factor" in fit_base(*straight, robot).not_shown
    assert "wheel_left_factor" in fit_base(*turning, robot).not_shown
    both = fit_drives([straight, turning], robot)
    assert holds(both.estimates["wheel_left_factor"], 1.0)
    assert holds(both.estimates["wheel_separation_factor"], 1.0)
    assert not {"wheel_left_factor", "wheel_separation_factor"} & both.not_shown.keys()


def test_a_rest_without_commands_is_known():
    # A stop, then nothing for 5 s: it rests. A speed, then nothing: nobody knows.
    for last, known in ((0.0, True), (0.2, False)):
        commands = [(0.1 * k, 0.2, 0.0) for k in range(10)] + [(1.0, last, 0.0), (6.0, 0.2, 0.0)]
        times = np.array([0.2, 1.7, 5.0])
        drive = prepare(np.array(commands), np.c_[times, np.zeros((3, 2))], 0.3)
        assert commands_known(drive).tolist() == [True, True, known]


@pytest.mark.slow
def test_intervals_hold_the_truth(benchmark_script):
    judge = benchmark_script("identification_coverage").judge
    drives = [judge(seed) for seed in range(12)]
    rows = [row for one in drives for row in one.values() if isinstance(row, dict)]
    shown = [row for row in rows if row["shown"]]
    assert len(shown) > 0.6 * len(rows)
    # 95 % are meant; 12 drives have some 100 of them: binomially 90 % is two sigma away.
    assert sum(row["holds"] for row in shown) >= 0.9 * len(shown)
