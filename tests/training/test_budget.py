# SPDX-License-Identifier: Apache-2.0
"""What is spent of a budget, and what falls with it."""

from __future__ import annotations

import pytest

from pm01_nav.task.tasks import task_config
from pm01_nav.training import budget as module
from pm01_nav.training.budget import Budget
from pm01_nav.training.config import RunConfig, TrainConfig


@pytest.fixture
def clock(monkeypatch):
    """Seconds that the test sets."""
    now = {"s": 0.0}
    monkeypatch.setattr(module.time, "perf_counter", lambda: now["s"])
    return now


def budget(**limits) -> Budget:
    train = TrainConfig.model_validate(limits)
    return Budget(RunConfig(task=task_config("static"), train=train), started_at=0.0)


def test_start_up_counts_into_the_budget_but_not_into_the_schedule(clock):
    spent = budget(time_budget=15.0)
    clock["s"] = 5.0
    spent.learning_since = spent.seconds
    assert spent.fraction() == pytest.approx(1 / 3)
    assert spent.learning_fraction() == 0.0
    clock["s"] = 10.0
    assert spent.fraction() == pytest.approx(2 / 3)
    assert spent.learning_fraction() == pytest.approx(0.5)
    clock["s"] = 16.0
    assert spent.fraction() > 1.0
    assert spent.learning_fraction() == 1.0


def test_of_steps_and_seconds_what_is_further_counts(clock):
    spent = budget(time_budget=100.0, steps=1000)
    clock["s"], spent.steps_done = 10.0, 600
    assert spent.fraction() == spent.learning_fraction() == 0.6
    clock["s"] = 90.0
    assert spent.fraction() == spent.learning_fraction() == 0.9


def test_a_start_up_longer_than_the_budget_is_the_end_of_the_schedule(clock):
    spent = budget(time_budget=2.0)
    clock["s"] = 5.0
    spent.learning_since = spent.seconds
    assert spent.learning_fraction() == 1.0


def test_compiling_does_not_count_wherever_it_happens(clock, monkeypatch):
    compiling = {"s": 7.0}  # Of an earlier run in the same process.
    monkeypatch.setattr(module, "seconds_compiling", lambda: compiling["s"])
    spent = budget(time_budget=10.0)
    clock["s"], compiling["s"] = 45.0, 47.0  # 40 of 45 s went into kernels.
    assert spent.compiled == 40.0
    assert spent.seconds == 5.0
    assert spent.fraction() == 0.5
    clock["s"], spent.compiled_elsewhere = 48.0, 3.0  # A GPU's kernels took all of the last 3 s.
    assert spent.seconds == 5.0
