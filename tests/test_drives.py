# SPDX-License-Identifier: Apache-2.0
"""What commands mean to a base."""

from __future__ import annotations

import numpy as np
import pytest

from pm01_nav.config import merge, validate
from pm01_nav.drives import (
    DifferentialDrive,
    OmnidirectionalDrive,
    drive_from_dict,
    drive_to_dict,
)
from pm01_nav.errors import InputError
from pm01_nav.robot import RobotSpec, load_robot

WHEELS = DifferentialDrive(linear_min=-0.2, linear_max=0.5, angular_max=1.5)
OMNI = OmnidirectionalDrive(linear_min=-0.2, linear_max=0.5, angular_max=1.5, lateral_max=0.4)


@pytest.mark.parametrize(
    ("action", "command"),
    [
        ((-1.0, -1.0), (-0.2, -1.5)),
        ((1.0, 1.0), (0.5, 1.5)),
        ((0.0, 0.0), (0.15, 0.0)),  # Halfway between -0.2 and 0.5.
        ((0.5, -0.5), (0.325, -0.75)),
        ((-3 / 7, 0.0), (0.0, 0.0)),  # 0.2 of the 0.7 m/s up from the least: -1 + 2 x 2/7.
    ],
)
def test_actions_and_commands_by_hand(action, command) -> None:
    assert WHEELS.to_command(np.array(action)) == pytest.approx(command, abs=1e-12)
    assert WHEELS.to_action(np.array(command)) == pytest.approx(action, abs=1e-12)
    # The same, with half of the speed to the left.
    action, command = np.insert(action, 1, 0.5), np.insert(command, 1, 0.2)
    assert OMNI.to_command(action) == pytest.approx(command, abs=1e-12)
    assert OMNI.to_action(command) == pytest.approx(action, abs=1e-12)


def test_commands_beyond_the_limits_are_the_utmost_actions() -> None:
    assert WHEELS.to_action(np.array([9.0, -9.0])).tolist() == [1.0, -1.0]
    assert OMNI.to_action(np.array([9.0, -9.0, 9.0])).tolist() == [1.0, -1.0, 1.0]


@pytest.mark.parametrize("drive", [WHEELS, OMNI])
def test_round_trip_over_leading_dimensions(drive) -> None:
    actions = np.random.default_rng(0).uniform(-1, 1, (3, 4, drive.size))
    assert drive.to_action(drive.to_command(actions)) == pytest.approx(actions, abs=1e-12)


def test_robot_that_cannot_reverse() -> None:
    forwards = DifferentialDrive(linear_min=0.0, linear_max=1.0, angular_max=2.0)
    assert forwards.to_command(np.array([-1.0, 0.0])).tolist() == [0.0, 0.0]


@pytest.mark.parametrize(
    ("command", "followed"),
    [
        ((0.5, 0.4, 3.0), (0.5 / np.sqrt(2), 0.4 / np.sqrt(2), 1.5)),  # Both axes in full.
        ((-0.2, 0.0, 0.0), (-0.2, 0.0, 0.0)),
        # Backwards the half axis is 0.2: (0.1 / 0.2)^2 + (0.4 / 0.4)^2 = 1.25.
        ((-0.1, 0.4, 0.0), (-0.1 / np.sqrt(1.25), 0.4 / np.sqrt(1.25), 0.0)),
        ((0.3, 0.32, 0.0), (0.3, 0.32, 0.0)),  # 0.6^2 + 0.8^2 = 1
    ],
)
def test_ellipse_by_hand(command, followed) -> None:
    assert OMNI.clip(np.array(command)) == pytest.approx(followed, abs=1e-12)


def test_what_is_reachable_in_a_time() -> None:
    base = load_robot("omni_disc").base
    # 2 m/s^2 for 0.1 s and 8 rad/s^2: 0.2 m/s and 0.8 rad/s more or less.
    reached = base.reachable(np.array([0.4, -0.1, 1.5]), np.zeros(3), 0.1)
    assert reached == pytest.approx([0.2, -0.1, 0.8])
    assert base.braking_time([0.4, 0.1, 0.8]) == pytest.approx(0.2)
    assert base.top_speed == 0.5


def test_planar_and_unicycle() -> None:
    assert WHEELS.planar([0.1, 0.2]).tolist() == [0.1, 0.0, 0.2]
    assert WHEELS.from_planar([0.1, 0.3, 0.2]).tolist() == [0.1, 0.2]
    assert OMNI.from_planar([0.1, 0.3, 0.2]).tolist() == [0.1, 0.3, 0.2]
    assert OMNI.from_unicycle(np.array([[0.1, 0.2]])).tolist() == [[0.1, 0.0, 0.2]]
    assert OMNI.to_unicycle(np.array([0.1, 0.3, 0.2])).tolist() == [0.1, 0.2]
    assert OMNI.turning(0.7).tolist() == [0.0, 0.0, 0.7]
    assert WHEELS.turning(0.7).tolist() == [0.0, 0.7]


@pytest.mark.parametrize("drive", [WHEELS, OMNI])
def test_metadata_round_trip(drive) -> None:
    assert drive_from_dict(drive_to_dict(drive)) == drive


def test_metadata_of_earlier_versions_is_of_a_differential_drive() -> None:
    data = {"linear_min": -0.2, "linear_max": 0.5, "angular_max": 1.5}
    assert drive_from_dict(data) == WHEELS
    assert drive_to_dict(WHEELS) == data


def test_unknown_drives_are_refused() -> None:
    with pytest.raises(InputError, match=r"drive = 'hover': unknown; allowed: differential"):
        drive_from_dict({"drive": "hover"})
    with pytest.raises(InputError, match="limits: must be finite"):
        drive_from_dict({"linear_min": -0.2, "linear_max": float("inf"), "angular_max": 1.5})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"drive": "hover"}, "drive = 'hover': unknown; allowed: differential, omnidirectional"),
        ({"drive": "differential"}, "limits.lateral_max: unknown key"),
        ({"limits": {"lateral_max": 0.0}}, "limits.lateral_max = 0.0: .*greater than 0"),
        ({"limits": {"shape": "star"}}, "limits.shape = 'star': .*'box' or 'ellipse'"),
    ],
)
def test_descriptions_are_checked_by_the_drive(changes, message) -> None:
    data = merge(load_robot("omni_disc").model_dump(), changes)
    with pytest.raises(InputError, match=message):
        validate(RobotSpec, data, "robot.yaml")


def test_a_differential_drive_needs_wheels() -> None:
    data = load_robot("pm01").model_dump(exclude={"wheels"})
    with pytest.raises(InputError, match=r"wheels.* missing"):
        validate(RobotSpec, data, "robot.yaml")
    with pytest.raises(InputError, match="omni_disc: the drive omnidirectional has no pair of"):
        load_robot("omni_disc").driven_wheels  # noqa: B018
