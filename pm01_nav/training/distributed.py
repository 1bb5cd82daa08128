# SPDX-License-Identifier: Apache-2.0
"""PPO whose experience is collected by workers: processes of this machine, or a Ray cluster's.

In turn, the workers drive a part of the robots each with the newest policy, and the learner learns
from all of their experience, as SB3's PPO does on one machine.
"""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np
from gymnasium.spaces import flatdim
from stable_baselines3 import PPO

from pm01_nav.envs.spaces import action_space
from pm01_nav.standing import Host, StandingWorkers
from pm01_nav.task.outcomes import Episodes
from pm01_nav.training.algorithm_config import Rate
from pm01_nav.training.config import RunConfig
from pm01_nav.training.networks import network_space
from pm01_nav.training.ppo import PPOAlgorithm, update_arguments
from pm01_nav.training.remote_batch import RemoteBatch
from pm01_nav.training.rollout import Assignment, Rollout, collect
from pm01_nav.training.supervision import WATCHED_ROBOTS, Supervision


class DistributedPPO(PPO):
    """SB3's PPO, but for where its experience comes from."""

    def __init__(
        self, config: RunConfig, batch: RemoteBatch, *, learning_rate: Rate, host: Host
    ) -> None:
        """Build the learner; the workers are started by ``learn``."""
        settings = config.train.hyperparameters
        super().__init__(
            PPOAlgorithm().policy_class(settings),
            None,  # type: ignore[arg-type]  # as SB3 itself does before it loads a model
            learning_rate=learning_rate,
            policy_kwargs=PPOAlgorithm().policy_arguments(settings, batch.layout),
            seed=config.train.seed,
            device="cpu",
            _init_setup_model=False,
            **update_arguments(settings),
        )
        self.observation_space = network_space(settings, batch.layout)
        self.action_space = action_space(batch.layout)
        self.n_envs = batch.num_envs
        self._setup_model()
        self._config, self._batch, self._host = config, batch, host
        self._last_obs = np.zeros((self.n_envs, flatdim(self.observation_space)), np.float32)
        self._last_episode_starts = np.ones(self.n_envs, dtype=np.bool_)

    def learn(self, total_timesteps: int, callback: Supervision, **_: Any) -> DistributedPPO:  # type: ignore[override]
        """Let workers collect and learn from it in turn, until ``callback`` has had enough.

        Raises:
            InputError: a worker cannot do its part.
        """
        callback.watch(self)
        with StandingWorkers(self._host, self._batch.workers) as workers:
            while callback.between_iterations(self.num_timesteps):
                rollouts = self._collect(workers)
                self._report(callback, rollouts)
                self._fill(rollouts)
                self.num_timesteps += self.n_envs * self.n_steps
                self.logger.record("workers/replaced", workers.replaced)
                self._update_current_progress_remaining(self.num_timesteps, total_timesteps)
                self.train()
                self.logger.dump(self.num_timesteps)
        return self

    def _collect(self, workers: StandingWorkers) -> list[Rollout]:
        policy = {name: value.clone() for name, value in self.policy.state_dict().items()}
        iteration = self.num_timesteps // (self.n_envs * self.n_steps)
        states = self._batch.states

        def assign(worker: int, *, fresh: bool = True) -> Assignment:
            first = worker * self._batch.robots
            return Assignment(
                config=self._config,
                first=first,
                robots=self._batch.robots,
                iteration=iteration,
                watched=min(max(WATCHED_ROBOTS - first, 0), self._batch.robots),
                policy=policy,
                draws=self._batch.simulator.draws,
                state=states[worker] if fresh else None,
            )

        assignments = [assign(i, fresh=workers.fresh[i]) for i in range(self._batch.workers)]
        rollouts = workers.run(collect, assignments, assign)
        self._batch.states = [rollout.state for rollout in rollouts]
        return rollouts

    def _report(self, supervision: Supervision, rollouts: list[Rollout]) -> None:
        """Tell of what ended, step by step as if all robots had driven here."""
        poses = np.concatenate([rollout.poses for rollout in rollouts], axis=1)
        for step in range(self.n_steps):
            ended = _together([rollout.episodes[step] for rollout in rollouts])
            supervision.note(ended)
            supervision.watch_turning(poses[step], ended)

    def _fill(self, rollouts: list[Rollout]) -> None:
        """Put all experience into SB3's buffer."""
        buffer = self.rollout_buffer
        buffer.reset()
        for name in rollouts[0].buffer:
            setattr(buffer, name, np.concatenate([r.buffer[name] for r in rollouts], axis=1))
        buffer.pos, buffer.full = self.n_steps, True
        states = [rollout.state for rollout in rollouts]
        self._last_obs = np.concatenate([state["last_obs"] for state in states])
        starts = np.concatenate([state["episode_starts"] for state in states])
        self._last_episode_starts = starts


def _together(parts: list[Episodes | None]) -> Episodes | None:
    """Return the episodes of all workers that ended in one step as one, if there are any."""
    ended = [part for part in parts if part is not None]
    if not ended:
        return None
    arrays: dict[str, Any] = {
        f.name: np.concatenate([getattr(part, f.name) for part in ended])
        for f in fields(Episodes)
        if f.name not in ("terms", "faults")
    }
    terms = {n: np.concatenate([part.terms[n] for part in ended]) for n in ended[0].terms}
    faults = {i: reason for part in ended for i, reason in part.faults.items()}
    return Episodes(**arrays, terms=terms, faults=faults)
