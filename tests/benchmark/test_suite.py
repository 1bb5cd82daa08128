# SPDX-License-Identifier: Apache-2.0
"""A suite's hash covers all that decides what happens, and nothing else."""

from __future__ import annotations

from dataclasses import replace

import pytest

from pm01_nav.benchmark.suite import Suite, read_suite, sweep_suites
from pm01_nav.benchmark.sweeps import SWEEPS
from pm01_nav.errors import InputError
from pm01_nav.task.config import ObservationConfig, RewardTerm
from pm01_nav.worlds.frozen import worlds_hash

SUITE = read_suite("static", seed=1)


def changed(**changes) -> Suite:
    return replace(SUITE, task=SUITE.task.model_copy(update=changes))


def test_the_same_suite_has_the_same_hash() -> None:
    assert read_suite("static", seed=1).hash == SUITE.hash
    assert len(SUITE.hash) == 64


@pytest.mark.parametrize(
    "other",
    [
        read_suite("static", seed=2),
        read_suite("empty", seed=1),
        read_suite("static", seed=1, robot="jackal"),
        read_suite("static", seed=1, randomization="on"),
        changed(goal_radius=0.31),
        changed(time_limit_s=50.1),
        changed(margin=0.11),
        changed(suite_params={"obstacles": 8}),
    ],
    ids=lambda suite: suite.name,
)
def test_other_worlds_rules_or_robots_have_another(other: Suite) -> None:
    assert other.hash != SUITE.hash


def test_what_a_policy_learns_by_does_not_count() -> None:
    assert changed(rewards={"goal": RewardTerm(weight=1.0)}).hash == SUITE.hash
    assert changed(observation=ObservationConfig(sectors=72)).hash == SUITE.hash
    assert changed(num_worlds=7).hash == SUITE.hash


def test_what_a_driver_means_by_a_zero_does_not_count() -> None:
    assert changed(robot_changes={"lidar": {"zero_means": "no_return"}}).hash == SUITE.hash


def test_worlds_count(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "pm01_nav.benchmark.suite.worlds_hash", lambda worlds: worlds_hash(worlds[1:])
    )
    assert read_suite("static", seed=1).hash != SUITE.hash


def test_results_from_before_delays_were_in_seconds_still_belong(tmp_path) -> None:
    file = tmp_path / "noisy.yaml"
    file.write_text("{actuator_lag: [0.2, 0.2], odometry_scale: [1.02, 1.02], ", encoding="utf-8")
    with file.open("a", encoding="utf-8") as more:
        more.write("lidar_noise_std: [0.01, 0.01]}\n")
    noisy = read_suite("static", 1, randomization=str(file))
    # As revision b8297e0 hashed it, with `command_delay: [0, 0]` in its rules.
    assert noisy.hash == "c63ad50acbb321533f91d2dcc31a95347d550c53e58aeeca461378ae7b47c3ff"
    file.write_text("command_delay_s: [0.1, 0.1]\n", encoding="utf-8")
    late = read_suite("static", 1, randomization=str(file))
    file.write_text("command_delay_s: [0.2, 0.2]\n", encoding="utf-8")
    assert late.hash != read_suite("static", 1, randomization=str(file)).hash


def test_a_perturbed_suite_has_a_name_of_its_own(tmp_path) -> None:
    file = tmp_path / "harsh.yaml"
    file.write_text("command_delay_s: [0.2, 0.2]\n", encoding="utf-8")
    assert read_suite("static", 1, randomization=str(file)).name == "static+harsh"
    assert read_suite("static", 1, randomization="off") == SUITE


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("moon", "task = 'moon': unknown"),
        ("barn", "its worlds are files; write barn=PATH"),
        ("map=", "its worlds are files; write map=PATH"),
        ("static=worlds", "the worlds of static are generated"),
    ],
)
def test_unusable_suites_are_refused(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_suite(text, seed=1)


def test_files_that_are_missing_are_refused(tmp_path) -> None:
    with pytest.raises(InputError):
        _ = read_suite(f"barn={tmp_path}", seed=1).hash


@pytest.mark.parametrize("name", SWEEPS)
def test_every_point_of_a_sweep_is_a_suite_of_its_own(name: str) -> None:
    suites = sweep_suites(name, seed=1)
    assert [s.point.value for s in suites if s.point] == list(SWEEPS[name].values)
    assert len({suite.hash for suite in suites}) == len(suites)
    assert len({suite.name for suite in suites}) == len(suites)


def test_a_sweep_changes_what_it_says() -> None:
    noise = sweep_suites("lidar_noise", seed=1)[2].task.randomization
    assert noise is not None
    assert noise.lidar_noise_std == (0.05, 0.05)
    assert noise.lidar_dropout == (0.0, 0.0)
    assert sweep_suites("density", seed=1)[1].task.suite_params == {"obstacles": 8}


def test_a_sweep_takes_backend_and_randomization(tmp_path) -> None:
    """What is varied goes over the file; the curve has a name of its own."""
    in_engine = sweep_suites("density", seed=1, backend="mujoco")[1]
    assert in_engine.task.backend == "mujoco"
    assert in_engine.task.suite_params == {"obstacles": 8}
    assert in_engine.name == "static+mujoco@density=8"
    assert in_engine.point is not None
    assert (in_engine.point.sweep, in_engine.point.suite) == ("density+mujoco", "static+mujoco")
    file = tmp_path / "harsh.yaml"
    file.write_text(
        "{command_delay_s: [0.2, 0.2], lidar_noise_std: [0.3, 0.3]}\n", encoding="utf-8"
    )
    noisy = sweep_suites("lidar_noise", seed=1, randomization=str(file))[2]
    assert noisy.name == "static+harsh@lidar_noise=0.05"
    assert noisy.task.randomization is not None
    assert noisy.task.randomization.lidar_noise_std == (0.05, 0.05)
    assert noisy.task.randomization.command_delay_s == (0.2, 0.2)


def test_an_engine_without_what_a_sweep_varies_is_refused() -> None:
    with pytest.raises(InputError, match="randomization: only the backend planar has it"):
        sweep_suites("lidar_noise", seed=1, backend="mujoco")


def test_command_hands_its_options_to_sweeps() -> None:
    from pm01_nav.cli.benchmark import _suites

    suites = _suites(("static",), ("density",), 1, "jackal", None, "mujoco")
    assert {(suite.task.backend, suite.task.robot) for suite in suites} == {("mujoco", "jackal")}


def test_an_unknown_sweep_is_refused() -> None:
    with pytest.raises(InputError, match="sweep = 'moon': unknown; allowed: density"):
        sweep_suites("moon", seed=1)
