# SPDX-License-Identifier: Apache-2.0
"""Spinning: more than two full turns to one side on the spot."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pm01_nav.task.spinning import SpinMeter


def poses(x, yaw):
    return np.array([[x, 0.0, (yaw + math.pi) % (2 * math.pi) - math.pi]])


def drive(xs, yaws):
    meter = SpinMeter(poses(xs[0], yaws[0]))
    for x, yaw in zip(xs[1:], yaws[1:], strict=True):
        meter.note(poses(x, yaw))
    return meter.share()


def test_turning_on_the_spot_counts_from_the_third_turn():
    # 40 steps of 36 degrees are four turns; the first twenty steps are two, and do not count.
    yaws = [0.2 * math.pi * k for k in range(41)]
    assert drive([0.0] * 41, yaws) == pytest.approx(20 / 40, abs=0.026)


def test_turning_back_and_forth_is_no_spinning():
    yaws = [1.2 * math.pi * math.sin(0.5 * k) for k in range(200)]
    assert drive([0.0] * 200, yaws) == 0.0


def test_driving_in_circles_is_no_spinning():
    yaws = [0.2 * math.pi * k for k in range(100)]
    assert drive([0.35 * k for k in range(100)], yaws) == 0.0


def test_new_episode_begins_anew():
    meter = SpinMeter(poses(0.0, 0.0))
    for k in range(1, 101):
        meter.note(poses(0.0, 0.2 * math.pi * k), np.array([k % 15 == 0]))
    assert meter.share() == 0.0


def test_share_is_of_the_time_since_the_last_one_and_state_goes_on():
    meter = SpinMeter(poses(0.0, 0.0))
    for k in range(1, 31):
        meter.note(poses(0.0, 0.2 * math.pi * k))
    meter.share()
    other = SpinMeter(poses(0.0, 0.0))
    other.load_state_dict(meter.state_dict())
    for k in range(31, 41):
        for one in (meter, other):
            one.note(poses(0.0, 0.2 * math.pi * k))
    assert meter.share() == other.share() == 1.0
    assert meter.share() == 0.0
