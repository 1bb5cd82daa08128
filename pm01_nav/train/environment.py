# SPDX-License-Identifier: Apache-2.0
"""The batch as a learner sees it: SB3's environment and the wrappers that a run asks for."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.vec_env import VecEnv, VecNormalize, unwrap_vec_normalize

from pm01_nav.envs.sb3_vec_env import NavVecEnv
from pm01_nav.policy.export import ObservationStatistics
from pm01_nav.task.navigation import NavigationBatch
from pm01_nav.train.algorithm_config import AlgorithmConfig


def make_environment(config: AlgorithmConfig, batch: NavigationBatch, seed: int) -> VecEnv:
    """Wrap ``batch``; robot i of a run with ``seed`` has a random stream of its own."""
    env: VecEnv = NavVecEnv(batch, seed=seed << 32, reward_scale=config.reward_scale)
    if config.norm_obs or config.norm_reward:
        return VecNormalize(
            env, norm_obs=config.norm_obs, norm_reward=config.norm_reward, gamma=config.gamma
        )
    return env


def observation_statistics(env: VecEnv | None) -> ObservationStatistics | None:
    """Return what observations are normalized by, if they are."""
    normalize = unwrap_vec_normalize(env) if env is not None else None
    if normalize is None or not normalize.norm_obs:
        return None
    assert isinstance(normalize.obs_rms, RunningMeanStd)
    mean, variance = normalize.obs_rms.mean.copy(), normalize.obs_rms.var.copy()
    return ObservationStatistics(mean, variance, normalize.epsilon, normalize.clip_obs)


def environment_state(env: VecEnv | None) -> dict[str, Any]:
    """Return what the wrappers need to go on: tensors and plain data."""
    normalize = unwrap_vec_normalize(env) if env is not None else None
    if normalize is None:
        return {}
    state: dict[str, Any] = {"returns": _tensor(normalize.returns)}
    for name in ("obs_rms", "ret_rms"):
        rms = getattr(normalize, name, None)
        if rms is not None:
            state[name] = {"mean": _tensor(rms.mean), "var": _tensor(rms.var), "count": rms.count}
    return state | {"epsilon": normalize.epsilon, "clip_obs": normalize.clip_obs}


def restore_environment(env: VecEnv | None, state: dict[str, Any]) -> None:
    """Go on from ``state``."""
    normalize = unwrap_vec_normalize(env) if env is not None else None
    if normalize is None:
        return
    normalize.returns = state["returns"].numpy()
    for name in ("obs_rms", "ret_rms"):
        rms = getattr(normalize, name, None)
        if rms is not None:
            rms.mean, rms.var = state[name]["mean"].numpy(), state[name]["var"].numpy()
            rms.count = state[name]["count"]


def stored_statistics(state: dict[str, Any]) -> ObservationStatistics | None:
    """Return what observations were normalized by according to ``environment_state``, if so."""
    if "obs_rms" not in state:
        return None
    rms = state["obs_rms"]
    return ObservationStatistics(
        rms["mean"].numpy(), rms["var"].numpy(), state["epsilon"], state["clip_obs"]
    )


def _tensor(array: Any) -> torch.Tensor:
    return torch.from_numpy(np.array(array))
