# SPDX-License-Identifier: Apache-2.0
"""What tests of the benchmark share."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pm01_nav.benchmark.recorder import EpisodeResults


@pytest.fixture(scope="session")
def policy_file(tmp_path_factory) -> Path:
    """Return the file of an untrained policy for the task ``static``."""
    from pm01_nav.policy.export import export_policy, policy_metadata
    from pm01_nav.task.config import observation_layout
    from pm01_nav.task.tasks import task_config
    from pm01_nav.training.algorithms.ppo import PPOConfig
    from pm01_nav.training.ppo import make_policy

    config = task_config("static")
    robot = config.robot_spec()
    layout = observation_layout(config, robot)
    metadata = policy_metadata(layout, robot, config.control_dt, {"task": "static"})
    path = tmp_path_factory.mktemp("policy") / "untrained.onnx"
    export_policy(make_policy(PPOConfig(net_arch=(8, 8)), layout), layout, metadata, path)
    return path


@pytest.fixture
def make_results():
    """Return a function that makes results of given outcomes, one letter an episode.

    s is a success, c a collision, t a timeout and f a failure.
    """

    def make(outcomes: str, **arrays) -> EpisodeResults:
        n, letters = len(outcomes), np.array(list(outcomes))
        values = {
            "world": np.arange(n),
            "success": letters == "s",
            "collision": letters == "c",
            "steps": np.full(n, 100),
            "moving_time": np.full(n, 9.8),
            "path_length": np.full(n, 5.0),
            "shortest_path": np.full(n, 4.0),
            "reference_path": np.full(n, np.nan),
            "min_clearance": np.full(n, 0.2),
            "mean_clearance": np.full(n, 0.5),
            "jerk": np.full(n, 1.0),
            "turn_reversals": np.full(n, 6.0),
            "intrusion": np.full(n, np.nan),
            "failure": np.where(letters == "f", "RuntimeError: no", ""),
        }
        return EpisodeResults(**(values | arrays))

    return make
