# SPDX-License-Identifier: Apache-2.0
"""Durations are in seconds in every configuration; what early files count in steps is read."""

from __future__ import annotations

import pytest
import yaml

from pm01_nav.arrays import NUMPY
from pm01_nav.benchmark.entry import planner_entry
from pm01_nav.benchmark.policies import trained_task
from pm01_nav.benchmark.suite import read_suite
from pm01_nav.cli.options import task_from_options
from pm01_nav.config import to_yaml, validate
from pm01_nav.durations import whole_steps
from pm01_nav.envs.spaces import resolve_task
from pm01_nav.errors import InputError
from pm01_nav.planners import planner_params
from pm01_nav.planners.guided import GuideParams
from pm01_nav.planners.mppi import MPPI, MPPIParams
from pm01_nav.policy import OnnxPolicy
from pm01_nav.robot import load_robot
from pm01_nav.task.config import TaskConfig, observation_layout
from pm01_nav.task.frames import FramesLayout
from pm01_nav.task.navigation import features
from pm01_nav.task.tasks import navigation, task_config
from pm01_nav.task.trail import TrailLayout


@pytest.mark.parametrize(
    ("seconds", "control_dt", "steps"),
    # 0.3 / 0.1 is 2.9999999999999996 on a computer.
    [(50.0, 0.1, 500), (50.0, 0.05, 1000), (0.3, 0.1, 3), (0.26, 0.1, 3), (0.01, 0.1, 1)],
)
def test_steps_are_the_nearest_and_one_at_least(seconds, control_dt, steps) -> None:
    assert whole_steps(seconds, control_dt) == steps


def chosen(*changes: str, file: str | None = None, base: TaskConfig | None = None) -> TaskConfig:
    task = None if base else "static"
    return task_from_options(base, task=task, config_file=file, changes=changes)


def test_another_control_period_keeps_the_time(tmp_path) -> None:
    finer = resolve_task("static", {"control_dt": 0.05})
    assert (finer.time_limit_s, finer.time_limit_steps) == (50.0, 1000)
    # The folder of an early run counts 400 steps of 0.1 s, whatever its robot is told later.
    early = task_config("static").model_dump(mode="json")
    del early["time_limit_s"]
    file = tmp_path / "config.yaml"
    file.write_text(to_yaml({"task": early | {"time_limit_steps": 400}}), encoding="utf-8")
    stored = trained_task(str(tmp_path))
    assert stored == resolve_task("static", {"time_limit_s": 40.0})
    for told in (chosen(file=str(file)), chosen(base=stored)):
        assert told == stored
    finer = chosen("task.control_dt=0.05", file=str(file))
    assert (finer.time_limit_s, finer.time_limit_steps) == (40.0, 800)
    # What is said beside it counts its own steps, and goes over the file's.
    for change in ("task.time_limit_steps=600", "task.time_limit_s=30"):
        assert chosen("task.control_dt=0.05", change, file=str(file)).time_limit_s == 30.0
    assert chosen("task.time_limit_steps=600", file=str(file)).time_limit_s == 60.0


def test_early_key_means_steps_of_the_task(tmp_path) -> None:
    assert navigation("static", time_limit_steps=7) == navigation("static", time_limit_s=0.7)
    assert resolve_task("maze", {"time_limit_steps": 3}).time_limit_s == 0.3
    finer = resolve_task("maze", {"control_dt": 0.02})
    assert resolve_task(finer, {"time_limit_steps": 100}).time_limit_s == 2.0
    assert chosen("task.time_limit_steps=100", base=finer).time_limit_s == 2.0
    with_both = "task.time_limit_steps=1", "task.time_limit_s=1"
    match = r"^[^\n]*time_limit_steps: stands beside time_limit_s; give time_limit_s alone$"
    with pytest.raises(InputError, match=match):
        chosen(*with_both)
    with pytest.raises(InputError, match=match):
        resolve_task("static", {"time_limit_steps": 1, "time_limit_s": 1.0})
    task = task_config("static").model_dump() | {"time_limit_steps": 1}
    (tmp_path / "config.yaml").write_text(yaml.safe_dump({"task": task}), encoding="utf-8")
    with pytest.raises(InputError, match=match):
        trained_task(str(tmp_path))


def test_settings_of_another_task_than_the_one_named_are_left_out(tmp_path) -> None:
    file = tmp_path / "config.yaml"
    file.write_text("task: {name: maze, goal_radius: 0.5, time_limit_steps: 9}", encoding="utf-8")
    given = chosen("task.margin=0.2", file=str(file))
    assert (given.goal_radius, given.time_limit_s, given.margin) == (0.3, 50.0, 0.2)


def test_memories_keep_their_times() -> None:
    told = {"trail": {"interval_steps": 20}, "frames": {"count": 1, "interval_steps": 4}}
    task = chosen("task.control_dt=0.05", f"task.observation={told}")
    # 20 and 4 steps of 0.05 s.
    assert task.observation.trail == TrailLayout(interval_s=1.0)
    assert task.observation.frames == FramesLayout(1, 0.2)
    for control_dt, noted, period in ((0.05, 20, 5), (0.1, 10, 3), (0.02, 50, 11)):
        task = resolve_task(task, {"control_dt": control_dt})
        layout = observation_layout(task, task.robot_spec())
        assert features(task, layout).trail.interval_steps == noted
        # The present scan and one of 0.2 s ago, and those in between.
        assert layout.part("scan").memory(1, control_dt, NUMPY).period == period
    parts = {"parts": {"trail": {"layout": {"interval_steps": 20}}}}
    listed = resolve_task("static", {"observation": parts}).observation.parts["trail"]
    assert listed == {"layout": {"interval_s": 2.0}}
    told = {"trail": {"interval_steps": 1, "interval_s": 0.1}}
    with pytest.raises(InputError, match=r"observation\.trail\.interval_steps: stands beside int"):
        resolve_task("static", {"observation": told})


def test_policies_of_the_zoo_know_their_times() -> None:
    # Their files count 500 and 2500 steps of 0.1 s.
    for name, seconds in {"zoo:pm01-static": 50.0, "zoo:turtlebot3-mixed": 250.0}.items():
        task = trained_task(name)
        assert task is not None
        assert task.time_limit_s == seconds
    # 10 and 3 steps of 0.1 s.
    policy = OnnxPolicy("zoo:pm01-mixed")
    assert policy.layout.part("trail").layout.interval_s == 1.0
    assert policy.layout.part("scan").frames.interval_s == 0.3


def test_recorded_results_still_belong() -> None:
    # As revision 907d0b7 hashed it, with `time_limit_steps: 500` in its rules.
    suite = read_suite("static", seed=1)
    assert suite.hash == "32545f82669c1f577b364ec0b4ba5f407321f8f631655bb2febdeb10d2ecad13"
    assert suite.describe()["time_limit_s"] == 50.0


def test_planners_think_in_seconds() -> None:
    early = {"guide": {"replan_steps": 20, "patience_steps": 2}, "steps": 25}
    base = planner_params("mppi").model_dump()
    del base["horizon_s"], base["guide"]
    params = validate(MPPIParams, base | early, "mppi.yaml")
    # Early parameters were for steps of 0.1 s.
    assert (params.guide, params.horizon_s) == (GuideParams(replan_s=2.0, patience_s=0.2), 2.5)
    for control_dt, counts in ((0.1, (20, 2, 25)), (0.05, (40, 4, 50)), (1.0, (2, 1, 2))):
        mppi = MPPI(load_robot("pm01"), control_dt, params)
        assert (mppi._replan_after, mppi._patience, mppi._steps) == counts
    early["guide"]["patience_s"] = 0.2
    match = "^mppi.yaml: guide: patience_steps: stands beside patience_s; give patience_s alone$"
    with pytest.raises(InputError, match=match):
        validate(MPPIParams, base | early, "mppi.yaml")


def test_recorded_planners_are_still_the_same_entries() -> None:
    # As revision 907d0b7 hashed them, with `replan_steps: 10`, `patience_steps: 3`, `steps: 30`.
    recorded = {
        "mppi": "c0dde91a6663e2dacd466bc7105febab93b1d8f4f541f58bb2a5f84b35f0ca74",
        "dwa": "2395085c1a4b277bc279f92a90da0a16eb63801d8518545e69b6a1e379012c5e",
        "goal_seeking": "2a38da4459b52831fa08616485a303869d06306f250e240941af891e63d1e0d1",
    }
    assert {name: planner_entry(name).fingerprint for name in recorded} == recorded
