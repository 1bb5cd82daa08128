# SPDX-License-Identifier: Apache-2.0
"""SAC (Haarnoja et al. 2018)."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from pm01_nav.robot import NonNegative
from pm01_nav.training.algorithm_config import Algorithm, OffPolicyConfig, algorithm

EntropyCoefficient = Annotated[str, Field(pattern=r"^auto(_[0-9.]+)?$")] | NonNegative


@algorithm("sac")
class SACConfig(OffPolicyConfig):
    """Hyper-parameters of SAC."""

    ent_coef: EntropyCoefficient
    """Weight of the entropy; ``auto_X`` begins with X and keeps to ``target_entropy``."""
    target_entropy: Literal["auto"] | float
    """``auto`` is minus the number of actions."""

    def learner_arguments(self, num_commands: int) -> dict[str, Any]:
        """Return what the entropy weighs."""
        return {"ent_coef": self.ent_coef, "target_entropy": self.target_entropy}

    @staticmethod
    def implementation() -> Algorithm:
        """Return Stable-Baselines3's SAC."""
        from stable_baselines3 import SAC
        from stable_baselines3.sac.policies import SACPolicy

        from pm01_nav.training.off_policy import OffPolicy

        return OffPolicy(SAC, SACPolicy)
