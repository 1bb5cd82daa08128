# SPDX-License-Identifier: Apache-2.0
"""What ``import pm01_nav`` offers: environments, training, evaluation and policies.

Arguments are called as on the command line. What is dear to import is imported when it is used.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pm01_nav.errors import InputError

if TYPE_CHECKING:
    from pm01_nav.envs.sb3_vec_env import NavVecEnv
    from pm01_nav.envs.vector_env import NavVectorEnv
    from pm01_nav.policy import OnnxPolicy
    from pm01_nav.task.config import TaskConfig
    from pm01_nav.training.supervision import Progress


def make_env(
    task: str | TaskConfig = "static",
    num_envs: int = 512,
    *,
    seed: int = 0,
    reward_scale: float = 0.02,
    **changes: Any,
) -> NavVecEnv:
    """Return ``num_envs`` robots as one native Stable-Baselines3 ``VecEnv``.

    Observations are float32 of shape (num_envs, size), actions (num_envs, axes) in [-1, 1].
    ``changes`` are keys of ``TaskConfig``, as in ``gym.make``. Rewards are multiplied by
    ``reward_scale``; 0.02 suits SB3's PPO.

    Raises:
        InputError: the task or a changed key is unknown, or a value is not allowed.
    """
    from pm01_nav.envs.sb3_vec_env import NavVecEnv
    from pm01_nav.envs.spaces import resolve_task
    from pm01_nav.task.navigation import NavigationBatch
    from pm01_nav.task.worlds import world_pool

    if num_envs < 1:
        raise InputError(f"num_envs = {num_envs}: must be at least 1")
    config = resolve_task(task, changes)
    batch = NavigationBatch(config, world_pool(config, "train", config.num_worlds), num_envs)
    return NavVecEnv(batch, seed=seed, reward_scale=reward_scale)


def make_vec(
    task: str | TaskConfig = "static", num_envs: int = 512, **arguments: Any
) -> NavVectorEnv:
    """Return ``num_envs`` robots as one Gymnasium ``VectorEnv``.

    ``arguments`` are those of ``NavVectorEnv``: ``render_mode``, ``device``, ``autoreset_mode`` and
    keys of ``TaskConfig``.

    Raises:
        InputError: the task, a mode or a changed key is unknown, a value is not allowed, or there
            is no usable GPU.
    """
    from pm01_nav.envs.vector_env import NavVectorEnv

    return NavVectorEnv(num_envs, task, **arguments)


def train(
    out: str | Path,
    task: str | TaskConfig = "static",
    *,
    n_envs: int | None = None,
    force: bool = False,
    ray: str | None = None,
    progress: Progress | None = None,
    **settings: Any,
) -> Path:
    """Train a policy into the folder ``out``; return the file of the best one.

    ``settings`` are what a run's ``config.yaml`` holds: of training, such as ``time_budget`` [s],
    ``steps``, ``seed``, ``algo``, ``preset`` or ``ppo={"gamma": 0.97}``; and of the task, such as
    ``robot``, ``map`` or ``randomization="on"``. With neither budget nor steps it trains for 60 s.
    With ``force`` a former run in the folder is replaced.

    Raises:
        InputError: a setting is unknown or not allowed, the folder is taken, or the training
            diverged.
    """
    from pm01_nav.task.config import EARLY, TaskConfig
    from pm01_nav.training.config import preset_defaults, run_config, with_flags
    from pm01_nav.training.run_folder import RunFolder
    from pm01_nav.training.supervision import NoProgress
    from pm01_nav.training.trainer import train as run

    began = time.perf_counter()
    keys = {*TaskConfig.model_fields, *EARLY}
    of_task = {name: settings.pop(name) for name in [*settings] if name in keys}
    preset = preset_defaults(settings.get("preset") or "default")
    chosen = _chosen(task, None, of_task, preset.get("task"))
    config = run_config(chosen, with_flags({}, n_envs, settings), "settings")
    if ray and config.train.workers is None:
        raise InputError("ray: is for the workers; give workers as well")
    folder = RunFolder(out)
    run(config, folder, progress or NoProgress(), started_at=began, force=force, ray=ray)
    return folder.policy


def evaluate(
    policy: str | Path,
    task: str | TaskConfig | None = None,
    *,
    episodes: int = 1000,
    seed: int = 1,
    global_plan: bool = False,
    look_ahead: float | None = None,
    **changes: Any,
) -> dict[str, Any]:
    """Drive held-out episodes; return the figures of merit by name, as ``pm01 evaluate --json``.

    ``policy`` is a file, a run's folder, ``zoo:NAME`` or a planner's name. Without a ``task`` it is
    the one that the policy was trained on; ``changes`` are keys of ``TaskConfig``, and
    ``randomization`` may be ``"on"``. With ``global_plan`` the policy's goal lies ``look_ahead``
    [m] ahead on a way found on the map, 2 m if not said.

    Raises:
        InputError: there is no such policy, it does not fit the task's robot, or a value is not
            allowed.
    """
    from pm01_nav.benchmark.evaluate import Evaluator
    from pm01_nav.benchmark.policies import load_policy, trained_task
    from pm01_nav.planners.plan_follower import look_ahead_of

    if episodes < 1:
        raise InputError(f"episodes = {episodes}: must be at least 1")
    if not 0 <= seed < 1 << 31:
        raise InputError(f"seed = {seed}: must be from 0 to {(1 << 31) - 1}")
    name = str(policy)
    distance = look_ahead_of(global_plan, look_ahead)
    config = _chosen(task, trained_task(name), changes)
    driver = load_policy(name, config.robot_spec(), config.control_dt)
    return Evaluator(config, episodes, seed, look_ahead=distance).summary(driver)


def load_policy(policy: str | Path) -> OnnxPolicy:
    """Return a trained policy, from a file, a run's folder or ``zoo:NAME``.

    Its ``act(scan, goal, velocity)`` takes ranges (num_beams,) [m], the goal (2,) in ``base_link``
    [m] and (v, w) [m/s, rad/s], or a batch of each, and returns (v, w) alike.

    Raises:
        InputError: there is none, or the file is no policy of ours.
    """
    from pm01_nav.policy import OnnxPolicy

    path = Path(policy)
    return OnnxPolicy(path / "policy.onnx" if path.is_dir() else policy)


def _chosen(
    task: str | TaskConfig | None,
    base: TaskConfig | None,
    changes: dict[str, Any],
    defaults: dict[str, Any] | None = None,
) -> TaskConfig:
    """Return a task as the command line chooses it; one that is given whole stands for itself."""
    from pm01_nav.task.choice import chosen_task

    errors = changes.get("randomization")
    named = {"randomization": changes.pop("randomization")} if isinstance(errors, str) else {}
    map_ = changes.get("map")
    if task is None or isinstance(task, str):
        return chosen_task(base, task, changes, defaults=defaults, map=map_, **named)
    return chosen_task(task, None, changes, map=map_, **named)
