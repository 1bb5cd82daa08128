# SPDX-License-Identifier: Apache-2.0
"""Ranges of what may be wrong: complete, ordered, and strict about what they are given."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from pm01_nav.benchmark.policies import trained_task
from pm01_nav.cli.options import task_from_options
from pm01_nav.config import to_yaml, validate
from pm01_nav.envs.spaces import resolve_task
from pm01_nav.errors import InputError
from pm01_nav.robot import load_robot
from pm01_nav.sim.perturbation import Perturbation
from pm01_nav.task.config import TaskConfig
from pm01_nav.task.randomization import (
    RandomizationConfig,
    default_randomization,
    load_randomization,
)
from pm01_nav.task.tasks import TASKS, task_config

NAN, INF = float("nan"), float("inf")
NOTHING = {"map_": None, "worlds": None, "robot": None, "config_file": None, "changes": ()}


def test_every_quantity_has_a_range() -> None:
    assert set(RandomizationConfig.model_fields) == set(Perturbation._fields)


def test_default_ranges_move_every_quantity() -> None:
    ranges = default_randomization()
    for name in Perturbation._fields:
        low, high = getattr(ranges, name)
        assert low < high, name


def test_empty_ranges_leave_the_robot_as_described() -> None:
    jackal = load_robot("jackal")
    ranges = RandomizationConfig().ranges(jackal)
    # From the Jackal's file: no lag, noise of 1 mm.
    assert ranges.actuator_lag.tolist() == [0.0, 0.0]
    assert ranges.lidar_noise_std.tolist() == [0.001, 0.001]
    factors = [n for n in Perturbation._fields if n.endswith("_factor")] + ["odometry_scale"]
    for name in set(Perturbation._fields) - {"actuator_lag", "lidar_noise_std"}:
        expected = 1.0 if name in factors else 0.0
        assert getattr(ranges, name).tolist() == [expected, expected], name


def test_zero_replaces_the_robots_own() -> None:
    silent = RandomizationConfig(lidar_noise_std=(0.0, 0.0), actuator_lag=(0.0, 0.0))
    assert silent.ranges(load_robot("jackal")).lidar_noise_std.tolist() == [0.0, 0.0]
    assert silent.ranges(load_robot("pm01")).actuator_lag.tolist() == [0.0, 0.0]


@pytest.mark.parametrize("name", sorted(TASKS))
def test_every_task_can_be_randomized(name: str) -> None:
    changed = resolve_task(name, {"randomization": default_randomization().model_dump()})
    text = to_yaml(changed.model_dump(mode="json"))
    assert validate(TaskConfig, yaml.safe_load(text), "config.yaml") == changed


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("slip", [0.3, 0.1]),
        ("slip", [-0.1, 0.1]),
        ("slip", [0.0, 1.1]),
        ("slip", 0.1),
        ("slip", [0.1]),
        ("slip", [0.1, 0.2, 0.3]),
        ("slip", ["little", "much"]),
        ("slip", [0.0, NAN]),
        ("wheel_left_factor", [0.0, 1.0]),
        ("wheel_left_factor", [1.1, 1.0]),
        ("acceleration_factor", [1.0, INF]),
        ("actuator_lag", [-0.1, 0.1]),
        ("command_delay", [0, 4]),
        ("command_delay", [0.5, 1]),
        ("command_delay", [2, 1]),
        ("scan_delay", [0, 2]),
        ("lidar_range_factor", [0.0, 1.0]),
        ("lidar_range_factor", [0.5, 1.5]),
        ("lidar_noise_std", [-0.01, 0.01]),
        ("odometry_drift_per_m", [0.1, -0.1]),
        ("goal_error", [-0.1, 0.1]),
        ("colour", [0, 1]),
    ],
)
def test_unusable_range_is_refused_in_one_line(tmp_path: Path, key: str, value: Any) -> None:
    file = tmp_path / "ranges.yaml"
    file.write_text(yaml.safe_dump({key: value}), encoding="utf-8")
    with pytest.raises(InputError, match=rf"^{file}: {key}[^\n]*$"):
        load_randomization(str(file))


def test_what_is_allowed_is_said(tmp_path: Path) -> None:
    file = tmp_path / "ranges.yaml"
    file.write_text("slip: [0.3, 0.1]\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"slip = .*: low \(0\.3\) must not exceed high \(0\.1\)"):
        load_randomization(str(file))
    file.write_text("slipp: [0.1, 0.3]\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"slipp: unknown key; allowed here: .*slip, slip_noise"):
        load_randomization(str(file))


def test_padding_that_starts_episodes_in_contact_is_refused() -> None:
    with pytest.raises(InputError, match=r"footprint_padding: must not exceed margin \(0\.1\)"):
        resolve_task("static", {"randomization": {"footprint_padding": [0.0, 0.2]}})


def test_off_on_and_a_file(tmp_path: Path) -> None:
    assert load_randomization("off") is None
    assert load_randomization("on") == default_randomization()
    file = tmp_path / "ranges.yaml"
    file.write_text("slip: [0.1, 0.1]\ncommand_delay: [1, 2]\n", encoding="utf-8")
    expected = RandomizationConfig(slip=(0.1, 0.1), command_delay=(1, 2))
    assert load_randomization(str(file)) == expected


def test_flag_goes_over_the_stored_task() -> None:
    stored = resolve_task("static", {"randomization": {"slip": [0.1, 0.2]}})
    assert task_from_options(stored, task=None, **NOTHING) == stored
    on = task_from_options(stored, task=None, **NOTHING, randomization="on")
    assert on.randomization == default_randomization()
    assert (
        task_from_options(stored, task=None, **NOTHING, randomization="off").randomization is None
    )


def test_single_keys_can_be_set() -> None:
    settings = NOTHING | {"changes": ("task.randomization.slip=[0.1, 0.2]",)}
    changed = task_from_options(None, task="static", **settings)
    assert changed.randomization == RandomizationConfig(slip=(0.1, 0.2))


def test_policies_are_measured_on_robots_as_described(tmp_path: Path) -> None:
    task = resolve_task("static", {"randomization": default_randomization().model_dump()})
    text = to_yaml({"task": task.model_dump(mode="json")})
    (tmp_path / "config.yaml").write_text(text, encoding="utf-8")
    assert trained_task(str(tmp_path)) == task_config("static")


def test_ranges_are_what_the_simulator_reads() -> None:
    ranges = default_randomization().ranges(load_robot("pm01"))
    assert ranges.command_delay.tolist() == [0.0, 2.0]
    for limits in ranges:
        assert limits.shape == (2,)
        assert limits.dtype == np.float64
