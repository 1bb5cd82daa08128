# SPDX-License-Identifier: Apache-2.0
"""TD3 (Fujimoto et al. 2018)."""

from __future__ import annotations

from typing import Any

from pm01_nav.robot import NonNegative
from pm01_nav.training.algorithm_config import Algorithm, Count, OffPolicyConfig, algorithm


@algorithm("td3")
class TD3Config(OffPolicyConfig):
    """Hyper-parameters of TD3."""

    noise_std: NonNegative
    """Deviation of the exploration's normal noise, of actions in [-1, 1]."""
    policy_delay: Count
    """Updates of the critics for each one of the actor."""
    target_policy_noise: NonNegative
    target_noise_clip: NonNegative

    def learner_arguments(self, num_commands: int) -> dict[str, Any]:
        """Return the noise of actions and targets, and the actor's delay."""
        import numpy as np
        from stable_baselines3.common.noise import NormalActionNoise

        names = ("policy_delay", "target_policy_noise", "target_noise_clip")
        noise = NormalActionNoise(np.zeros(num_commands), np.full(num_commands, self.noise_std))
        return {"action_noise": noise} | {name: getattr(self, name) for name in names}

    @staticmethod
    def implementation() -> Algorithm:
        """Return Stable-Baselines3's TD3."""
        from stable_baselines3 import TD3
        from stable_baselines3.td3.policies import TD3Policy

        from pm01_nav.training.off_policy import OffPolicy

        return OffPolicy(TD3, TD3Policy)
