# SPDX-License-Identifier: Apache-2.0
"""What algorithms without a replay buffer share."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch


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
