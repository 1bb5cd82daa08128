# SPDX-License-Identifier: Apache-2.0
"""A training that diverges says so in one line, whichever algorithm it is."""

from __future__ import annotations

import pytest
import torch

from pm01_nav.errors import InputError
from pm01_nav.training.divergence import check_finite, divergence_told
from pm01_nav.training.run_folder import RunFolder
from pm01_nav.training.trainer import train
from tests.training.progress import Quiet
from tests.training.test_algorithms import config


def policy(weight: float = 1.0) -> torch.nn.Module:
    layer = torch.nn.Linear(2, 1)
    torch.nn.init.constant_(layer.weight, weight)
    return layer


@pytest.mark.parametrize("weight", [float("nan"), float("inf")])
def test_weights_that_are_not_finite_are_told(weight):
    check_finite(policy(), "sac")
    with pytest.raises(InputError, match=r"diverged.*lower train\.sac\.learning_rate"):
        check_finite(policy(weight), "sac")


def test_failure_of_an_update_is_told_if_it_diverged():
    nan = torch.tensor([float("nan")])
    with pytest.raises(InputError, match="diverged"), divergence_told(policy(), "ppo"):
        torch.distributions.Normal(nan, 1.0, validate_args=True)
    with pytest.raises(InputError, match="diverged"), divergence_told(policy(float("nan")), "ppo"):
        raise ValueError("something odd")
    with pytest.raises(InputError, match="diverged"), divergence_told(policy(), "td3"):
        raise InputError("actions must be finite numbers")


@pytest.mark.parametrize("kind", [InputError, ValueError, RuntimeError])
def test_other_failures_stay_what_they_are(kind):
    with pytest.raises(kind, match="something else"), divergence_told(policy(), "ppo"):
        raise kind("something else")


@pytest.mark.parametrize("algo", ["ppo", "td3"])
def test_training_that_diverges_says_so_in_one_line(tmp_path, algo):
    chosen = config(algo, "flat")
    section = chosen.train.hyperparameters.model_copy(update={"learning_rate": 1e10})
    settings = chosen.train.model_copy(update={algo: section, "eval_every": 10**9})
    chosen = chosen.model_copy(update={"train": settings})
    with pytest.raises(InputError, match=rf"diverged.*train\.{algo}\.learning_rate") as found:
        train(chosen, RunFolder(tmp_path / "x"), Quiet(), started_at=0.0)
    assert "\n" not in str(found.value)
