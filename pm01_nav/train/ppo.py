# SPDX-License-Identifier: Apache-2.0
"""PPO (Schulman et al. 2017) from Stable-Baselines3 on the batched environment."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from gymnasium import spaces
from stable_baselines3 import PPO
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from stable_baselines3.common.vec_env import VecEnv

from pm01_nav.envs.spaces import action_space, observation_space
from pm01_nav.task.observation import ObservationLayout
from pm01_nav.train.config import PPOConfig

ACTIVATIONS = {"relu": torch.nn.ReLU, "tanh": torch.nn.Tanh, "elu": torch.nn.ELU}


class FixedScale(BaseFeaturesExtractor):
    """Divide each number of an observation by a constant before the network sees it."""

    scale: torch.Tensor

    def __init__(self, observation_space: spaces.Box, scale: tuple[float, ...]) -> None:
        """Keep ``scale``, one divisor for each number of an observation."""
        super().__init__(observation_space, features_dim=len(scale))
        self.register_buffer("scale", torch.tensor(scale, dtype=torch.float32))

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Scale observations (n, size)."""
        return observations / self.scale


def make_ppo(
    config: PPOConfig,
    env: VecEnv,
    layout: ObservationLayout,
    *,
    seed: int,
    progress: Callable[[], float],
) -> PPO:
    """Build the learner; ``progress()`` runs from 0 to 1 over the budget and drives the rate."""

    def learning_rate(_: float) -> float:
        part = 1.0 - (1.0 - config.learning_rate_final) * min(max(progress(), 0.0), 1.0)
        return config.learning_rate * part

    return PPO(
        "MlpPolicy",
        env,
        learning_rate=learning_rate,
        n_steps=config.n_steps,
        batch_size=config.batch_size,
        n_epochs=config.n_epochs,
        gamma=config.gamma,
        gae_lambda=config.gae_lambda,
        clip_range=config.clip_range,
        ent_coef=config.ent_coef,
        vf_coef=config.vf_coef,
        max_grad_norm=config.max_grad_norm,
        policy_kwargs=policy_arguments(config, layout),
        seed=seed,
        device="cpu",
        verbose=0,
    )


def make_policy(config: PPOConfig, layout: ObservationLayout) -> ActorCriticPolicy:
    """Build the policy alone, with fresh weights."""
    return ActorCriticPolicy(
        observation_space(layout),
        action_space(),
        lambda _: config.learning_rate,
        **policy_arguments(config, layout),
    )


def policy_arguments(config: PPOConfig, layout: ObservationLayout) -> dict[str, Any]:
    """Return the arguments of the policy that SB3 builds."""
    arguments: dict[str, Any] = {
        "net_arch": list(config.net_arch),
        "activation_fn": ACTIVATIONS[config.activation],
        "log_std_init": config.log_std_init,
    }
    if not layout.normalize:
        arguments["features_extractor_class"] = FixedScale
        arguments["features_extractor_kwargs"] = {"scale": tuple(layout.scale)}
    return arguments
