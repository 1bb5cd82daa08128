# SPDX-License-Identifier: Apache-2.0
"""The wheel controller: kinematics, limits and ramps, by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pm01_nav.backends.drive import WheelController
from pm01_nav.robot import Actuator, load_robot

PROMPT = load_robot("pm01").model_copy(update={"actuator": Actuator(lag_s=0.0)})


def test_wheel_speeds_of_a_twist() -> None:
    controller = WheelController(PROMPT, 1, control_dt=1.0, ticks=2)
    speeds = controller.wheel_speeds(np.array([[0.3, 1.0]]))
    # Full speed after the first half second. Wheels 14 cm beside the middle: 0.3 m/s -+ 0.14 m/s
    # on 5 cm make 3.2 and 8.8 rad/s.
    assert speeds[1, 0] == pytest.approx([3.2, 8.8])
    # In between it ramps: half of that on average.
    assert speeds[0, 0] == pytest.approx([1.6, 4.4])


def test_acceleration_is_limited() -> None:
    controller = WheelController(PROMPT, 1, control_dt=0.1, ticks=5)
    controller.wheel_speeds(np.array([[0.5, 0.0]]))
    # 2 m/s^2 for 0.1 s.
    assert controller.twist[0] == pytest.approx([0.2, 0.0])
    controller.wheel_speeds(np.array([[0.5, 1.5]]))
    # 8 rad/s^2 for 0.1 s.
    assert controller.twist[0] == pytest.approx([0.4, 0.8])


def test_commands_are_kept_within_the_limits() -> None:
    controller = WheelController(PROMPT, 2, control_dt=10.0, ticks=5)
    controller.wheel_speeds(np.array([[9.0, -9.0], [-9.0, 9.0]]))
    assert controller.twist == pytest.approx(np.array([[0.5, -1.5], [-0.2, 1.5]]))


def test_lag() -> None:
    slow = load_robot("pm01").model_copy(update={"actuator": Actuator(lag_s=0.5)})
    controller = WheelController(slow, 1, control_dt=0.1, ticks=5)
    controller.wheel_speeds(np.array([[0.1, 0.0]]))
    # 0.1 m/s * (1 - exp(-0.1 / 0.5)), which needs less than 2 m/s^2.
    assert controller.twist[0, 0] == pytest.approx(0.1 * (1 - math.exp(-0.2)))
