# SPDX-License-Identifier: Apache-2.0
"""Collect experience with a part of the robots, in a process or on a machine of its own.

The learner's side is ``distributed``. A worker keeps its robots from one rollout to the next; what
another one needs to go on in its place comes back with each rollout.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import Logger

from pm01_nav.envs.sb3_vec_env import NavVecEnv
from pm01_nav.task.navigation import NavigationBatch
from pm01_nav.task.outcomes import Episodes
from pm01_nav.task.worlds import world_pool
from pm01_nav.training.config import RunConfig
from pm01_nav.training.networks import privileged
from pm01_nav.training.ppo import PPOAlgorithm
from pm01_nav.training.remote_batch import Draws

BUFFERED = ("observations", "actions", "rewards", "episode_starts")
BUFFERED += ("values", "log_probs", "advantages", "returns")
"""Arrays of SB3's rollout buffer, each (n_steps, robots, ...)."""


_blocks: dict[int, Block] = {}
"""The robots that this process keeps, by the number of the first; it serves one run."""


@dataclass(frozen=True)
class Assignment:
    """A rollout to collect."""

    config: RunConfig
    first: int
    """Number of the first of this worker's robots among all."""
    robots: int
    iteration: int
    watched: int
    """The poses of so many of the robots are asked for."""
    policy: dict[str, torch.Tensor]
    draws: Draws
    state: dict[str, NDArray[Any]] | None
    """Where the robots are; None where the worker knows, or where they begin."""


@dataclass(frozen=True)
class Rollout:
    """What came of an assignment."""

    buffer: dict[str, NDArray[np.float32]]
    """By the names of ``BUFFERED``."""
    episodes: list[Episodes | None]
    """Those that ended in each step; robots are numbered among all."""
    poses: NDArray[np.float64]
    """Of the watched robots after each step, shape (n_steps, watched, 3)."""
    state: dict[str, NDArray[Any]]
    """What another worker needs to go on."""


def collect(assignment: Assignment) -> Rollout:
    """Collect a rollout with the robots that this process keeps.

    Raises:
        InputError: worlds or robot are unusable.
    """
    if assignment.first not in _blocks:
        _blocks[assignment.first] = Block(assignment.config, assignment.first, assignment.robots)
    return _blocks[assignment.first].collect(assignment)


class Block:
    """Some of a run's robots, and SB3's PPO to drive them."""

    def __init__(self, config: RunConfig, first: int, robots: int) -> None:
        """Put the robots into their worlds.

        Raises:
            InputError: worlds or robot are unusable.
        """
        import numba

        # Each worker is meant for one core, on any machine: results do not depend on it.
        numba.set_num_threads(1)
        torch.set_num_threads(1)
        task, settings = config.task, config.train.hyperparameters
        pool = world_pool(task, "train", task.num_worlds, config.train.seed)
        self._seed, self._first = config.train.seed, first
        self._batch = NavigationBatch(task, pool, robots, privileged=privileged(settings))
        seed = (config.train.seed << 32) + first
        self._env = NavVecEnv(self._batch, seed=seed, reward_scale=settings.reward_scale)
        own = {"n_envs": robots, "batch_size": robots * settings.n_steps}
        self._model = PPOAlgorithm().make(
            settings.model_copy(update=own),
            self._env,
            self._batch.layout,
            seed=config.train.seed,
            learning_rate=lambda _: 0.0,
        )
        self._model.set_logger(Logger(None, []))
        self._begun = False

    def collect(self, assignment: Assignment) -> Rollout:
        """Collect a rollout; see ``collect``."""
        model, batch = self._model, self._batch
        batch.simulator.draw_worlds(assignment.draws.weights)
        batch.simulator.limit_goal_distance(assignment.draws.goal_distance)
        watch = _Watch(self._env, self._first, assignment.watched)
        if not self._begun:
            model._setup_learn(2**62, watch)
            self._begun = True
        watch.init_callback(model)
        if assignment.state is not None:
            self._go_on(assignment.state)
        model.policy.load_state_dict(assignment.policy)
        # The noise of the actions depends on nothing that another worker would not know.
        entropy = np.random.SeedSequence([self._seed, assignment.iteration, self._first])
        torch.manual_seed(int(entropy.generate_state(1)[0]))
        model.collect_rollouts(self._env, watch, model.rollout_buffer, model.n_steps)
        buffer = {name: getattr(model.rollout_buffer, name) for name in BUFFERED}
        return Rollout(buffer, watch.episodes, np.array(watch.poses), self._state())

    def _state(self) -> dict[str, NDArray[Any]]:
        seen = np.asarray(self._model._last_obs)
        own = {"last_obs": seen, "episode_starts": np.array(self._model._last_episode_starts)}
        return self._batch.state_dict() | own

    def _go_on(self, state: dict[str, NDArray[Any]]) -> None:
        state = dict(state)
        self._model._last_obs = state.pop("last_obs")
        self._model._last_episode_starts = state.pop("episode_starts")
        self._batch.load_state_dict(state)


class _Watch(BaseCallback):
    """Note, step by step, what the learner's supervision wants to know."""

    def __init__(self, env: NavVecEnv, first: int, watched: int) -> None:
        super().__init__()
        self._env, self._first, self._watched = env, first, watched
        self.episodes: list[Episodes | None] = []
        self.poses: list[NDArray[np.float64]] = []

    def _on_step(self) -> bool:
        ended = self._env.last_episodes
        if ended is not None:
            # The last observations are large and nobody's concern but PPO's.
            ended = replace(
                ended,
                indices=ended.indices + self._first,
                final_observation=ended.final_observation[:0],
                faults={self._first + i: reason for i, reason in ended.faults.items()},
            )
        self.episodes.append(ended)
        self.poses.append(self._env.batch.simulator.state.pose[: self._watched].copy())
        return True
