# SPDX-License-Identifier: Apache-2.0
"""A planner is registered in one place, and is then known wherever planners are named."""

from __future__ import annotations

import numpy as np
import pytest
from click.testing import CliRunner

from pm01_nav.benchmark.entry import planner_entry
from pm01_nav.benchmark.policies import load_policy
from pm01_nav.cli import pm01
from pm01_nav.config import FrozenModel
from pm01_nav.planners import PLANNERS, make_planner, planner
from pm01_nav.planners.goal_seeking import GoalSeeking
from pm01_nav.robot import RobotSpec, load_robot


class CreepParams(FrozenModel):
    speed: float = 0.25


class Creep(GoalSeeking):
    def __init__(self, robot: RobotSpec, control_dt: float, params: CreepParams) -> None:
        self._speed = params.speed

    def act(self, scan, goal, velocity):
        return np.full(np.shape(goal), [self._speed, 0.0])


@pytest.fixture
def _creep():
    planner("creep", CreepParams)(Creep)
    yield
    del PLANNERS["creep"]


@pytest.mark.usefixtures("_creep")
def test_a_registered_planner_can_be_used_everywhere():
    policy = load_policy("creep", load_robot("pm01"), 0.1)
    np.testing.assert_array_equal(policy.act([1.0], [2.0, 0.0], [0.0, 0.0]), [0.25, 0.0])
    assert planner_entry("creep").kind == "planner"
    done = CliRunner().invoke(pm01, ["evaluate", "creep", "--task", "empty", "--episodes", "2"])
    assert done.exit_code == 0, done.output


@pytest.mark.parametrize("name", PLANNERS)
def test_planners_drive_bases_that_could_go_sideways(name: str) -> None:
    planner = make_planner(name, load_robot("omni_disc"), 0.1)
    # Nothing within the 3.5 m of the lidar, and the goal straight ahead.
    scan, goal = np.full((2, 360), np.inf), np.array([[3.0, 0.0], [3.0, 0.0]])
    command = planner.act(scan, goal, np.zeros((2, 3)))
    assert command.shape == (2, 3)
    assert (command[:, 0] > 0.0).all()
    assert (command[:, 1] == 0.0).all()
