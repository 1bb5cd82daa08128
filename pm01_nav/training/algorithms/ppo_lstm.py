# SPDX-License-Identifier: Apache-2.0
"""PPO with a memory (LSTM)."""

from __future__ import annotations

from pm01_nav.training.algorithm_config import Algorithm, Count, algorithm
from pm01_nav.training.algorithms.ppo import PPOConfig


@algorithm("ppo_lstm")
class PPOLSTMConfig(PPOConfig):
    """Hyper-parameters of RecurrentPPO: PPO whose actor remembers."""

    lstm_hidden_size: Count
    n_lstm_layers: Count
    enable_critic_lstm: bool
    """Whether the critic has a memory of its own; else it sees the present alone."""

    @staticmethod
    def implementation() -> Algorithm:
        """Return sb3-contrib's RecurrentPPO."""
        from pm01_nav.training.ppo_lstm import PPOLSTMAlgorithm

        return PPOLSTMAlgorithm()
