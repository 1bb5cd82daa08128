# SPDX-License-Identifier: Apache-2.0
"""PPO with a memory (LSTM): RecurrentPPO from sb3-contrib on the batched environment."""

from __future__ import annotations

from typing import Any

import torch
from sb3_contrib import RecurrentPPO
from sb3_contrib.common.recurrent.policies import RecurrentActorCriticPolicy
from sb3_contrib.common.recurrent.type_aliases import RNNStates

from pm01_nav.task.observation import ObservationLayout
from pm01_nav.training.networks import critic_features
from pm01_nav.training.ppo import PPOAlgorithm


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


class PPOLSTMAlgorithm(PPOAlgorithm):
    """RecurrentPPO, as the table of algorithms has it."""

    learner = RecurrentPPO
    policy = RecurrentActorCriticPolicy
    asymmetric = AsymmetricRecurrent

    def policy_arguments(self, config: Any, layout: ObservationLayout) -> dict[str, Any]:
        """Return PPO's arguments and those of the memory."""
        names = ("lstm_hidden_size", "n_lstm_layers", "enable_critic_lstm")
        memory = {name: getattr(config, name) for name in names}
        return super().policy_arguments(config, layout) | memory

    def state(self, model: Any) -> dict[str, Any]:
        """Return PPO's state and what the actor and the critic remember."""
        memory = {"pi": list(model._last_lstm_states.pi), "vf": list(model._last_lstm_states.vf)}
        return super().state(model) | {"memory": memory}

    def restore(self, model: Any, state: dict[str, Any]) -> None:
        """Go on from ``state``."""
        super().restore(model, state)
        memory = {name: tuple(parts) for name, parts in state["memory"].items()}
        model._last_lstm_states = RNNStates(**memory)
