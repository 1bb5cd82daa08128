# SPDX-License-Identifier: Apache-2.0
"""Ranges of what may be wrong: complete, ordered, and strict about what they are given."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from pm01_nav.benchmark.policies import trained_task
from pm01_nav.cli.options import task_from_options
from pm01_nav.config import to_yaml, validate
from pm01_nav.envs.spaces import resolve_task
from pm01_nav.errors import InputError, InputWarning
from pm01_nav.robot import load_robot
from pm01_nav.sim.settings import Perturbation
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
    in_steps = {"command_delay", "scan_delay", "scan_sweep"}
    seconds = {f"{name}_s" for name in in_steps}
    assert set(RandomizationConfig.model_fields) == set(Perturbation._fields) - in_steps | seconds


def test_default_ranges_move_every_quantity() -> None:
    ranges = default_randomization()
    for name in RandomizationConfig.model_fields:
        low, high = getattr(ranges, name)
        assert low < high, name


def test_empty_ranges_leave_the_robot_as_described() -> None:
    jackal = load_robot("jackal")
    ranges = RandomizationConfig().ranges(jackal, 0.1)
    # From the Jackal's file: no lag, noise of 1 mm.
    assert ranges.actuator_lag.tolist() == [0.0, 0.0]
    assert ranges.lidar_noise_std.tolist() == [0.001, 0.001]
    factors = [n for n in Perturbation._fields if n.endswith("_factor")] + ["odometry_scale"]
    for name in set(Perturbation._fields) - {"actuator_lag", "lidar_noise_std"}:
        expected = 1.0 if name in factors else 0.0
        assert getattr(ranges, name).tolist() == [expected, expected], name


def test_zero_replaces_the_robots_own() -> None:
    silent = RandomizationConfig(lidar_noise_std=(0.0, 0.0), actuator_lag=(0.0, 0.0))
    assert silent.ranges(load_robot("jackal"), 0.1).lidar_noise_std.tolist() == [0.0, 0.0]
    assert silent.ranges(load_robot("pm01"), 0.1).actuator_lag.tolist() == [0.0, 0.0]


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
        ("command_delay_s", [0.0, 1.1]),
        ("command_delay_s", [0.2, 0.1]),
        ("command_delay_s", [-0.1, 0.1]),
        ("scan_delay_s", [0.0, 1.1]),
        ("scan_sweep_s", 0.1),
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
    file.write_text("slip: [0.1, 0.1]\ncommand_delay_s: [0.1, 0.25]\n", encoding="utf-8")
    expected = RandomizationConfig(slip=(0.1, 0.1), command_delay_s=(0.1, 0.25))
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
    ranges = default_randomization().ranges(load_robot("pm01"), 0.1)
    assert ranges.command_delay.tolist() == [0.0, 2.0]
    finer = default_randomization().ranges(load_robot("pm01"), 0.02)
    assert finer.command_delay.tolist() == [0.0, 10.0]
    assert (finer.scan_delay.tolist(), finer.scan_sweep.tolist()) == ([0.0, 5.0], [0.0, 5.0])
    # Whole steps stay whole, though 0.3 / 0.1 is less than 3 on a computer; others are not.
    odd = RandomizationConfig(command_delay_s=(0.25, 0.3)).ranges(load_robot("pm01"), 0.1)
    assert odd.command_delay.tolist() == [2.5, 3.0]
    for limits in ranges:
        assert limits.shape == (2,)
        assert limits.dtype == np.float64


MAIN = "from pm01_nav.cli import main; main()"
EARLY = "command_delay: [1, 2]\nscan_delay: [0, 1]\nscan_sweep: [0.5, 1.0]\nslip: [0.1, 0.1]\n"


@pytest.mark.parametrize("dt", [0.1, 0.05])
def test_early_files_in_control_steps_are_read_with_a_warning(tmp_path: Path, dt: float) -> None:
    file = tmp_path / "ranges.yaml"
    file.write_text(EARLY, encoding="utf-8")
    seconds = (dt, 2 * dt), (0.0, dt), (0.5 * dt, dt)
    names = "command_delay_s", "scan_delay_s", "scan_sweep_s"
    expected = RandomizationConfig(slip=(0.1, 0.1), **dict(zip(names, seconds, strict=True)))
    told = rf"{file}: command_delay = \[1, 2\] as command_delay_s = .* control steps of {dt:g} s"
    with pytest.warns(InputWarning, match=told):
        assert load_randomization(str(file), dt) == expected
    # In a task, as config.yaml and the files of policies have it, its own control period counts.
    task = task_config("static").model_dump()
    task |= {"control_dt": dt, "randomization": yaml.safe_load(EARLY)}
    with pytest.warns(InputWarning, match=rf"scan_sweep = .* control steps of {dt:g} s"):
        assert validate(TaskConfig, task, "config.yaml").randomization == expected
    with pytest.warns(InputWarning):
        flag = task_from_options(
            None,
            task="static",
            **NOTHING | {"changes": (f"task.control_dt={dt}",)},
            randomization=str(file),
        )
    assert flag.randomization == expected
    # Laid over a task that has delays of its own.
    settings = {"task": {"control_dt": dt, "randomization": yaml.safe_load(EARLY)}}
    (tmp_path / "config.yaml").write_text(yaml.safe_dump(settings), encoding="utf-8")
    stored = resolve_task("static", {"randomization": {"command_delay_s": [0.7, 0.7]}})
    given = NOTHING | {"config_file": str(tmp_path / "config.yaml")}
    with pytest.warns(InputWarning):
        assert task_from_options(stored, task=None, **given).randomization == expected


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{command_delay: [1, 1], command_delay_s: [0.1, 0.1]}", "stands beside command_delay_s"),
        ("{command_delay: [20, 30]}", r"command_delay_s.0 = 2.0: .*less than or equal to 1"),
        ("{command_delay: 2}", "command_delay_s = 2: .*tuple"),
        ("{command_delay: [a, b]}", "command_delay_s.0 = 'a': .*number"),
    ],
)
@pytest.mark.filterwarnings("ignore::pm01_nav.errors.InputWarning")
def test_unusable_early_delays_are_refused_in_one_line(tmp_path: Path, text, words) -> None:
    file = tmp_path / "ranges.yaml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=rf"^{file}: [^\n]*{words}[^\n]*$"):
        load_randomization(str(file))


def test_the_command_line_shows_the_warning_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "early.yaml").write_text("command_delay: [1, 1]\n", encoding="utf-8")
    # The folder is taken: to train, or to evaluate, would be to compile first.
    command = ["train", "--task", "empty", "--steps", "1", "--out", "."]
    done = subprocess.run(
        [sys.executable, "-c", MAIN, *command, "--randomization", "early.yaml"],
        capture_output=True,
        text=True,
        cwd=tmp_path,
    )
    assert done.returncode == 2, done.stderr
    assert done.stderr.splitlines() == [
        "warning: early.yaml: command_delay = [1, 1] as command_delay_s = [0.1, 0.1]: "
        "delays are in seconds now; these were taken for control steps of 0.1 s",
        "error: out = .: exists and is not empty; --force replaces it",
    ]
