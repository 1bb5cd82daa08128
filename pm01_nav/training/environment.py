# SPDX-License-Identifier: Apache-2.0
"""The batch as a learner sees it: SB3's environment and the wrappers that a run asks for."""

from __future__ import annotations

from typing import Any

import torch
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.vec_env import VecEnv, VecNormalize, unwrap_vec_normalize

from pm01_nav.envs.sb3_vec_env import NavVecEnv
from pm01_nav.policy.export import ObservationStatistics
from pm01_nav.task.navigation import NavigationBatch
from pm01_nav.training.config import TrainConfig
from pm01_nav.training.curiosity import add_curiosity, intrinsic_rewards, load_rms, rms_state


def make_environment(settings: TrainConfig, batch: NavigationBatch) -> VecEnv:
    """Wrap ``batch`` as a run is set up; robot i has a random stream of its own."""
    config, seed = settings.hyperparameters, settings.seed
    env: VecEnv = NavVecEnv(batch, seed=seed << 32, reward_scale=config.reward_scale)
    if settings.icm is not None or settings.rnd is not None:
        # Its networks are made before SB3 seeds torch.
        torch.manual_seed(seed)
        env = add_curiosity(env, settings.icm, settings.rnd, seed)
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
    state: dict[str, Any] = {n: w.state_dict() for n, w in intrinsic_rewards(env).items()}
    normalize = unwrap_vec_normalize(env) if env is not None else None
    if normalize is None:
        return state
    state["returns"] = torch.from_numpy(normalize.returns.copy())
    for name, rms in _running(normalize).items():
        state[name] = rms_state(rms)
    return state | {"epsilon": normalize.epsilon, "clip_obs": normalize.clip_obs}


def restore_environment(env: VecEnv | None, state: dict[str, Any]) -> None:
    """Go on from ``state``."""
    for name, wrapper in intrinsic_rewards(env).items():
        wrapper.load_state_dict(state[name])
    normalize = unwrap_vec_normalize(env) if env is not None else None
    if normalize is None:
        return
    normalize.returns = state["returns"].numpy()
    for name, rms in _running(normalize).items():
        load_rms(rms, state[name])


def _running(normalize: VecNormalize) -> dict[str, RunningMeanStd]:
    """Return the statistics that it keeps, by the names it gives them."""
    found: dict[str, RunningMeanStd] = {"ret_rms": normalize.ret_rms}
    if normalize.norm_obs:
        assert isinstance(normalize.obs_rms, RunningMeanStd)
        found["obs_rms"] = normalize.obs_rms
    return found


def stored_statistics(state: dict[str, Any]) -> ObservationStatistics | None:
    """Return what observations were normalized by according to ``environment_state``, if so."""
    if "obs_rms" not in state:
        return None
    rms = state["obs_rms"]
    return ObservationStatistics(
        rms["mean"].numpy(), rms["var"].numpy(), state["epsilon"], state["clip_obs"]
    )
