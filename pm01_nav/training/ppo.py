# SPDX-License-Identifier: Apache-2.0
"""PPO (Schulman et al. 2017) from Stable-Baselines3 on the batched environment."""

from __future__ import annotations

from typing import Any

from stable_baselines3 import PPO
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.vec_env import VecEnv

from pm01_nav.envs.spaces import action_space
from pm01_nav.task.observation import ObservationLayout
from pm01_nav.training.algorithm_config import Rate
from pm01_nav.training.algorithms.ppo import PPOConfig
from pm01_nav.training.learner import on_policy_state, restore_on_policy
from pm01_nav.training.networks import AsymmetricActorCritic, network_arguments, network_space
from pm01_nav.training.optimizer import EagerAdam

ADAM_EPS = 1e-5
"""What SB3 takes for its own Adam."""


class PPOAlgorithm:
    """PPO, as the table of algorithms has it."""

    learner: Any = PPO
    policy: Any = ActorCriticPolicy
    asymmetric: Any = AsymmetricActorCritic

    def make(
        self,
        config: PPOConfig,
        env: VecEnv,
        layout: ObservationLayout,
        *,
        seed: int,
        learning_rate: Rate,
    ) -> Any:
        """Build the learner."""
        return self.learner(
            self.policy_class(config),
            env,
            learning_rate=learning_rate,
            policy_kwargs=self.policy_arguments(config, layout),
            seed=seed,
            device="cpu",
            **update_arguments(config),
        )

    def make_policy(self, config: PPOConfig, layout: ObservationLayout) -> Any:
        """Build the policy alone, with fresh weights."""
        return self.policy_class(config)(
            network_space(config, layout),
            action_space(layout),
            lambda _: config.learning_rate,
            **self.policy_arguments(config, layout),
        )

    def policy_class(self, config: PPOConfig) -> Any:
        """Return the class of the policy."""
        return self.asymmetric if config.asymmetric_critic else self.policy

    def policy_arguments(self, config: Any, layout: ObservationLayout) -> dict[str, Any]:
        """Return the arguments of the policy that SB3 builds."""
        optimizer = {"optimizer_class": EagerAdam, "optimizer_kwargs": {"eps": ADAM_EPS}}
        return network_arguments(config, layout) | optimizer | {"log_std_init": config.log_std_init}

    def state(self, model: Any) -> dict[str, Any]:
        """Return what the learner needs to go on, beyond its policy."""
        return on_policy_state(model)

    def restore(self, model: Any, state: dict[str, Any]) -> None:
        """Go on from ``state``."""
        restore_on_policy(model, state)


def make_policy(config: PPOConfig, layout: ObservationLayout) -> ActorCriticPolicy:
    """Build PPO's policy alone, with fresh weights."""
    return PPOAlgorithm().make_policy(config, layout)


def update_arguments(config: PPOConfig) -> dict[str, Any]:
    """Return the arguments of the algorithm that say how it learns."""
    names = ("n_steps", "batch_size", "n_epochs", "gamma", "gae_lambda", "clip_range")
    names += ("ent_coef", "vf_coef", "max_grad_norm")
    return {name: getattr(config, name) for name in names}
