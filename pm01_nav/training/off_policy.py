# SPDX-License-Identifier: Apache-2.0
"""Algorithms with a replay buffer: SAC, TD3 (Stable-Baselines3) and TQC (sb3-contrib).

On the batched environment a round is ``train_freq`` steps of many robots, then ``gradient_steps``
updates with large minibatches; SB3's own settings update once a step.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.vec_env import VecEnv

from pm01_nav.envs.spaces import action_space
from pm01_nav.task.observation import ObservationLayout
from pm01_nav.training.algorithm_config import OffPolicyConfig, Rate
from pm01_nav.training.networks import AsymmetricCritics, network_arguments, network_space

BUFFER = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")
"""Arrays of SB3's replay buffer, the first dimension being time."""


@dataclass(frozen=True)
class OffPolicy:
    """One of these algorithms, as the table of algorithms has it."""

    learner: type[OffPolicyAlgorithm]
    policy: type[BasePolicy]

    def make(
        self,
        config: OffPolicyConfig,
        env: VecEnv,
        layout: ObservationLayout,
        *,
        seed: int,
        learning_rate: Rate,
    ) -> OffPolicyAlgorithm:
        """Build the learner."""
        names = ("learning_starts", "train_freq", "gradient_steps", "batch_size", "gamma", "tau")
        names += ("n_steps",)
        make: Any = self.learner
        return make(
            self._policy_class(config),
            env,
            learning_rate=learning_rate,
            buffer_size=config.buffer_size,
            policy_kwargs=self._policy_arguments(config, layout),
            seed=seed,
            device="cpu",
            **{name: getattr(config, name) for name in names},
            **config.learner_arguments(layout.drive.size),
        )

    def make_policy(self, config: OffPolicyConfig, layout: ObservationLayout) -> BasePolicy:
        """Build the policy alone, with fresh weights."""
        make: Any = self._policy_class(config)
        return make(
            network_space(config, layout),
            action_space(layout),
            lambda _: config.learning_rate,
            **self._policy_arguments(config, layout),
        )

    def state(self, model: OffPolicyAlgorithm) -> dict[str, Any]:
        """Return what the learner needs to go on, beyond its policy."""
        buffer: Any = model.replay_buffer
        length = buffer.buffer_size if buffer.full else buffer.pos
        filled = {n: torch.from_numpy(getattr(buffer, n)[:length]) for n in BUFFER}
        entropy: Any = getattr(model, "log_ent_coef", None)
        generator: Any = model.action_space.np_random.bit_generator
        return {
            "optimizers": {n: o.state_dict() for n, o in _optimizers(model).items()},
            "log_ent_coef": None if entropy is None else entropy.detach().clone(),
            "buffer": filled,
            "position": buffer.pos,
            "full": buffer.full,
            "random_actions": generator.state,
            "episodes": model._episode_num,
        }

    def restore(self, model: OffPolicyAlgorithm, state: dict[str, Any]) -> None:
        """Go on from ``state``."""
        for name, optimizer in _optimizers(model).items():
            optimizer.load_state_dict(state["optimizers"][name])
        if state["log_ent_coef"] is not None:
            entropy: Any = model
            with torch.no_grad():
                entropy.log_ent_coef.copy_(state["log_ent_coef"])
        buffer: Any = model.replay_buffer
        for name, array in state["buffer"].items():
            getattr(buffer, name)[: len(array)] = array.numpy()
        buffer.pos, buffer.full = state["position"], state["full"]
        generator: Any = model.action_space.np_random.bit_generator
        generator.state = state["random_actions"]
        model._episode_num = state["episodes"]

    def _policy_class(self, config: OffPolicyConfig) -> type[BasePolicy]:
        if not config.asymmetric_critic:
            return self.policy
        return type(f"Asymmetric{self.policy.__name__}", (AsymmetricCritics, self.policy), {})

    def _policy_arguments(
        self, config: OffPolicyConfig, layout: ObservationLayout
    ) -> dict[str, Any]:
        return network_arguments(config, layout) | config.policy_arguments()


def _optimizers(model: OffPolicyAlgorithm) -> dict[str, torch.optim.Optimizer]:
    learner: Any = model
    found = {"actor": learner.actor.optimizer, "critic": learner.critic.optimizer}
    if getattr(learner, "ent_coef_optimizer", None) is not None:
        found["entropy"] = learner.ent_coef_optimizer
    return found
