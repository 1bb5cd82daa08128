# SPDX-License-Identifier: Apache-2.0
"""Rewards that a learner gives itself for what is new to it: ICM and RND.

Each is a wrapper of SB3's environments that adds its share to the task's reward and learns from
what it sees. They can be put around each other; the task's own terms stay as they are.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvStepReturn

from pm01_nav.errors import InputError
from pm01_nav.training.curiosity_config import CuriosityConfig, ICMConfig, RNDConfig

FloatArray = NDArray[np.float32]
OBSERVATION_CLIP = 5.0
"""Normalized observations are clipped to this, as in RND's paper."""


def network(sizes: list[int]) -> torch.nn.Sequential:
    """Return layers of these sizes with ReLU between them."""
    layers: list[torch.nn.Module] = []
    for n_in, n_out in pairwise(sizes):
        layers += [torch.nn.Linear(n_in, n_out), torch.nn.ReLU()]
    return torch.nn.Sequential(*layers[:-1])


class ICM(torch.nn.Module):
    """The intrinsic curiosity module (Pathak et al. 2017).

    The inverse model tells the action from the features before and after a step, so that features
    hold what the robot has to do with; the error of the forward model in them is what is new.
    """

    def __init__(self, size: int, actions: int, config: ICMConfig) -> None:
        """Build the three networks for observations of ``size`` numbers."""
        super().__init__()
        hidden, features = config.hidden_size, config.feature_size
        self.beta = config.beta
        self.encoder = network([size, hidden, features])
        self.inverse = network([2 * features, hidden, actions])
        self.forward_model = network([features + actions, hidden, features])

    def novelty(
        self, before: torch.Tensor, action: torch.Tensor, after: torch.Tensor
    ) -> torch.Tensor:
        """Return half the squared error of the predicted features, shape (n,) (equation 6)."""
        return self._forward_error(self.encoder(before), action, self.encoder(after))

    def loss(self, before: torch.Tensor, action: torch.Tensor, after: torch.Tensor) -> torch.Tensor:
        """Return (1 - beta) of the inverse and beta of the forward model's error (equation 7)."""
        first, second = self.encoder(before), self.encoder(after)
        told = self.inverse(torch.cat([first, second], dim=1))
        inverse = (told - action).square().sum(dim=1).mean()
        # Features learn from the inverse model alone, or they would become easy to predict.
        forward = self._forward_error(first.detach(), action, second.detach()).mean()
        return (1.0 - self.beta) * inverse + self.beta * forward

    def _forward_error(
        self, first: torch.Tensor, action: torch.Tensor, second: torch.Tensor
    ) -> torch.Tensor:
        predicted = self.forward_model(torch.cat([first, action], dim=1))
        return 0.5 * (predicted - second).square().sum(dim=1)


class RND(torch.nn.Module):
    """Random network distillation (Burda et al. 2018).

    A network learns to answer as a fixed random one does; where it cannot yet, nothing has been.
    """

    def __init__(self, size: int, actions: int, config: RNDConfig) -> None:
        """Build both networks for observations of ``size`` numbers."""
        super().__init__()
        hidden, features = config.hidden_size, config.feature_size
        self.target = network([size, hidden, features]).requires_grad_(False)
        self.predictor = network([size, hidden, hidden, features])

    def novelty(
        self, before: torch.Tensor, action: torch.Tensor, after: torch.Tensor
    ) -> torch.Tensor:
        """Return the squared error of the prediction, shape (n,)."""
        return (self.predictor(after) - self.target(after)).square().sum(dim=1)

    def loss(self, before: torch.Tensor, action: torch.Tensor, after: torch.Tensor) -> torch.Tensor:
        """Return the mean novelty."""
        return self.novelty(before, action, after).mean()


class IntrinsicReward(VecEnvWrapper):
    """Add what is new, times a weight, to the reward; learn every so many steps."""

    def __init__(
        self, venv: VecEnv, name: str, module: ICM | RND, config: CuriosityConfig, seed: int
    ) -> None:
        """Wrap ``venv``; ``name`` is that of the logged metrics."""
        super().__init__(venv)
        assert venv.observation_space.shape is not None
        assert venv.action_space.shape is not None
        self.name, self.module, self.config = name, module, config
        self.metrics: dict[str, float] = {}
        """What the last round of learning found."""
        parameters = [p for p in module.parameters() if p.requires_grad]
        self.optimizer = torch.optim.Adam(parameters, lr=config.learning_rate)
        self._seen = RunningMeanStd(shape=venv.observation_space.shape)
        self._spread = RunningMeanStd(shape=())
        self._random = np.random.default_rng(seed)
        self._before = np.zeros((venv.num_envs, *venv.observation_space.shape), dtype=np.float32)
        self._actions = np.zeros((venv.num_envs, *venv.action_space.shape), dtype=np.float32)
        self._kept: list[tuple[FloatArray, FloatArray, FloatArray]] = []
        self._given: list[float] = []

    def reset(self) -> Any:
        """Start new episodes everywhere."""
        observation = self.venv.reset()
        assert isinstance(observation, np.ndarray)
        self._before = observation
        return observation

    def step_async(self, actions: NDArray[Any]) -> None:
        """Take the actions (num_envs, axes) for the next ``step_wait``."""
        self._actions = np.asarray(actions, dtype=np.float32)
        super().step_async(actions)

    def step_wait(self) -> VecEnvStepReturn:
        """Step, pay for what is new, and learn if it is time to."""
        observation, reward, done, infos = self.venv.step_wait()
        assert isinstance(observation, np.ndarray)
        after = observation
        if done.any():
            after = observation.copy()
            for i in np.flatnonzero(done):
                after[i] = infos[i]["terminal_observation"]
        self._seen.update(after)
        kept = (self._normal(self._before), self._actions, self._normal(after))
        with torch.no_grad():
            novelty = self.module.novelty(*map(torch.from_numpy, kept)).numpy()
        self._spread.update(novelty)
        intrinsic = self.config.weight * novelty / np.sqrt(self._spread.var + 1e-8)
        self._given.append(float(intrinsic.mean()))
        self._kept.append(kept)
        self._before = observation
        if len(self._kept) == self.config.update_every:
            self._learn()
        return observation, reward + intrinsic.astype(np.float32), done, infos

    def _normal(self, observation: FloatArray) -> FloatArray:
        values = (observation - self._seen.mean) / np.sqrt(self._seen.var + 1e-8)
        return np.clip(values, -OBSERVATION_CLIP, OBSERVATION_CLIP).astype(np.float32)

    def _learn(self) -> None:
        """Go once over a part of the steps since the last time."""
        columns = [np.concatenate(column) for column in zip(*self._kept, strict=True)]
        count = max(int(self.config.share * len(columns[0])), 1)
        chosen = self._random.permutation(len(columns[0]))[:count]
        losses = []
        for begin in range(0, count, self.config.batch_size):
            rows = chosen[begin : begin + self.config.batch_size]
            loss = self.module.loss(*(torch.from_numpy(column[rows]) for column in columns))
            self.optimizer.zero_grad()
            loss.backward()
            self.optimizer.step()
            losses.append(loss.item())
        if not np.isfinite(losses).all():
            raise InputError(f"{self.name} diverged; lower train.{self.name}.learning_rate")
        mean = {"loss": float(np.mean(losses)), "reward": float(np.mean(self._given))}
        self.metrics = {f"{self.name}/{name}": value for name, value in mean.items()}
        self._kept.clear()
        self._given.clear()

    def state_dict(self) -> dict[str, Any]:
        """Return what it takes to go on between two rounds of learning."""
        return {
            "module": self.module.state_dict(),
            "optimizer": self.optimizer.state_dict(),
            "seen": rms_state(self._seen),
            "spread": rms_state(self._spread),
            "random": self._random.bit_generator.state,
            "before": torch.from_numpy(self._before.copy()),
            "kept": [[torch.from_numpy(a) for a in kept] for kept in self._kept],
            "given": list(self._given),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from ``state_dict``."""
        self.module.load_state_dict(state["module"])
        self.optimizer.load_state_dict(state["optimizer"])
        load_rms(self._seen, state["seen"])
        load_rms(self._spread, state["spread"])
        self._random.bit_generator.state = state["random"]
        self._before = state["before"].numpy()
        self._kept = [(k[0].numpy(), k[1].numpy(), k[2].numpy()) for k in state["kept"]]
        self._given = list(state["given"])


def rms_state(rms: RunningMeanStd) -> dict[str, Any]:
    """Return a running mean and variance as tensors and numbers."""
    mean, variance = (torch.from_numpy(np.array(value)) for value in (rms.mean, rms.var))
    return {"mean": mean, "var": variance, "count": float(rms.count)}


def load_rms(rms: RunningMeanStd, state: dict[str, Any]) -> None:
    """Go on from ``rms_state``."""
    rms.mean, rms.var = state["mean"].numpy(), state["var"].numpy()
    rms.count = state["count"]


def add_curiosity(env: VecEnv, icm: ICMConfig | None, rnd: RNDConfig | None, seed: int) -> VecEnv:
    """Wrap ``env`` in the intrinsic rewards that are asked for."""
    assert env.observation_space.shape is not None
    assert env.action_space.shape is not None
    size, actions = env.observation_space.shape[0], env.action_space.shape[0]
    if icm is not None:
        env = IntrinsicReward(env, "icm", ICM(size, actions, icm), icm, seed)
    if rnd is not None:
        env = IntrinsicReward(env, "rnd", RND(size, actions, rnd), rnd, seed)
    return env


def intrinsic_rewards(env: VecEnv | None) -> dict[str, IntrinsicReward]:
    """Return the intrinsic rewards among the wrappers of ``env``, by name."""
    found: dict[str, IntrinsicReward] = {}
    while isinstance(env, VecEnvWrapper):
        if isinstance(env, IntrinsicReward):
            found[env.name] = env
        env = env.venv
    return found
