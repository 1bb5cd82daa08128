# SPDX-License-Identifier: Apache-2.0
"""Train a policy: learn, look at held-out worlds, keep checkpoints, stop at the budget's end."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType
from typing import Any, Protocol

import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import Logger, configure

from pm01_nav.arrays import Arrays
from pm01_nav.benchmark.evaluate import Evaluator
from pm01_nav.config import write_atomically
from pm01_nav.envs.devices import arrays_on
from pm01_nav.envs.sb3_vec_env import NavVecEnv
from pm01_nav.errors import InputError
from pm01_nav.policy.export import export_policy, greedy_policy, policy_metadata
from pm01_nav.provenance import provenance
from pm01_nav.sim.warm_up import warm_up
from pm01_nav.task.config import observation_layout
from pm01_nav.task.curriculum import Curriculum, apply, make_curriculum
from pm01_nav.task.navigation import Episodes, NavigationBatch
from pm01_nav.task.worlds import world_pool
from pm01_nav.train.budget import Budget
from pm01_nav.train.checkpoint import load_checkpoint, restore, save_checkpoint
from pm01_nav.train.config import RunConfig
from pm01_nav.train.history import History
from pm01_nav.train.ppo import make_policy, make_ppo
from pm01_nav.train.run_folder import RunFolder
from pm01_nav.train.runtime import ThreadChoice, choose_threads, keep_freed_memory

COMPILED_WITHIN_S = 3.0
"""Loading compiled kernels takes less than this."""
EVALUATION_SEED = 1_000_003
"""Worlds of the periodic evaluation; neither trained on nor those of `pm01 evaluate`."""


class Progress(Protocol):
    """Whoever wants to show how a run is getting on."""

    def started(self, message: str) -> None:
        """Say how the run was set up."""

    def iteration(self, fraction: float, row: dict[str, float], steps_per_second: float) -> None:
        """Show one iteration; ``fraction`` of the budget is spent."""

    def evaluated(self, steps: int, summary: dict[str, Any]) -> None:
        """Show an evaluation on held-out worlds."""


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
        batch: NavigationBatch,
        curriculum: Curriculum,
        budget: Budget,
        progress: Progress,
    ) -> None:
        """Watch over one run."""
        super().__init__()
        self.config, self.folder = config, folder
        self.batch, self.curriculum = batch, curriculum
        self.budget, self.progress = budget, progress
        self.history = History()
        self.best = {"success_rate": -1.0, "steps": 0, "spl": 0.0}
        self.interrupted = threading.Event()
        self._next_evaluation = config.train.eval_every
        self._saved_at = time.perf_counter()
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
        assert isinstance(self.training_env, NavVecEnv)
        if self._finished:
            return False
        self.note(self.training_env.last_episodes)
        return True

    def note(self, episodes: Episodes | None) -> None:
        """Note the training episodes that ended, if any."""
        self.curriculum.update(episodes)
        if episodes is not None:
            self.history.add_episodes(episodes)

    def _on_rollout_start(self) -> None:
        """Run between two iterations: the last update is done, the next rollout not begun."""
        self.budget.steps_done = self.num_timesteps
        if self._iteration_at is not None:
            self._end_iteration()
        if self.num_timesteps >= self._next_evaluation:
            self._next_evaluation += self.config.train.eval_every
            self.evaluate()
        spent = self.budget.fraction() >= 1.0
        if spent:
            self.evaluate()
            self.logger.dump(self.num_timesteps)  # SB3 will not get to it any more
        self._finished = spent or self.interrupted.is_set()
        due = time.perf_counter() - self._saved_at >= self.config.train.checkpoint_every
        if due or self._finished:
            self.save()
        self._iteration_at = time.perf_counter()

    def _end_iteration(self) -> None:
        assert self._iteration_at is not None
        duration = time.perf_counter() - self._iteration_at
        rate = self.config.train.ppo.n_envs * self.config.train.ppo.n_steps / duration
        metrics = self.curriculum.metrics()
        row = self.history.end_iteration(self.budget.seconds, self.num_timesteps, metrics)
        apply(self.curriculum, self.batch)
        for name, value in row.items():
            self.logger.record(name if "/" in name else f"train_episodes/{name}", value)
        self.logger.record("time/steps_per_second", rate)
        self.progress.iteration(self.budget.fraction(), row, rate)

    def evaluate(self) -> None:
        """Measure the greedy policy on held-out worlds; keep it if it is the best so far."""
        if self._evaluator is None:
            episodes = self.config.train.eval_episodes
            self._evaluator = Evaluator(self.config.task, episodes, EVALUATION_SEED)
        policy = greedy_policy(self._learner.policy, self.batch.layout, self.config.task.control_dt)
        summary = self._evaluator.summary(policy)
        self.history.add_evaluation(self.budget.seconds, summary)
        for name in ("success_rate", "collision_rate", "timeout_rate", "spl"):
            self.logger.record(f"eval/{name}", summary[name])
        self.progress.evaluated(self.num_timesteps, summary)
        # Later is better at equal success: the learning rate has fallen further.
        if summary["success_rate"] >= self.best["success_rate"]:
            self.best = {"success_rate": summary["success_rate"], "steps": self.num_timesteps}
            self._write(self.folder.best)

    def save(self) -> None:
        """Write the last checkpoint and the history."""
        self._write(self.folder.last)
        write_atomically(self.folder.history, self.history.to_json())
        self._saved_at = time.perf_counter()

    def state(self) -> dict[str, Any]:
        """Return what a checkpoint must know beyond learner and environments."""
        return {
            "history": self.history.state_dict(),
            "curriculum": self.curriculum.state_dict(),
            "best": self.best,
            "next_evaluation": self._next_evaluation,
            "seconds": self.budget.seconds,
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

    def result(self) -> TrainResult:
        """Return how the run ended."""
        return TrainResult(
            steps=self.budget.steps_done,
            seconds=self.budget.seconds,
            interrupted=self.interrupted.is_set(),
            best_success_rate=self.best["success_rate"],
            best_steps=int(self.best["steps"]),
        )

    def _write(self, path: Any) -> None:
        save_checkpoint(path, self._learner, self.batch, self.state())


def train(
    config: RunConfig,
    folder: RunFolder,
    progress: Progress,
    *,
    started_at: float,
    resume: bool = False,
    force: bool = False,
) -> TrainResult:
    """Train into ``folder`` and export its best policy at the end.

    Ctrl-C ends the run after the iteration under way, with everything saved; pressed twice, at
    once. With ``resume`` the last checkpoint is the beginning.

    Raises:
        InputError: worlds, robot or checkpoint are unusable, or there is no such device.
    """
    keep_freed_memory()
    if not resume:
        folder.check_free(force=force)
    arrays = arrays_on(config.train.device)
    data = load_checkpoint(folder.last) if resume else None
    compiled = _compiling(warm_up)
    batch, curriculum = _environments(config, arrays)
    # Worlds that move and robots with errors have kernels of their own.
    compiled += _compiling(lambda: _try_out(batch))
    # Only now that nothing can be wrong any more a former run may be replaced.
    if resume:
        folder.store(config)
    else:
        folder.create(config, force=force)
    ppo = config.train.ppo
    threads = choose_threads(config.train.threads, ppo.batch_size, batch.layout.size, ppo.net_arch)
    budget = Budget(config, started_at + compiled, data["extra"]["seconds"] if data else 0.0)
    supervision = Supervision(config, folder, batch, curriculum, budget, progress)
    model = _learner(config, folder, batch, budget)
    if data is not None:
        _go_on(data, model, supervision)
    _announce(progress, compiled, threads)
    with _stop_on_interrupt(supervision.interrupted.set):
        if isinstance(model, PPO):
            model.learn(2**62, callback=supervision, reset_num_timesteps=data is None)
        else:
            model.learn(supervision)
    export_best(folder, config)
    return supervision.result()


def _environments(config: RunConfig, arrays: Arrays) -> tuple[NavigationBatch, Curriculum]:
    """Make the robots in their worlds, and what chooses among these.

    Raises:
        InputError: worlds or robot are unusable, or the curriculum does not fit the worlds.
    """
    task = config.task
    if task.suite in ("barn", "dynabarn"):
        raise InputError(f"task {task.suite} is for testing only; train on barn_like")
    pool = world_pool(task, "train", task.num_worlds, config.train.seed)
    batch = NavigationBatch(task, pool, config.train.ppo.n_envs, arrays=arrays)
    names = [world.name for world in pool.worlds]
    settings = config.train
    curriculum = make_curriculum(settings.curriculum, settings.staged, settings.automatic, names)
    apply(curriculum, batch)
    return batch, curriculum


def _learner(config: RunConfig, folder: RunFolder, batch: NavigationBatch, budget: Budget) -> Any:
    """Build the learner on its environments.

    Raises:
        InputError: it is not installed.
    """
    seed, ppo = config.train.seed, config.train.ppo
    if config.train.learner == "rsl_rl":
        try:
            from pm01_nav.train.rsl_ppo import RslRlLearner
        except ImportError as error:
            raise InputError(
                f"train.learner = 'rsl_rl': {error.name} is missing; pip install 'pm01-nav[gpu]'"
            ) from error
        learner = RslRlLearner(ppo, batch, seed=seed, budget=budget)
        learner.logger = _logger(folder)
        learner.begin()
        return learner
    env = NavVecEnv(batch, seed=seed << 32, reward_scale=ppo.reward_scale)
    model = make_ppo(ppo, env, batch.layout, seed=seed, progress=budget.fraction)
    model.set_logger(_logger(folder))
    return model


def _announce(progress: Progress, compiled: float, threads: ThreadChoice) -> None:
    """Say how the run was set up; ``compiled`` is how long that took [s]."""
    if compiled:
        progress.started(f"compiled the simulator in {compiled:.0f} s, once; not counted")
    progress.started(f"learner threads: {threads.threads} ({threads.reason})")


def _go_on(data: dict[str, Any], model: Any, supervision: Supervision) -> None:
    """Bring a fresh run to where a checkpoint was taken.

    Raises:
        InputError: the checkpoint belongs to another run, or the run's budget is spent.
    """
    folder, budget = supervision.folder, supervision.budget
    if isinstance(model, PPO):
        assert model.env is not None
        model.env.reset()
    restore(data, folder.last, model, supervision.batch)
    supervision.load_state(data["extra"])
    budget.steps_done = model.num_timesteps
    if budget.fraction() >= 1.0:
        raise InputError(
            f"{folder.path}: is finished ({budget.steps_done:,} steps, "
            f"{budget.seconds:.0f} s); to go on give --steps or --time-budget, counted from "
            "the run's beginning"
        )


def export_best(folder: RunFolder, config: RunConfig, path: Any = None) -> None:
    """Export the best policy of a run (the last one if none was evaluated) as ONNX.

    Raises:
        InputError: the run has no readable checkpoint.
    """
    data = load_checkpoint(folder.best if folder.best.exists() else folder.last)
    robot = config.task.robot_spec()
    layout = observation_layout(config.task, robot)
    policy = make_policy(config.train.ppo, layout)
    policy.load_state_dict(data["policy"])
    origin = {
        "task": config.task.model_dump(mode="json", exclude={"map", "worlds"}),
        "training_steps": data["num_timesteps"],
        "seed": config.train.seed,
        **provenance(),
    }
    metadata = policy_metadata(layout, robot, config.task.control_dt, origin)
    export_policy(policy, layout, metadata, path or folder.policy)


def _compiling(run: Callable[[], None]) -> float:
    """Run what may have to be compiled; return how long it took [s], 0 if it was there."""
    began = time.perf_counter()
    run()
    seconds = time.perf_counter() - began
    return seconds if seconds > COMPILED_WITHIN_S else 0.0


def _try_out(batch: NavigationBatch) -> None:
    """Reset and step once; the learner's own reset begins everything anew."""
    batch.reset(np.arange(batch.num_envs))
    batch.step(batch.arrays.from_numpy(np.zeros((batch.num_envs, 2))))


def _logger(folder: RunFolder) -> Logger:
    return configure(str(folder.tensorboard), ["tensorboard"])


@contextmanager
def _stop_on_interrupt(stop: Callable[[], None]) -> Iterator[None]:
    """Turn the first Ctrl-C into ``stop()``; the second one interrupts as usual."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.getsignal(signal.SIGINT)

    def on_interrupt(number: int, frame: FrameType | None) -> None:
        stop()
        signal.signal(signal.SIGINT, before)

    signal.signal(signal.SIGINT, on_interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
