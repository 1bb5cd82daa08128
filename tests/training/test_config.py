# SPDX-License-Identifier: Apache-2.0
"""Presets of hyper-parameters."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from pm01_nav.cli.train import fresh_config
from pm01_nav.task.tasks import task_config
from pm01_nav.training.config import TrainConfig, run_config


def test_a_preset_stands_below_what_is_given():
    given = {"preset": "quick", "steps": 1, "ppo": {"gamma": 0.97}}
    ppo = TrainConfig.model_validate(given).ppo
    assert (ppo.n_envs, ppo.net_arch, ppo.gamma) == (256, (64, 64), 0.97)
    # What the preset does not name is the default's.
    assert ppo.ent_coef == TrainConfig(steps=1).ppo.ent_coef
    stored = TrainConfig.model_validate(given).model_dump()
    assert TrainConfig.model_validate(stored).ppo == ppo


def test_an_empty_section_beside_a_preset_is_refused_in_words():
    with pytest.raises(ValidationError, match="ppo"):
        TrainConfig.model_validate({"preset": "quick", "steps": 1, "ppo": None})


def test_a_preset_is_for_ppo_alone():
    with pytest.raises(ValidationError, match="ppo alone"):
        TrainConfig.model_validate({"preset": "quick", "steps": 1, "algo": "sac"})


def test_a_preset_for_seconds_has_few_worlds_and_is_looked_at_at_the_end():
    options: dict = {"task": "static", "config_file": None, "n_envs": None}
    config = fresh_config(options | {"preset": "quick", "steps": 1, "changes": ()})
    assert (config.task.num_worlds, config.train.eval_every) == (256, 1_000_000)
    # In a sweep likewise; and what is given goes before.
    changes = ("train.preset=quick", "task.num_worlds=7", "train.eval_every=9")
    config = fresh_config(options | {"steps": 1, "changes": changes}, {"eval_every": 250_000})
    assert (config.task.num_worlds, config.train.eval_every) == (7, 9)
    config = fresh_config(
        options | {"preset": "quick", "steps": 1, "changes": ()}, {"eval_every": 5}
    )
    assert config.train.eval_every == 1_000_000


def test_off_policy_runs_are_looked_at_more_often_unless_told_otherwise():
    task = task_config("static")
    assert run_config(task, {"steps": 1}, "test").train.eval_every == 1_000_000
    assert run_config(task, {"steps": 1, "algo": "td3"}, "test").train.eval_every == 100_000
    # What a command wants stands below both.
    below = {"eval_every": 5}
    assert run_config(task, {"steps": 1}, "test", below).train.eval_every == 5
    assert run_config(task, {"steps": 1, "algo": "td3"}, "test", below).train.eval_every == 100_000
    own = {"steps": 1, "algo": "td3", "eval_every": 7}
    assert run_config(task, own, "test", below).train.eval_every == 7
