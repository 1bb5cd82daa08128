# SPDX-License-Identifier: Apache-2.0
"""The zoo's policies still do what their cards say."""

from __future__ import annotations

from importlib import resources

import pytest

from pm01_nav.benchmark.evaluate import Evaluator
from pm01_nav.benchmark.policies import load_policy, trained_task
from pm01_nav.documents import load_yaml
from pm01_nav.task.tasks import task_config
from pm01_nav.worlds.suites import suites
from pm01_nav.zoo import zoo_names

EPISODES = 400


def published() -> list[tuple[str, str, list[float]]]:
    """Return policies, suites and the intervals of success that the cards give for them."""
    rows = []
    for name in zoo_names():
        card = resources.files("pm01_nav") / "zoo" / name / "card.yaml"
        with resources.as_file(card) as path:
            results = load_yaml(path)["results"]
        named = [row for row in results if "suite" in row]
        rows += [(name, row["suite"], row["success_rate_ci95"]) for row in named]
    return [row for row in rows if row[1] in suites()]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "suite", "interval"), published())
def test_success_is_what_the_card_says(name: str, suite: str, interval: list[float]) -> None:
    task = trained_task(f"zoo:{name}")
    assert task is not None
    time_limit = task_config(suite).time_limit_s
    task = task.model_copy(update={"suite": suite, "time_limit_s": time_limit})
    policy = load_policy(f"zoo:{name}", task.robot_spec(), task.control_dt)
    found = Evaluator(task, EPISODES, seed=0).summary(policy)
    low, high = found["success_rate_ci95"]
    # The cards' episodes are 1000, of which these are the first.
    assert low <= interval[1]
    assert high >= interval[0]
