# SPDX-License-Identifier: Apache-2.0
"""A reward term of somebody's own that remembers something, and parameters of every plain type."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Annotated, Any, Literal

import numpy as np
import pytest
import torch
from pydantic import Field

from pm01_nav.arrays import NUMPY
from pm01_nav.errors import InputError
from pm01_nav.task.config import RewardTerm, TaskConfig
from pm01_nav.task.navigation import NavigationBatch
from pm01_nav.task.rewards import NEEDS, REWARDS, RewardTable, StatefulTerm, reward_term
from pm01_nav.task.step import Step
from pm01_nav.task.tasks import task_config
from pm01_nav.task.worlds import world_pool
from pm01_nav.training.config import RunConfig, TrainConfig
from pm01_nav.training.run_folder import RunFolder
from pm01_nav.training.trainer import train
from tests.training.progress import Quiet

NEAR = {"first_near": {"weight": 2.0, "params": {"radius": 1}}}


@pytest.fixture(autouse=True)
def _own_terms(monkeypatch):
    """Enter terms for a test alone."""
    for table in (REWARDS, NEEDS):
        for name in ("first_near", "own"):
            monkeypatch.setitem(table, name, None)

    @reward_term
    class FirstNear(StatefulTerm):
        """1 in the first step of the episode that ends within ``radius`` of the goal [m]."""

        name = "first_near"

        def __init__(self, num_envs: int, arrays: Any, radius: float = 1.0) -> None:
            super().__init__(num_envs, arrays)
            self._radius = radius
            self._paid = arrays.xp.zeros(num_envs, dtype=arrays.xp.bool, device=arrays.place)

        def __call__(self, step: Step) -> Any:
            first = (step.goal_distance < self._radius) & ~self._paid
            self._paid |= first
            return first

        def reset(self, env_ids: Any) -> None:
            self._paid[env_ids] = False


def config(**rewards: Any) -> TaskConfig:
    changes = {"rewards": rewards or NEAR, "num_worlds": 4}
    return TaskConfig.model_validate(task_config("empty").model_dump() | changes)


def begun(num_envs: int = 3) -> NavigationBatch:
    batch = NavigationBatch(config(), world_pool(config(), "train", 1), num_envs)
    batch.reset(np.arange(num_envs))
    return batch


def paid(batch: NavigationBatch, *distances: float, begins: Any = None) -> list[float]:
    """Return the rewards of a step from places so far from the goals [m]; it moves 5 cm at most."""
    n = len(distances)
    # In the middle of 10 m x 10 m, far from every wall.
    poses = np.tile([5.0, 5.0, 0.0], (n, 1))
    goals = np.stack([5.0 + np.array(distances), np.full(n, 5.0)], axis=1)
    batch.simulator.place(np.arange(n), poses, goals)
    return batch.step(np.zeros((n, 2)), begins).reward.tolist()


def test_it_is_paid_once_an_episode_and_begins_anew_with_it():
    batch = begun()
    assert paid(batch, 2.0, 0.8, 2.0) == [0.0, 2.0, 0.0]
    assert paid(batch, 0.8, 0.8, 2.0) == [2.0, 0.0, 0.0]
    batch.begin(np.array([1]))
    assert paid(batch, 0.8, 0.8, 2.0) == [0.0, 2.0, 0.0]
    # Where a mask lets an episode begin, nothing is paid in that step, and all is open again.
    assert paid(batch, 0.8, 0.8, 2.0, begins=np.array([True, False, False])) == [0.0, 0.0, 0.0]
    assert paid(batch, 0.8, 0.8, 2.0) == [2.0, 0.0, 0.0]


def test_its_state_is_saved_restored_and_kept():
    batch, other = begun(), begun()
    assert paid(batch, 2.0, 0.8, 2.0) == [0.0, 2.0, 0.0]
    saved = batch.state_dict()
    assert saved["reward.first_near._paid"].tolist() == [False, True, False]
    other.load_state_dict(saved)
    assert paid(other, 0.8, 0.8, 2.0) == [2.0, 0.0, 0.0]
    batch.keep(np.array([1, 2]))
    assert paid(batch, 0.8, 0.8) == [0.0, 2.0]


def test_it_runs_on_torch():
    table = RewardTable(
        {"first_near": RewardTerm(weight=2.0)}, 3, replace(NUMPY, xp=torch, place="cpu")
    )
    given: dict[str, Any] = dict.fromkeys(Step.__dataclass_fields__)
    pays = torch.empty((1, 3), dtype=torch.float64)
    for distances, begins, expected in (
        ([2.0, 0.8, 2.0], [False, True, False], [0.0, 2.0, 0.0]),
        ([0.8, 0.8, 2.0], [False, False, False], [2.0, 2.0, 0.0]),
        ([0.8, 0.8, 0.8], [False, False, False], [0.0, 0.0, 2.0]),
    ):
        step = Step(**(given | {"xp": torch, "goal_distance": torch.tensor(distances)}))
        table.pay(step, pays)
        table.reset(torch.tensor(begins))
        assert pays.tolist() == [expected]


def test_a_run_with_it_is_resumed(tmp_path):
    samples = 16 * 8
    settings = {"eval_every": samples, "eval_episodes": 2, "threads": 1}
    settings["ppo"] = {"n_envs": 16, "n_steps": 8, "batch_size": 64, "n_epochs": 1}
    for iterations, resume in ((2, False), (3, True)):
        trained = TrainConfig.model_validate(settings | {"steps": iterations * samples})
        run = RunConfig(task=config(), train=trained)
        folder = RunFolder(tmp_path / "run")
        result = train(run, folder, Quiet(), started_at=time.perf_counter(), resume=resume)
        assert result.steps == iterations * samples
    batch = torch.load(tmp_path / "run" / "last.pt", weights_only=True)["batch"]
    assert batch["reward.first_near._paid"].shape == (16,)


def many_kinds() -> None:
    @reward_term
    def own(
        step: Step,
        exponent: int,
        offset=0,
        squared: bool = False,
        kind: Literal["mean", "worst"] = "mean",
        range: tuple[float, float] = (0.0, 1.0),
        share: Annotated[float, Field(le=1.0)] = 0.5,
        weights: list[float] | None = None,
    ) -> Any:
        """What it was given."""
        total = exponent + offset + squared + len(kind) + range[1] + share + len(weights or [])
        return step.xp.full_like(step.goal_distance, total)


def test_parameters_are_of_any_plain_type():
    many_kinds()
    params = {"exponent": -2, "offset": -0.5, "squared": True, "kind": "worst", "range": [0, 4]}
    row = {"weight": 1.0, "params": params | {"share": 0, "weights": [1, 2.5]}}
    task = config(own=row)
    assert TaskConfig.model_validate(task.model_dump(mode="json")) == task
    batch = NavigationBatch(task, world_pool(task, "train", 1), 2)
    batch.reset([0, 1])
    # -2 - 0.5 + 1 + 5 + 4 + 0 + 2
    assert batch.step(np.zeros((2, 2))).reward.tolist() == [9.5, 9.5]


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("exponent", 0.5),
        ("exponent", "2"),
        ("offset", True),
        ("offset", "none"),
        ("offset", float("nan")),
        ("squared", 1),
        ("kind", "best"),
        ("range", [0.0]),
        ("share", 1.5),
        ("weights", 3.0),
        ("weights", [float("inf")]),
        ("weights", {1, 2}),
    ],
)
def test_a_parameter_that_its_term_does_not_allow_is_refused(key, value):
    many_kinds()
    params = {"exponent": 1} | {key: value}
    with pytest.raises(ValueError, match=rf"rewards\.own\.params\.{key} = ") as raised:
        config(own={"weight": 1.0, "params": params})
    # In a run's file it is one line.
    assert "\n" not in str(InputError(raised.value))


def test_a_parameter_without_a_default_must_be_given():
    many_kinds()
    with pytest.raises(ValueError, match=r"rewards\.own\.params\.exponent: is missing"):
        config(own={"weight": 1.0})
