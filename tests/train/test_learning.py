# SPDX-License-Identifier: Apache-2.0
"""Every algorithm learns to drive to a goal where nothing stands in the way."""

from __future__ import annotations

import time

import pytest

from pm01_nav.task.tasks import task_config
from pm01_nav.train.config import RunConfig, TrainConfig
from pm01_nav.train.run_folder import RunFolder
from pm01_nav.train.trainer import train
from tests.train.progress import Quiet

STEPS = {"ppo": 400_000, "ppo_lstm": 400_000, "sac": 100_000, "td3": 100_000, "tqc": 100_000}
"""Those of a replay buffer need fewer, and more time for each."""


@pytest.mark.slow
@pytest.mark.parametrize("algo", list(STEPS))
def test_algorithm_learns_to_drive_to_a_goal(algo, tmp_path):
    settings = {"algo": algo, "steps": STEPS[algo], "threads": 1, "eval_episodes": 200}
    config = RunConfig(task=task_config("empty"), train=TrainConfig.model_validate(settings))
    folder, began = RunFolder(tmp_path / "x"), time.perf_counter()
    result = train(config, folder, Quiet(), started_at=began)
    # Random actions reach next to no goal in the time.
    assert result.best_success_rate > 0.9
