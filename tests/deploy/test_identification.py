# SPDX-License-Identifier: Apache-2.0
"""Robots whose faults are known, recorded, read again, and recognised."""

from __future__ import annotations

import json
import math
from types import SimpleNamespace

import numpy as np
import pytest

from pm01_nav.config import validate
from pm01_nav.deploy.base_fit import Estimate, fit_base
from pm01_nav.deploy.identification import identified_ranges, identify
from pm01_nav.deploy.lidar_fit import at_rest, fit_noise
from pm01_nav.deploy.messages import Scan, from_json, odometry_from_ros
from pm01_nav.deploy.recording import Recording
from pm01_nav.deploy.scan_matching import match
from pm01_nav.errors import InputError
from pm01_nav.geometry import to_frame
from pm01_nav.task.randomization import RandomizationConfig


def answer(commands, dt, *, delay, lag, acceleration, gain):
    """A base by other means: exact exponentials between samples of 1 ms."""
    times = np.arange(0.0, commands[-1][0], 0.001)
    speed, out = np.zeros(2), []
    at = 0
    for t in times:
        while at + 1 < len(commands) and commands[at + 1][0] <= t - delay + 1e-12:
            at += 1
        wanted = gain @ np.array(commands[at][1:]) if commands[at][0] <= t - delay else np.zeros(2)
        step = (wanted - speed) * (1.0 - math.exp(-0.001 / lag))
        speed = speed + np.clip(step, -0.001 * acceleration, 0.001 * acceleration)
        out.append((t + 0.001, *speed))
    return np.array(out)[:: round(dt / 0.001)]


def test_a_base_with_known_faults_is_recognised(robot):
    rng = np.random.default_rng(4)
    commands = []
    for k in range(400):
        if k % 8 == 0:
            command = rng.uniform([-0.2, -1.5], [0.5, 1.5]) if rng.random() > 0.2 else (0.0, 0.0)
        commands.append((0.1 * k, *command))
    # Left wheel 3 % small, right 2 % large, separation 5 % large, by the equations of a
    # differential drive: v = (l + r) / 2 and w = (r - l) / (1.05 b), where l = 0.97 (v - b w / 2).
    left, right, factor, b = 0.97, 1.02, 1.05, robot.wheels.separation
    gain = np.array(
        [
            [0.5 * (left + right), 0.25 * b * (right - left)],
            [(right - left) / (factor * b), 0.5 * (left + right) / factor],
        ]
    )
    acceleration = np.array([0.8, 4.0])
    odometry = answer(commands, 0.02, delay=0.13, lag=0.09, acceleration=acceleration, gain=gain)
    odometry[:, 1:] += rng.normal(0.0, [0.004, 0.01], (len(odometry), 2))
    fit = fit_base(np.array(commands), odometry, robot)
    true = {
        "wheel_left_factor": 0.97,
        "wheel_right_factor": 1.02,
        "wheel_separation_factor": 1.05,
        "command_delay_s": 0.13,
        "actuator_lag": 0.09,
        "linear_acceleration": 0.8,
        "angular_acceleration": 4.0,
    }
    for name, value in true.items():
        found = fit.estimates[name]
        # Within 3 % or, for the delay, the step of the model; intervals are narrow, not wild.
        assert found.value == pytest.approx(value, rel=0.03, abs=0.005), name
        assert found.high - found.low < 0.15 * value, name


def test_ranges_of_what_was_identified_are_in_seconds(robot):
    names = ("wheel_left_factor", "wheel_right_factor", "wheel_separation_factor")
    found = {name: Estimate(1.0, 0.99, 1.01) for name in names}
    found |= {"actuator_lag": Estimate(0.1, 0.08, 0.12)}
    # Neither rounded to control steps nor cut off after three of them.
    for low, high, expected in ((0.43, 0.47, [0.43, 0.47]), (-0.01, 1.5, [0.0, 1.0])):
        delay = {"command_delay_s": Estimate(0.45, low, high)}
        ranges = identified_ranges(robot, found | delay)
        assert ranges["command_delay_s"] == expected
        assert validate(RandomizationConfig, ranges, "ranges").command_delay_s == tuple(expected)


@pytest.mark.slow
def test_a_robot_of_mujoco_is_recognised_from_its_recording(benchmark_script):
    """Physics, noise on all that is measured, the supervisor and an MCAP file in between."""
    pytest.importorskip("mujoco")
    pytest.importorskip("rosbags")
    rows = benchmark_script("identification").recover(seed=0, seconds=120.0)
    tolerances = {
        # Wheels that slip and tyres that give, beside what the model knows.
        "wheel_left_factor": 0.01,
        "wheel_right_factor": 0.01,
        "wheel_separation_factor": 0.01,
        # A tick of the simulator's wheel controller.
        "command_delay_s": 0.02,
        "actuator_lag": 0.01,
        "linear_acceleration": 0.1,
        "angular_acceleration": 0.3,
        "lidar_noise_std": 0.001,
        "lidar_dropout": 0.01,
        "travel_scale": 0.01,
    }
    for name, tolerance in tolerances.items():
        assert rows[name]["found"] == pytest.approx(rows[name]["true"], abs=tolerance), name


def test_rest_is_told_by_where_odometry_is_not_by_its_noisy_speed(make_scan):
    rng = np.random.default_rng(0)
    times = np.arange(0.0, 2.0, 0.02)
    odometry = np.zeros((len(times), 6))
    odometry[:, 0] = times
    odometry[:, 1:3] = rng.normal(0.0, 0.01, (len(times), 2))
    # From 1 s on it creeps at 2 cm/s: three scans and the time they take are 6 mm apart.
    odometry[times >= 1.0, 3] = 0.02 * (times[times >= 1.0] - 1.0)
    scans = [make_scan(0.1 * k, 1.0) for k in range(20)]
    found = [triple[0].stamp for triple in at_rest(scans, odometry)]
    assert found
    # A triple that ends with its scan at 0.9 s, which takes until 1 s, is the last one.
    assert max(found) == pytest.approx(0.7)


def test_limits_that_were_never_reached_are_not_known(robot):
    commands = [(0.1 * k, 0.02 * (k // 10 % 2), 0.0) for k in range(300)]
    acceleration = np.array([50.0, 50.0])
    gain = np.eye(2)
    odometry = answer(commands, 0.02, delay=0.05, lag=0.1, acceleration=acceleration, gain=gain)
    fit = fit_base(np.array(commands), odometry, robot)
    found = fit.estimates["linear_acceleration"]
    assert not (found.low > 0.0 and found.high / found.low < 3.0)


def scans_at_rest(lost: float) -> list[Scan]:
    """Return scans with errors N(0, 0.01^2 + (0.02 r)^2), 5 % of their returns ``lost``."""
    rng = np.random.default_rng(1)
    exact, scans = np.linspace(0.3, 4.0, 360), []
    for k in range(120):
        ranges = exact + rng.normal(0.0, np.hypot(0.01, 0.02 * exact))
        ranges[rng.random(360) < 0.05] = lost
        values = ranges.astype(np.float32)
        scans.append(Scan(0.1 * k, -np.pi, np.pi / 180, 0.1, 6.0, values))
    return scans


@pytest.mark.parametrize("zero_means", [None, "no_return"])
def test_noise_and_dropout_of_a_lidar_at_rest(robot, zero_means):
    scans = scans_at_rest(np.inf if zero_means is None else 0.0)
    if zero_means is None:
        found = fit_noise(list(zip(scans, scans[1:], scans[2:], strict=False)))
    else:
        # The whole way: a drive of 8 s, and 12 s at rest with scans. A 0 is no return.
        commands = [(0.1 * k - 8.0, 0.1 if 0 < k < 60 else 0.0, 0.0) for k in range(200)]
        shifted = [(t + 8.0, v, w) for t, v, w in commands]
        limits = {"acceleration": np.array([0.8, 4.0]), "gain": np.eye(2)}
        base = answer(shifted, 0.02, delay=0.1, lag=0.1, **limits)
        x = np.cumsum(base[:, 1]) * 0.02
        odometry = np.zeros((len(base), 6))
        odometry[:, 0], odometry[:, 1:3], odometry[:, 3] = base[:, 0] - 8.0, base[:, 1:3], x
        lidar = robot.lidar.model_copy(update={"zero_means": zero_means})
        told = robot.model_copy(update={"lidar": lidar})
        found = identify(Recording(np.array(commands), odometry, scans), told).estimates
    assert found["lidar_noise_std"].value == pytest.approx(0.01, rel=0.15)
    assert found["lidar_noise_share"].value == pytest.approx(0.02, rel=0.05)
    assert found["lidar_dropout"].low <= 0.05 <= found["lidar_dropout"].high


def test_scans_of_a_room_tell_how_the_robot_moved():
    # A room of 4 m x 3 m, seen from two places by its walls' points.
    x, y = np.linspace(-2.0, 2.0, 161), np.linspace(-1.5, 1.5, 121)
    sides = [(x, -1.5 + 0 * x), (2.0 + 0 * y, y), (x[::-1], 1.5 + 0 * x), (-2.0 + 0 * y, y[::-1])]
    room = np.concatenate([np.stack(side, axis=-1) for side in sides])
    first, moved = np.array([0.1, 0.2, 0.3]), np.array([0.25, -0.03, 0.2])
    second = np.array(
        [
            0.1 + 0.25 * math.cos(0.3) + 0.03 * math.sin(0.3),
            0.2 + 0.25 * math.sin(0.3) - 0.03 * math.cos(0.3),
            0.5,
        ]
    )
    found = match(
        to_frame(room, first), to_frame(room, second), moved + np.array([0.03, 0.03, -0.04])
    )
    assert found == pytest.approx(moved, abs=2e-3)


def test_json_without_numbers_for_infinity():
    message = from_json({"ranges": [1.0, None], "header": {"stamp": {"sec": 1, "nanosec": 5}}})
    assert message.ranges == [1.0, math.inf]
    assert message.header.stamp.nanosec == 5
    assert json.dumps(message.ranges[0]) == "1.0"


def test_odometry_by_ros_field_names():
    ns = SimpleNamespace
    message = ns(
        header=ns(stamp=ns(sec=3, nanosec=250_000_000), frame_id="laser"),
        pose=ns(
            pose=ns(
                position=ns(x=1.0, y=2.0, z=0.0),
                # 90 deg about z: (0, 0, sin 45 deg, cos 45 deg).
                orientation=ns(x=0.0, y=0.0, z=math.sqrt(0.5), w=math.sqrt(0.5)),
            )
        ),
        twist=ns(twist=ns(linear=ns(x=0.2), angular=ns(z=-0.1))),
    )
    ours = odometry_from_ros(message)
    assert ours.stamp == 3.25
    assert ours.pose == pytest.approx([1.0, 2.0, math.pi / 2])
    assert ours.twist == pytest.approx([0.2, -0.1])


def test_a_recording_comes_back_and_strange_folders_are_refused(tmp_path, make_scan, make_odometry):
    pytest.importorskip("rosbags")
    from pm01_nav.deploy.recording import Recorder, read_recording

    recorder = Recorder(tmp_path / "drive")
    for k in range(3):
        now = 5.0 + 0.1 * k
        # The robot's clock is 2 s ahead; messages take 0.02 s, the second one 0.05 s.
        late = 0.05 if k == 1 else 0.02
        recorder.odometry(make_odometry(now + 2.0, 0.1 * k, pose=(k, 0.0, 1.0)), now + late)
        recorder.scan(make_scan(now + 2.0, 1.5), now + late)
        recorder.command((0.3, -0.1), now)
    recorder.close()
    recording = read_recording(tmp_path / "drive")
    assert recording.commands[:, 1:] == pytest.approx(np.tile([0.3, -0.1], (3, 1)))
    # By the stamps, moved to the bag's clock by the quickest message.
    assert recording.odometry[:, 0] == pytest.approx([5.02, 5.12, 5.22], abs=1e-6)
    assert recording.odometry[2] == pytest.approx([5.22, 0.2, 0.0, 2.0, 0.0, 1.0], abs=1e-6)
    assert recording.scans[0].ranges == pytest.approx(np.full(360, 1.5))
    with pytest.raises(InputError, match="cannot be written"):
        Recorder(tmp_path / "drive")
    with pytest.raises(InputError, match="has no messages on /lidar"):
        read_recording(tmp_path / "drive", scan="/lidar")
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="no readable rosbag2 folder"):
        read_recording(tmp_path / "empty")
