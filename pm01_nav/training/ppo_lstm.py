# SPDX-License-Identifier: Apache-2.0
"""PPO with a memory (LSTM): RecurrentPPO from sb3-contrib on the batched environment."""

from __future__ import annotations

from typing import Any

import torch
from sb3_contrib import RecurrentPPO
from sb3_contrib.common.recurrent.policies import RecurrentActorCriticPolicy
from sb3_contrib.common.recurrent.type_aliases import RNNStates
from stable_baselines3.common.vec_env import VecEnv

from pm01_nav.envs.spaces import action_space
from pm01_nav.task.observation import ObservationLayout
from pm01_nav.training.algorithms.ppo_lstm import PPOLSTMConfig
from pm01_nav.training.learner import Rate, on_policy_state, restore_on_policy
from pm01_nav.training.networks import critic_features, network_space
from pm01_nav.training.ppo import policy_arguments, update_arguments


class AsymmetricRecurrent(RecurrentActorCriticPolicy):
    """sb3-contrib's recurrent policy whose critic sees more than its actor."""

    def __init__(self, *arguments: Any, **settings: Any) -> None:
        """Build the policy, then the critic's own way to what it sees."""
        super().__init__(*arguments, **settings)
        features = critic_features(self)
        self.vf_features_extractor = features
        if self.lstm_critic is not None:
            size, layers = self.lstm_output_dim, self.lstm_critic.num_layers
            self.lstm_critic = torch.nn.LSTM(features.features_dim, size, num_layers=layers)
        else:
            self.critic = torch.nn.Linear(features.features_dim, self.lstm_output_dim)
        rate = self.optimizer.param_groups[0]["lr"]
        make: Any = self.optimizer_class
        self.optimizer = make(self.parameters(), lr=rate, **self.optimizer_kwargs)


class PPOLSTMAlgorithm:
    """RecurrentPPO, as the table of algorithms has it."""

    def make(
        self,
        config: PPOLSTMConfig,
        env: VecEnv,
        layout: ObservationLayout,
        *,
        seed: int,
        learning_rate: Rate,
    ) -> RecurrentPPO:
        """Build the learner."""
        return RecurrentPPO(
            policy_class(config),
            env,
            learning_rate=learning_rate,
            policy_kwargs=recurrent_arguments(config, layout),
            seed=seed,
            device="cpu",
            **update_arguments(config),
        )

    def make_policy(
        self, config: PPOLSTMConfig, layout: ObservationLayout
    ) -> RecurrentActorCriticPolicy:
        """Build the policy alone, with fresh weights."""
        return policy_class(config)(
            network_space(config, layout),
            action_space(layout),
            lambda _: config.learning_rate,
            **recurrent_arguments(config, layout),
        )

    def state(self, model: RecurrentPPO) -> dict[str, Any]:
        """Return what the learner needs to go on, beyond its policy."""
        assert model._last_lstm_states is not None
        memory = {"pi": list(model._last_lstm_states.pi), "vf": list(model._last_lstm_states.vf)}
        return on_policy_state(model) | {"memory": memory}

    def restore(self, model: RecurrentPPO, state: dict[str, Any]) -> None:
        """Go on from ``state``."""
        restore_on_policy(model, state)
        memory = {name: tuple(parts) for name, parts in state["memory"].items()}
        model._last_lstm_states = RNNStates(**memory)


def policy_class(config: PPOLSTMConfig) -> type[RecurrentActorCriticPolicy]:
    """Return the class of the policy."""
    return AsymmetricRecurrent if config.asymmetric_critic else RecurrentActorCriticPolicy


def recurrent_arguments(config: PPOLSTMConfig, layout: ObservationLayout) -> dict[str, Any]:
    """Return the arguments of the policy that sb3-contrib builds."""
    return policy_arguments(config, layout) | {
        "lstm_hidden_size": config.lstm_hidden_size,
        "n_lstm_layers": config.n_lstm_layers,
        "enable_critic_lstm": config.enable_critic_lstm,
    }
