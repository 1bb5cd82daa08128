# SPDX-License-Identifier: Apache-2.0
"""Actions in [-1, 1] and the commands they stand for."""

from __future__ import annotations

import numpy as np
import pytest

from pm01_nav.drives import DifferentialDrive

LIMITS = DifferentialDrive(linear_min=-0.2, linear_max=0.5, angular_max=1.5)


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
    assert LIMITS.to_command(np.array(action)) == pytest.approx(command, abs=1e-12)
    assert LIMITS.to_action(np.array(command)) == pytest.approx(action, abs=1e-12)


def test_commands_beyond_the_limits_are_the_utmost_actions() -> None:
    assert LIMITS.to_action(np.array([9.0, -9.0])).tolist() == [1.0, -1.0]


def test_round_trip_over_leading_dimensions() -> None:
    actions = np.random.default_rng(0).uniform(-1, 1, (3, 4, 2))
    assert LIMITS.to_action(LIMITS.to_command(actions)) == pytest.approx(actions, abs=1e-12)


def test_robot_that_cannot_reverse() -> None:
    forwards = DifferentialDrive(linear_min=0.0, linear_max=1.0, angular_max=2.0)
    assert forwards.to_command(np.array([-1.0, 0.0])).tolist() == [0.0, 0.0]
