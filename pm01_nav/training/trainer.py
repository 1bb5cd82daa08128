# SPDX-License-Identifier: Apache-2.0
"""Train a policy: make worlds, robots and learner, learn, export the best policy."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

import numpy as np
from stable_baselines3.common.base_class import BaseAlgorithm

from pm01_nav.arrays import Arrays
from pm01_nav.envs.devices import arrays_on
from pm01_nav.errors import InputError
from pm01_nav.policy.export import export_policy, policy_metadata
from pm01_nav.provenance import provenance
from pm01_nav.sim.warm_up import warm_up
from pm01_nav.standing import Host, make_host
from pm01_nav.task.config import observation_layout
from pm01_nav.task.curriculum import Curriculum, apply, make_curriculum
from pm01_nav.task.given_files import stored_task
from pm01_nav.task.navigation import NavigationBatch
from pm01_nav.task.worlds import world_pool
from pm01_nav.training.budget import Budget
from pm01_nav.training.checkpoint import load_checkpoint, restore
from pm01_nav.training.config import RunConfig
from pm01_nav.training.divergence import divergence_told
from pm01_nav.training.environment import make_environment, stored_statistics
from pm01_nav.training.networks import privileged
from pm01_nav.training.remote_batch import Batch, RemoteBatch
from pm01_nav.training.run_folder import RunFolder
from pm01_nav.training.runtime import ThreadChoice, choose_threads, keep_freed_memory
from pm01_nav.training.supervision import Progress, Supervision, TrainResult
from pm01_nav.training.tracking import check_tracking, make_logger, record_session
from pm01_nav.worlds.suites import world_source_of

LOADED_WITHIN_S = 3.0
"""Loading compiled kernels takes less than this on a GPU."""


def train(
    config: RunConfig,
    folder: RunFolder,
    progress: Progress,
    *,
    started_at: float,
    resume: bool = False,
    force: bool = False,
    ray: str | None = None,
) -> TrainResult:
    """Train into ``folder`` and export its best policy at the end.

    Ctrl-C ends the run after the iteration under way, with everything saved; pressed twice, at
    once. With ``resume`` the last checkpoint is the beginning; a run that was killed before its
    first one begins anew. ``ray`` is the cluster of the
    workers that ``train.workers`` asks for; without it they are processes of this machine.

    Raises:
        InputError: worlds, robot or checkpoint are unusable, there is no such device or cluster, or
            the training diverged.
    """
    keep_freed_memory()
    if not resume:
        folder.check_free(force=force)
    arrays = arrays_on(config.train.device)
    data = load_checkpoint(folder.last) if resume and folder.last.exists() else None
    budget = Budget(config, started_at, data["extra"]["seconds"] if data else 0.0)
    batch, curriculum = _environments(config, arrays)
    _load_kernels(batch, budget)
    host = make_host(ray)
    check_tracking(config)
    chosen = config.train.hyperparameters
    threads = choose_threads(
        config.train.threads, chosen.batch_size, batch.layout.size, chosen.net_arch
    )
    learns_by = chosen.implementation()
    supervision = Supervision(config, folder, batch, curriculum, budget, progress, learns_by)
    model = _learner(config, batch, budget, host)
    if data is not None:
        _go_on(data, model, supervision)
    # What a former run left may be replaced only now that all has been looked at. (Weights & Biases
    # may still refuse: it needs the folder.)
    if resume:
        folder.reopen(config)
    else:
        folder.create(config, force=force)
    if resume and data is None:
        progress.started(f"{folder.path}: has no checkpoint yet; the same run begins anew")
    record_session(config, folder)
    model.set_logger(make_logger(config, folder))
    _announce(progress, budget.compiled, threads)
    if data is None:
        budget.learning_since = budget.seconds
    _learn(model, supervision, fresh=data is None)
    export_best(folder, config)
    return supervision.result()


def _learn(model: Any, supervision: Supervision, *, fresh: bool) -> None:
    """Learn until ``supervision`` has had enough or Ctrl-C is pressed.

    Raises:
        InputError: the training diverged.
    """
    diverging = divergence_told(model.policy, supervision.config.train.algo)
    with _stop_on_interrupt(supervision.interrupted.set), diverging:
        if isinstance(model, BaseAlgorithm):
            # Algorithms with a replay buffer would log every so many episodes of their own accord.
            pause = 2**62 if hasattr(model, "replay_buffer") else 1
            model.learn(2**62, supervision, log_interval=pause, reset_num_timesteps=fresh)
        else:
            model.learn(supervision)
    model.logger.close()


def _environments(config: RunConfig, arrays: Arrays) -> tuple[Batch, Curriculum]:
    """Make the robots in their worlds, and what chooses among these.

    Raises:
        InputError: worlds or robot are unusable, or the curriculum does not fit the worlds.
    """
    task = config.task
    if stand_in := world_source_of(task.suite).stand_in:
        raise InputError(f"task {task.suite} is for testing only; train on {stand_in}")
    pool = world_pool(task, "train", task.num_worlds, config.train.seed)
    batch: Batch
    if config.train.workers is not None:
        batch = RemoteBatch(config)
    else:
        chosen = config.train.hyperparameters
        more = privileged(chosen)
        batch = NavigationBatch(task, pool, chosen.n_envs, arrays=arrays, privileged=more)
    settings = config.train
    # Stages alone know worlds by their names; all worlds are made to look at these.
    staged = settings.curriculum == "staged"
    names = [world.name for world in pool.worlds] if staged else [""] * len(pool)
    curriculum = make_curriculum(settings.curriculum, settings.staged, settings.automatic, names)
    apply(curriculum, batch)
    return batch, curriculum


def _learner(config: RunConfig, batch: Batch, budget: Budget, host: Host) -> Any:
    """Build the learner on its environments.

    Raises:
        InputError: it is not installed.
    """
    seed, chosen = config.train.seed, config.train.hyperparameters
    if config.train.learner == "rsl_rl":
        try:
            from pm01_nav.training.rsl_ppo import RslRlLearner
        except ImportError as error:
            raise InputError(
                f"train.learner = 'rsl_rl': {error.name} is missing; pip install 'pm01-nav[gpu]'"
            ) from error
        assert isinstance(batch, NavigationBatch)
        learner = RslRlLearner(chosen, batch, seed=seed, budget=budget)
        learner.begin()
        return learner

    def learning_rate(_: float) -> float:
        left = 1.0 - (1.0 - chosen.learning_rate_final) * budget.learning_fraction()
        return chosen.learning_rate * left

    if isinstance(batch, RemoteBatch):
        from pm01_nav.training.distributed import DistributedPPO

        return DistributedPPO(config, batch, learning_rate=learning_rate, host=host)
    return chosen.implementation().make(
        chosen,
        make_environment(config.train, batch),
        batch.layout,
        seed=seed,
        learning_rate=learning_rate,
    )


def _announce(progress: Progress, compiled: float, threads: ThreadChoice) -> None:
    """Say how the run was set up; ``compiled`` is how long compiling took [s]."""
    if compiled >= 1.0:
        progress.started(f"compiled the simulator in {compiled:.0f} s, once; not counted")
    progress.started(f"learner threads: {threads.threads} ({threads.reason})")


def _go_on(data: dict[str, Any], model: Any, supervision: Supervision) -> None:
    """Bring a fresh run to where a checkpoint was taken.

    Raises:
        InputError: the checkpoint belongs to another run, or the run's budget is spent.
    """
    folder, budget = supervision.folder, supervision.budget
    if isinstance(model, BaseAlgorithm) and model.env is not None:
        model.env.reset()
    restore(data, folder.last, model, supervision.algorithm, supervision.batch)
    supervision.load_state(data["extra"])
    budget.steps_done = model.num_timesteps
    budget.learning_since = data["extra"].get("learning_since", 0.0)
    if budget.fraction() >= 1.0 and folder.is_exported():
        raise InputError(
            f"{folder.path}: is finished ({budget.steps_done:,} steps, "
            f"{budget.seconds:.0f} s); to go on give --steps or --time-budget, counted from "
            "the run's beginning"
        )


def export_best(folder: RunFolder, config: RunConfig, path: Any = None) -> None:
    """Export the best policy of a run (the last one if none was evaluated) as ONNX.

    Raises:
        InputError: the run has no readable checkpoint, or it is of another network.
    """
    data = load_checkpoint(folder.best if folder.best.exists() else folder.last)
    robot = config.task.robot_spec()
    layout = observation_layout(config.task, robot)
    chosen = config.train.hyperparameters
    policy = chosen.implementation().make_policy(chosen, layout)
    try:
        policy.load_state_dict(data["policy"])
    except RuntimeError as error:
        raise InputError(f"{folder.path}: the checkpoint does not belong to config.yaml") from error
    origin = {
        "task": stored_task(config.task).model_dump(mode="json", exclude={"map", "worlds"}),
        "training_steps": data["num_timesteps"],
        "algorithm": config.train.algo,
        "seed": config.train.seed,
        **provenance(),
    }
    metadata = policy_metadata(layout, robot, config.task.control_dt, origin)
    statistics = stored_statistics(data["environment"])
    export_policy(policy, layout, metadata, path or folder.policy, statistics)


def _load_kernels(batch: Batch, budget: Budget) -> None:
    """Load the kernels of a batch; where one had to be compiled, compile all others as well."""
    if isinstance(batch, RemoteBatch):
        warm_up()  # Here once, and not in each worker.
        return
    before = budget.seconds
    # The learner's own reset begins everything anew.
    batch.reset(np.arange(batch.num_envs))
    batch.step(batch.arrays.from_numpy(np.zeros((batch.num_envs, batch.layout.drive.size))))
    seconds = budget.seconds - before
    if batch.arrays.device != "cpu" and seconds > LOADED_WITHIN_S:
        budget.compiled_elsewhere = seconds
    if budget.compiled > 0.0:
        warm_up()


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
