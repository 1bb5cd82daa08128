# SPDX-License-Identifier: Apache-2.0
"""From a policy's file to a controller: whose robot it is, and how often it acts."""

from __future__ import annotations

import json
from typing import Any

import onnx
import pytest

from pm01_nav.config import to_yaml
from pm01_nav.deploy.assembly import load_controller
from pm01_nav.deploy.goals import Goal
from pm01_nav.deploy.simulated_robot import SimulatedRobot
from pm01_nav.errors import InputError
from pm01_nav.policy.onnx_policy import METADATA_KEY
from pm01_nav.robot import load_robot
from pm01_nav.worlds.pool import build_pool
from pm01_nav.worlds.world import World
from pm01_nav.zoo import resolved


@pytest.fixture
def make_policy(tmp_path):
    def make(name: str, task: dict[str, Any] | None = None, **metadata: Any) -> str:
        """Return a policy of the zoo that says something else of itself, or of its task."""
        model = onnx.load(resolved(name))
        known = {entry.key: entry for entry in model.metadata_props}
        told = json.loads(known[METADATA_KEY].value)
        told["task"] |= task or {}
        known[METADATA_KEY].value = json.dumps(told | metadata)
        onnx.save(model, tmp_path / "policy.onnx")
        return str(tmp_path / "policy.onnx")

    return make


def test_a_robot_of_ones_own_is_changed_as_it_was_for_the_training(make_policy, tmp_path):
    mine = load_robot("jackal").model_copy(update={"name": "mine"})
    (tmp_path / "mine.yaml").write_text(to_yaml(mine.model_dump(mode="json")))
    file = make_policy("zoo:jackal-barn", {"robot": str(tmp_path / "mine.yaml")}, robot="mine")
    for given in (None, str(tmp_path / "mine.yaml")):
        robot = load_controller(file, given).robot
        assert (robot.name, robot.limits.linear_min) == ("mine", -0.5)
    # It is another robot under another name, and does not become one that fits by being changed.
    with pytest.raises(InputError, match=r"limits.linear_min is -2"):
        load_controller(file, "jackal")


def test_where_the_description_is_elsewhere_one_is_asked_for_it(make_policy):
    file = make_policy("zoo:pm01-static", {"robot": "elsewhere/mine.yaml"}, robot="mine")
    with pytest.raises(InputError, match=r"^[^\n]*elsewhere/mine.yaml[^\n]*give --robot[^\n]*$"):
        load_controller(file)


@pytest.mark.parametrize(
    "changes",
    [[1], "limits", {"wings": 2}, {"limits": {"linear_min": "backwards"}}, {"limits": 3}],
)
def test_impossible_changes_are_refused_in_one_line(make_policy, changes):
    file = make_policy("zoo:pm01-static", {"robot_changes": changes})
    with pytest.raises(InputError, match=r"^[^\n]*robot_changes[^\n]*$"):
        load_controller(file)


def test_a_policy_without_a_task_drives_the_robot_that_it_names(make_policy):
    assert load_controller(make_policy("zoo:pm01-static", task=None)).robot.name == "pm01"
    file = make_policy("zoo:pm01-static")
    model = onnx.load(file)
    told = json.loads(model.metadata_props[0].value)
    model.metadata_props[0].value = json.dumps(told | {"task": "static"})
    onnx.save(model, file)
    assert load_controller(file).robot.name == "pm01"


@pytest.mark.parametrize("control_dt", [0.15, 0.3])
def test_a_slow_policy_drives_and_no_watchdog_stops_it(make_policy, control_dt):
    """Training allows such time steps; a base stops after 0.2 s without a command."""
    controller = load_controller(make_policy("zoo:pm01-static", control_dt=control_dt))
    pool = build_pool([World("hall", (0.0, 0.0, 6.0, 2.0), start=(1.0, 1.0, 0.0))], 0.3)
    sim = SimulatedRobot(controller.robot, pool, seed=1, dt=0.025)
    controller.set_goal(Goal(4.0, 1.0))
    asked, act = [], controller.policy.act
    controller.policy.act = lambda *sees, now=None, applied=None, pose=None: (
        asked.append(now) or act(*sees, now=now, applied=applied, pose=pose)
    )
    due, speeds, status = 0.0, [], None
    while sim.time < 20.0 and not (status and status.arrived):
        new_scan = sim.step()
        controller.see_odometry(sim.odometry(), sim.time)
        if new_scan:
            controller.see_scan(sim.scan(), sim.time)
        if sim.time >= due - 1e-9:
            due = sim.time + controller.control_dt
            status = controller.step(sim.time)
            sim.command(*status.verdict.command)
        speeds.append(sim.odometry().twist[0])
    assert status.arrived
    # It never stood on the way, where a watchdog would have let it brake at 2 m/s^2.
    assert min(speeds[60:]) > 0.2
    times = [asked[0] + control_dt * k for k in range(len(asked))]
    assert asked == pytest.approx(times, abs=1e-6)
