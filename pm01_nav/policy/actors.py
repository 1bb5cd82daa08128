# SPDX-License-Identifier: Apache-2.0
"""The part of a trained policy that acts: its best action, without exploration and critics."""

from __future__ import annotations

from typing import Any

import torch
from stable_baselines3.common.policies import ActorCriticPolicy, BasePolicy


class Actor(torch.nn.Module):
    """From an observation as the environment gives it to an action, roughly in [-1, 1]."""

    memory_size = 0
    """Numbers that it remembers of a robot from one step to the next."""

    def __init__(self, policy: Any) -> None:
        """Take the actor of ``policy``."""
        super().__init__()
        self.policy = policy

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Return actions (n, 2) for observations (n, size)."""
        raise NotImplementedError


class GaussianActor(Actor):
    """The mean action of PPO's policy."""

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Return actions (n, 2) for observations (n, size)."""
        features = self.policy.pi_features_extractor(observation)
        return self.policy.action_net(self.policy.mlp_extractor.forward_actor(features))


class SquashedActor(Actor):
    """The most likely action of SAC's or TQC's actor, or the action of TD3's."""

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Return actions (n, 2) for observations (n, size)."""
        actor = self.policy.actor
        features = actor.features_extractor(observation)
        if not hasattr(actor, "latent_pi"):
            return actor.mu(features)  # TD3's ends in a tanh.
        return torch.tanh(actor.mu(actor.latent_pi(features)))


class RecurrentActor(torch.nn.Module):
    """The mean action of RecurrentPPO's policy, whose LSTM remembers."""

    def __init__(self, policy: Any) -> None:
        """Take the actor of ``policy``."""
        super().__init__()
        self.policy = policy
        lstm = policy.lstm_actor
        self.layers, self.width = lstm.num_layers, lstm.hidden_size
        self.memory_size = 2 * self.layers * self.width

    def forward(
        self, observation: torch.Tensor, memory: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Return actions (n, 2) and the memory after, for observations and a memory (n, memory).

        The LSTM's step is written out, as torch's documentation of ``nn.LSTM`` has it, because
        exporters of ONNX fix the number of robots in theirs.
        """
        signal = self.policy.pi_features_extractor(observation)
        parts = list(memory.split(self.width, dim=1))
        for layer in range(self.layers):
            hidden, cell = self._step(layer, signal, parts[2 * layer], parts[2 * layer + 1])
            parts[2 * layer], parts[2 * layer + 1] = hidden, cell
            signal = hidden
        action = self.policy.action_net(self.policy.mlp_extractor.forward_actor(signal))
        return action, torch.cat(parts, dim=1)

    def _step(
        self, layer: int, signal: torch.Tensor, hidden: torch.Tensor, cell: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        lstm = self.policy.lstm_actor
        w_in, w_back = getattr(lstm, f"weight_ih_l{layer}"), getattr(lstm, f"weight_hh_l{layer}")
        b_in, b_back = getattr(lstm, f"bias_ih_l{layer}"), getattr(lstm, f"bias_hh_l{layer}")
        gates = signal @ w_in.T + b_in + hidden @ w_back.T + b_back
        into, forget, new, out = gates.split(self.width, dim=1)
        cell = torch.sigmoid(forget) * cell + torch.sigmoid(into) * torch.tanh(new)
        return torch.sigmoid(out) * torch.tanh(cell), cell


def actor_of(policy: BasePolicy) -> Actor | RecurrentActor:
    """Return the actor of a policy of SB3 or sb3-contrib."""
    if hasattr(policy, "lstm_actor"):
        return RecurrentActor(policy)
    return GaussianActor(policy) if isinstance(policy, ActorCriticPolicy) else SquashedActor(policy)
