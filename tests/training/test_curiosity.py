# SPDX-License-Identifier: Apache-2.0
"""Intrinsic rewards: what is new pays, what is known does not, and the task's reward stays."""

from __future__ import annotations

import time

import numpy as np
import pytest
import torch
from gymnasium import spaces
from stable_baselines3.common.vec_env import VecEnv

from pm01_nav.training.curiosity import ICM, RND, IntrinsicReward, add_curiosity, intrinsic_rewards
from pm01_nav.training.curiosity_config import ICMConfig, RNDConfig
from pm01_nav.training.run_folder import RunFolder
from pm01_nav.training.trainer import train
from tests.training.progress import Quiet
from tests.training.test_algorithms import config, curve, same

SMALL = {"hidden_size": 8, "feature_size": 4, "update_every": 4, "batch_size": 16, "share": 1.0}


class Line(VecEnv):
    """Points that an action moves along a line; the reward is 1, every tenth step is the last."""

    def __init__(self, count: int = 8):
        super().__init__(
            count, spaces.Box(-np.inf, np.inf, (2,)), spaces.Box(-1.0, 1.0, (2,), np.float32)
        )
        self.count, self.given = 0, np.zeros((count, 2))

    def reset(self):
        self.count, self.place = 0, np.zeros((self.num_envs, 2), dtype=np.float32)
        return self.place.copy()

    def step_async(self, actions):
        self.given = actions

    def step_wait(self):
        self.place = (self.place + self.given).astype(np.float32)
        self.count += 1
        done = np.full(self.num_envs, self.count == 10)
        last = [{"terminal_observation": place.copy()} for place in self.place]
        infos = last if done[0] else [{} for _ in last]
        if done[0]:
            self.reset()
        return self.place.copy(), np.ones(self.num_envs, dtype=np.float32), done, infos

    def close(self):
        pass

    def get_attr(self, attr_name, indices=None):
        return [None] * self.num_envs

    def set_attr(self, attr_name, value, indices=None):
        pass

    def env_method(self, method_name, *args, indices=None, **kwargs):
        return []

    def env_is_wrapped(self, wrapper_class, indices=None):
        return [False] * self.num_envs


def test_icm_equations_by_hand():
    module = ICM(1, 1, ICMConfig(hidden_size=1, feature_size=1, beta=0.25))
    with torch.no_grad():
        for parameter in module.parameters():
            parameter.zero_()
        for layer in (module.encoder[0], module.encoder[2]):
            layer.weight.fill_(1.0)  # features are the observation, if positive
    before, action, after = (torch.tensor([[value]]) for value in (1.0, 0.5, 3.0))
    # The forward model says 0 instead of 3: 9 / 2. The inverse model says 0 instead of 0.5.
    assert module.novelty(before, action, after).item() == pytest.approx(4.5)
    assert module.loss(before, action, after).item() == pytest.approx(0.75 * 0.25 + 0.25 * 4.5)


def test_icm_features_do_not_learn_from_the_forward_model():
    module = ICM(2, 2, ICMConfig(beta=1.0))
    one = torch.ones(4, 2)
    module.loss(one, one, 2 * one).backward()
    assert all(p.grad is None or not p.grad.any() for p in module.encoder.parameters())
    assert any(p.grad.any() for p in module.forward_model.parameters())


@pytest.mark.parametrize(("kind", "settings"), [(ICM, ICMConfig), (RND, RNDConfig)])
def test_what_was_seen_often_is_no_longer_new(kind, settings):
    torch.manual_seed(0)
    module = kind(2, 2, settings())
    rng = np.random.default_rng(0)
    known = [torch.tensor(rng.normal(0, 0.3, (256, 2)), dtype=torch.float32) for _ in range(2)]
    known.append(known[0] + known[1])
    strange = [known[0] + 4.0, known[1], known[2] + 4.0]
    optimizer = torch.optim.Adam([p for p in module.parameters() if p.requires_grad], lr=1e-2)
    for _ in range(300):
        optimizer.zero_grad()
        module.loss(*known).backward()
        optimizer.step()
    with torch.no_grad():
        assert module.novelty(*known).mean() < 0.2 * module.novelty(*strange).mean()


def test_rewards_add_up_and_the_task_s_own_stays():
    torch.manual_seed(0)
    env = add_curiosity(
        Line(), ICMConfig(weight=0.5, **SMALL), RNDConfig(weight=0.25, **SMALL), seed=0
    )
    assert list(intrinsic_rewards(env)) == ["rnd", "icm"]  # from the outside in
    plain = Line()
    assert np.array_equal(env.reset(), plain.reset())
    rng = np.random.default_rng(1)
    for _ in range(25):
        action = rng.uniform(-1, 1, (8, 2)).astype(np.float32)
        seen, reward, done, _ = env.step(action)
        expected, _, ends, _ = plain.step(action)
        assert np.array_equal(seen, expected)
        assert np.array_equal(done, ends)
        assert (reward > 1.0).all()
    for wrapper in intrinsic_rewards(env).values():
        assert set(wrapper.metrics) == {f"{wrapper.name}/loss", f"{wrapper.name}/reward"}


def test_no_weight_no_reward():
    env = add_curiosity(Line(), None, RNDConfig(weight=0.0, **SMALL), seed=0)
    env.reset()
    assert env.step(np.ones((8, 2), dtype=np.float32))[1].tolist() == [1.0] * 8


def test_end_of_an_episode_is_judged_by_its_last_observation():
    env = add_curiosity(Line(), ICMConfig(**SMALL), None, seed=0)
    assert isinstance(env, IntrinsicReward)
    env.reset()
    for _ in range(10):
        env.step(np.ones((8, 2), dtype=np.float32))
    # The tenth step led to (10, 10), not to the next episode's beginning.
    assert env._seen.mean == pytest.approx([5.5, 5.5], rel=1e-3)


def test_run_with_curiosity_resumes_as_if_never_stopped(tmp_path):
    settings = config("ppo", "normalized")
    more = {"icm": ICMConfig(**SMALL), "rnd": RNDConfig(**SMALL)}
    settings = settings.model_copy(update={"train": settings.train.model_copy(update=more)})

    def run(folder, progress, **options):
        began = time.perf_counter()
        return train(settings, RunFolder(folder), progress, started_at=began, **options)

    run(tmp_path / "whole", Quiet())
    run(tmp_path / "parts", Quiet(interrupt_after=2))
    run(tmp_path / "parts", Quiet(), resume=True)
    first, second = (
        torch.load(tmp_path / name / "last.pt", weights_only=True) for name in ("whole", "parts")
    )
    assert {"icm", "rnd", "obs_rms"} <= set(first["environment"])
    assert same(first["environment"], second["environment"])
    assert same(first["policy"], second["policy"])
    assert curve(tmp_path / "whole") == curve(tmp_path / "parts")
