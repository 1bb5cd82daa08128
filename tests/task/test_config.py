# SPDX-License-Identifier: Apache-2.0
"""Configurations: complete, immutable, and strict about what they are given."""

from __future__ import annotations

from typing import Any

import pytest
import yaml
from pydantic import ValidationError

from pm01_nav.config import merge, to_yaml, validate
from pm01_nav.envs.spaces import resolve_task
from pm01_nav.errors import InputError
from pm01_nav.task.config import TaskConfig
from pm01_nav.task.tasks import TASKS, task_config

NAN, INF = float("nan"), float("inf")


@pytest.mark.parametrize("name", sorted(TASKS))
def test_task_loads_and_says_its_name(name: str) -> None:
    config = task_config(name)
    assert config.name == name
    assert config.rewards
    assert config.robot_spec().lidar.num_beams >= 1


@pytest.mark.parametrize("name", sorted(TASKS))
def test_effective_config_survives_yaml(name: str) -> None:
    config = task_config(name)
    text = to_yaml(config.model_dump(mode="json"))
    assert validate(TaskConfig, yaml.safe_load(text), "config.yaml") == config


@pytest.mark.parametrize("name", sorted(TASKS))
def test_configs_share_nothing(name: str) -> None:
    before = task_config(name).model_dump()
    config = task_config(name)
    # Frozen fields still hold mappings that one could write to.
    config.rewards.clear()
    config.robot_changes["lidar"] = {"num_beams": 7}
    assert task_config(name).model_dump() == before
    others = {other: TASKS[other]().model_dump() for other in TASKS}
    assert {other: task_config(other).model_dump() for other in TASKS} == others


def test_changes_leave_the_original_alone() -> None:
    config = task_config("static")
    before = config.model_dump()
    changed = resolve_task(config, {"rewards": {"goal": {"weight": 7.0}}, "goal_radius": 0.5})
    assert changed.rewards["goal"].weight == 7.0
    assert changed.goal_radius == 0.5
    assert set(changed.rewards) == set(config.rewards)
    assert config.model_dump() == before
    assert resolve_task("static", {}) == task_config("static")


def test_merge_alters_neither_argument() -> None:
    base, changes = {"a": {"b": 1, "c": 2}, "d": 3}, {"a": {"b": 9}, "e": [4]}
    assert merge(base, changes) == {"a": {"b": 9, "c": 2}, "d": 3, "e": [4]}
    assert base == {"a": {"b": 1, "c": 2}, "d": 3}
    assert changes == {"a": {"b": 9}, "e": [4]}


def test_config_is_immutable() -> None:
    with pytest.raises(ValidationError):
        task_config("static").goal_radius = 1.0


def change(**changes: Any) -> TaskConfig:
    return resolve_task("static", changes)


def test_unknown_task_names_those_allowed() -> None:
    with pytest.raises(InputError, match="task = 'fly': unknown; allowed: article, barn, "):
        task_config("fly")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"goal_radios": 1}, r"goal_radios: unknown key; allowed here: name, suite, .*goal_radius"),
        (
            {"observation": {"sector": 1}},
            r"observation\.sector: unknown key; allowed here: sectors, nearness_distance",
        ),
        (
            {"observation": {"parts": {"sonar": {}}}},
            r"observation\.parts\.sonar: unknown; allowed: ",
        ),
        (
            {"observation": {"parts": {"trail": {"size": 1}}}},
            r"observation\.parts\.trail\.size: unknown; allowed: layout",
        ),
        ({"rewards": {"goa": {"weight": 1}}}, r"rewards\.goa: unknown; allowed: collision, goal"),
        (
            {"rewards": {"proximity": {"weight": 1, "params": {"far": 1}}}},
            r"rewards\.proximity\.params\.far: unknown; allowed: distance",
        ),
        (
            {"rewards": {"goal": {"weight": 1, "params": {"far": 1}}}},
            r"rewards\.goal\.params\.far: unknown; allowed: none",
        ),
    ],
)
def test_unknown_key_names_those_allowed(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message) as raised:
        change(**changes)
    assert "\n" not in str(raised.value)


def test_unknown_key_of_a_reward_term_names_those_allowed() -> None:
    with pytest.raises(InputError, match=r"rewards\.goal\.wieght: .*allowed here: weight, params"):
        change(rewards={"goal": {"wieght": 1}})


def test_unknown_key_of_the_robot_names_those_allowed() -> None:
    config = change(robot_changes={"lidar": {"beams": 20}})
    with pytest.raises(InputError, match=r"lidar\.beams: unknown key; allowed here: num_beams"):
        config.robot_spec()


@pytest.mark.parametrize(
    ("key", "value"),
    [
        *[
            (key, value)
            for key in ("goal_radius", "collision_distance", "control_dt")
            for value in (NAN, INF, -INF, 0.0, -1.0, "near", None)
        ],
        *[("margin", value) for value in (NAN, INF, -0.1, None)],
        *[("time_limit_s", value) for value in (NAN, INF, 0, -5, "long")],
        *[("time_limit_steps", value) for value in (NAN, INF, 0, -5, 1.5, True, 10**400, "1")],
        *[("num_worlds", value) for value in (NAN, 0, -1, 10**9)],
        *[("goal_distance", value) for value in ((NAN, 3), (1, NAN), (-1, 2), (1, INF), (2, 1))],
        *[("goal_distance", value) for value in ((2, 2), (1,), 3.0, (1, 2, 3))],
        ("collision", "never"),
        ("observation", {"nearness_distance": NAN}),
        ("observation", {"nearness_distance": -0.3}),
        ("observation", {"sectors": -1}),
        ("observation", {"goal_distance_max": 0.0}),
        ("observation", {"range_max": -1.0}),
        ("observation", {"goal": "cartesian"}),
        ("rewards", {"goal": {"weight": NAN}}),
        ("rewards", {"goal": {"weight": INF}}),
        ("rewards", {"proximity": {"weight": 1.0, "params": {"distance": NAN}}}),
    ],
)
def test_unusable_value_is_refused(key: str, value: Any) -> None:
    with pytest.raises(InputError, match=rf"^task static: [^\n]*{key}[^\n]*$"):
        change(**{key: value})


@pytest.mark.parametrize("limit", ["linear_max", "angular_max", "linear_acceleration"])
@pytest.mark.parametrize("value", [NAN, INF, -1.0, 0.0])
def test_unusable_limit_of_the_robot_is_refused(limit: str, value: float) -> None:
    config = change(robot_changes={"limits": {limit: value}})
    with pytest.raises(InputError, match=rf"limits\.{limit}"):
        config.robot_spec()


def test_reward_parameter_that_divides_by_zero_is_refused() -> None:
    with pytest.raises(InputError, match="distance"):
        change(rewards={"proximity": {"weight": 1.0, "params": {"distance": 0.0}}})
