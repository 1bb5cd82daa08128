# SPDX-License-Identifier: Apache-2.0
"""What a run expects of an algorithm, and what algorithms without a replay buffer share."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
import torch
from stable_baselines3.common.vec_env import VecEnv

from pm01_nav.task.observation import ObservationLayout

Rate = Callable[[float], float]
"""The learning rate as SB3 asks for it."""


class Algorithm(Protocol):
    """One row of the table of algorithms; ``config`` is its section of ``train``."""

    def make(
        self,
        config: Any,
        env: VecEnv,
        layout: ObservationLayout,
        *,
        seed: int,
        learning_rate: Rate,
    ) -> Any:
        """Build the learner, one of SB3's or of its kind."""
        ...

    def make_policy(self, config: Any, layout: ObservationLayout) -> Any:
        """Build the policy alone, with fresh weights."""
        ...

    def state(self, model: Any) -> dict[str, Any]:
        """Return what the learner needs to go on, beyond its policy: tensors and plain data."""
        ...

    def restore(self, model: Any, state: dict[str, Any]) -> None:
        """Go on from ``state``."""
        ...


def on_policy_state(model: Any) -> dict[str, Any]:
    """Return what PPO, or what looks like it, needs to go on, beyond its policy."""
    return {
        "optimizer": model.policy.optimizer.state_dict(),
        "last_episode_starts": torch.from_numpy(np.array(model._last_episode_starts)),
    }


def restore_on_policy(model: Any, state: dict[str, Any]) -> None:
    """Go on from ``state``."""
    model.policy.optimizer.load_state_dict(state["optimizer"])
    model._last_episode_starts = state["last_episode_starts"].numpy()
