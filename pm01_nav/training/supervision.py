# SPDX-License-Identifier: Apache-2.0
"""Watch over a run: log, evaluate, keep the best, save, stop when the budget is spent."""

from __future__ import annotations

import math
import threading
import time
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm

from pm01_nav.benchmark.evaluate import Evaluator
from pm01_nav.config import write_atomically
from pm01_nav.envs.sb3_vec_env import NavVecEnv
from pm01_nav.errors import InputError
from pm01_nav.policy.export import greedy_policy
from pm01_nav.task.curriculum import Curriculum, apply
from pm01_nav.task.outcomes import Episodes
from pm01_nav.task.spinning import SpinMeter
from pm01_nav.training.advice import findings
from pm01_nav.training.algorithm_config import Algorithm
from pm01_nav.training.budget import Budget
from pm01_nav.training.checkpoint import save_checkpoint, save_weights
from pm01_nav.training.config import RunConfig
from pm01_nav.training.curiosity import intrinsic_rewards
from pm01_nav.training.divergence import check_finite
from pm01_nav.training.environment import observation_statistics
from pm01_nav.training.history import History
from pm01_nav.training.pace import Pace
from pm01_nav.training.remote_batch import Batch
from pm01_nav.training.run_folder import RunFolder

EVALUATION_SEED = 1_000_003
"""Worlds of the periodic evaluation; neither trained on nor those of `pm01 evaluate`."""
WATCHED_ROBOTS = 64
"""So many robots are looked at for spinning."""
WARN_EVERY = 10
"""Iterations between two looks for what goes wrong."""


class Progress(Protocol):
    """Whoever wants to show how a run is getting on."""

    def started(self, message: str) -> None:
        """Say how the run was set up."""

    def iteration(self, fraction: float, row: dict[str, float], steps_per_second: float) -> None:
        """Show one iteration; ``fraction`` of the budget is spent."""

    def evaluated(self, steps: int, summary: dict[str, Any]) -> None:
        """Show an evaluation on held-out worlds."""

    def warned(self, steps: int, text: str) -> None:
        """Show what seems to go wrong."""


class NoProgress:
    """Shows nothing."""

    def started(self, message: str) -> None:
        """Show nothing."""

    def iteration(self, fraction: float, row: dict[str, float], steps_per_second: float) -> None:
        """Show nothing."""

    def evaluated(self, steps: int, summary: dict[str, Any]) -> None:
        """Show nothing."""

    def warned(self, steps: int, text: str) -> None:
        """Show nothing."""


@dataclass(frozen=True)
class TrainResult:
    """How a run ended."""

    steps: int
    seconds: float
    interrupted: bool
    best_success_rate: float
    best_steps: int


class Supervision(BaseCallback):
    """Log, evaluate, save and stop, always between two iterations, where the state is whole."""

    def __init__(
        self,
        config: RunConfig,
        folder: RunFolder,
        batch: Batch,
        curriculum: Curriculum,
        budget: Budget,
        progress: Progress,
        algorithm: Algorithm,
    ) -> None:
        """Watch over one run."""
        super().__init__()
        self.config, self.folder, self.algorithm = config, folder, algorithm
        self.batch, self.curriculum = batch, curriculum
        self.budget, self.progress = budget, progress
        self.history = History()
        self.best = {"success_rate": -1.0, "steps": 0, "spl": 0.0}
        self.interrupted = threading.Event()
        self._next_evaluation = config.train.eval_every
        self._evaluated_at = -1
        self._evaluation_takes = math.inf
        self._saving = Pace(config.train.checkpoint_every)
        self._writing = Pace(config.train.checkpoint_every)
        self._rounds = 0
        self._spin: SpinMeter | None = None
        self._warned: set[str] = set()
        self._iteration_at: float | None = None
        self._finished = False
        self._evaluator: Evaluator | None = None

    @property
    def _learner(self) -> Any:
        return self.model

    def watch(self, learner: Any) -> None:
        """Look after a learner of our own, as SB3's is given one by SB3."""
        self.model = learner

    def between_iterations(self, steps: int) -> bool:
        """Do what is due between two iterations of a learner of our own; tell whether to go on."""
        self.num_timesteps = steps
        self._on_rollout_start()
        return not self._finished

    def _on_step(self) -> bool:
        if self._finished:
            return False
        env = self.training_env.unwrapped
        assert isinstance(env, NavVecEnv)
        self.note(env.last_episodes)
        self.watch_turning(env.batch.simulator.state.pose[:WATCHED_ROBOTS], env.last_episodes)
        return True

    def watch_turning(self, pose: NDArray[np.float64], episodes: Episodes | None) -> None:
        """Follow the first robots, now at ``pose`` (n, 3), to see whether they spin."""
        if self._spin is None:
            self._spin = SpinMeter(pose)
            return
        begun = None
        if episodes is not None:
            begun = np.zeros(self.batch.num_envs, dtype=np.bool_)
            begun[episodes.indices] = True
            begun = begun[: len(pose)]
        self._spin.note(pose, begun)

    def note(self, episodes: Episodes | None) -> None:
        """Note the training episodes that ended, if any."""
        self.curriculum.update(episodes)
        if episodes is not None:
            self.history.add_episodes(episodes)

    def _on_rollout_start(self) -> None:
        """Run between two iterations: the last update is done, the next rollout not begun.

        Raises:
            InputError: the training diverged.
        """
        check_finite(self._learner.policy, self.config.train.algo)
        self._rounds += 1
        if (self._rounds - 1) % self._rounds_per_iteration:
            return
        self.budget.steps_done = self.num_timesteps
        duration = None if self._iteration_at is None else time.perf_counter() - self._iteration_at
        if duration is not None:
            self._end_iteration(duration)
        spent = self.budget.fraction() >= 1.0
        self._evaluate_if_due(spent)
        if spent:
            self.logger.dump(self.num_timesteps)  # SB3 will not get to it any more
        self._finished = spent or self.interrupted.is_set()
        # The next occasion is an iteration away.
        due = duration is not None and self._saving.due(duration)
        if due or self._finished:
            self.save()
        self._iteration_at = time.perf_counter()

    def _evaluate_if_due(self, spent: bool) -> None:
        due = self.num_timesteps >= self._next_evaluation
        if due and not spent and self._saving.due(self._evaluation_takes):
            # The next occasion is after the evaluation.
            self.save()
        if due:
            self._next_evaluation += self.config.train.eval_every
        if due or (spent and self._evaluated_at != self.num_timesteps):
            began = time.perf_counter()
            self.evaluate()
            self._evaluation_takes = time.perf_counter() - began

    @property
    def _rounds_per_iteration(self) -> int:
        return getattr(self.config.train.hyperparameters, "log_interval", 1)

    def _end_iteration(self, duration: float) -> None:
        rate = self.config.train.hyperparameters.samples / duration
        metrics = self.curriculum.metrics()
        more = {"spinning": self._spin.share()} if self._spin else None
        row = self.history.end_iteration(self.budget.seconds, self.num_timesteps, metrics, more)
        self._warn()
        apply(self.curriculum, self.batch)
        for name, value in row.items():
            self.logger.record(name if "/" in name else f"train_episodes/{name}", value)
        self.logger.record("time/steps_per_second", rate)
        for intrinsic in intrinsic_rewards(getattr(self._learner, "env", None)).values():
            for name, value in intrinsic.metrics.items():
                self.logger.record(name, value)
        self.progress.iteration(self.budget.fraction(), row, rate)
        if isinstance(self._learner, OffPolicyAlgorithm):
            self._learner.dump_logs()  # The others do it themselves after the next rollout.

    def _warn(self) -> None:
        """Say what seems to go wrong, each thing once."""
        if len(self.history.columns["seconds"]) % WARN_EVERY:
            return
        for name, text in findings(self.history.columns).items():
            if name not in self._warned:
                self._warned.add(name)
                self.progress.warned(self.num_timesteps, text)

    def evaluate(self) -> None:
        """Measure the greedy policy on held-out worlds; keep it if it is the best so far."""
        if self._evaluator is None:
            episodes = self.config.train.eval_episodes
            self._evaluator = Evaluator(self.config.task, episodes, EVALUATION_SEED)
        policy = greedy_policy(
            self._learner.policy,
            self.batch.layout,
            self.config.task.control_dt,
            observation_statistics(getattr(self._learner, "env", None)),
        )
        summary = self._evaluator.summary(policy)
        self._evaluated_at = self.num_timesteps
        self.history.add_evaluation(self.budget.seconds, summary)
        for name in ("success_rate", "collision_rate", "timeout_rate", "spl"):
            self.logger.record(f"eval/{name}", summary[name])
        self.progress.evaluated(self.num_timesteps, summary)
        # Later is better at equal success: the learning rate has fallen further.
        if summary["success_rate"] >= self.best["success_rate"]:
            self.best = {"success_rate": summary["success_rate"], "steps": self.num_timesteps}
            save_weights(self.folder.best, self._learner)

    def save(self) -> None:
        """Write the last checkpoint and, less often if it is long, the history for others."""
        state = self.state()
        with self._saving.spent():
            save_checkpoint(self.folder.last, self._learner, self.algorithm, self.batch, state)
        if self._finished or self._writing.due():
            with self._writing.spent():
                write_atomically(self.folder.history, self.history.to_json())

    def state(self) -> dict[str, Any]:
        """Return what a checkpoint must know beyond learner and environments."""
        return {
            "history": self.history.state_dict(),
            "curriculum": self.curriculum.state_dict(),
            "best": self.best,
            "next_evaluation": self._next_evaluation,
            "evaluated_at": self._evaluated_at,
            "seconds": self.budget.seconds,
            "learning_since": self.budget.learning_since,
            "spin": self._spin.state_dict() if self._spin else None,
            "warned": sorted(self._warned),
        }

    def load_state(self, state: dict[str, Any]) -> None:
        """Go on from ``state``.

        Raises:
            InputError: the curriculum was another one.
        """
        self.history.load_state_dict(state["history"])
        try:
            self.curriculum.load_state_dict(state.get("curriculum", {}))
        except ValueError as error:
            raise InputError(
                f"train.curriculum = {self.config.train.curriculum!r}: {self.folder.path} was "
                f"made with another: {error}"
            ) from error
        apply(self.curriculum, self.batch)
        self.best = state["best"]
        self._next_evaluation = state["next_evaluation"]
        self._evaluated_at = state.get("evaluated_at", -1)
        self._warned = set(state["warned"])
        if state["spin"] is not None:
            self._spin = SpinMeter(np.zeros((len(state["spin"]["yaw"]), 3)))
            self._spin.load_state_dict(state["spin"])

    def result(self) -> TrainResult:
        """Return how the run ended."""
        return TrainResult(
            steps=self.budget.steps_done,
            seconds=self.budget.seconds,
            interrupted=self.interrupted.is_set(),
            best_success_rate=self.best["success_rate"],
            best_steps=int(self.best["steps"]),
        )
