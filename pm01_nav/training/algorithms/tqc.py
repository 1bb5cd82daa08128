# SPDX-License-Identifier: Apache-2.0
"""TQC (Kuznetsov et al. 2020)."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field

from pm01_nav.training.algorithm_config import Algorithm, Count, algorithm
from pm01_nav.training.algorithms.sac import SACConfig


@algorithm("tqc")
class TQCConfig(SACConfig):
    """Hyper-parameters of TQC: SAC with a distribution of returns, its top left out."""

    n_quantiles: Count
    top_quantiles_to_drop_per_net: Annotated[int, Field(ge=0)]

    def learner_arguments(self, num_commands: int) -> dict[str, Any]:
        """Return SAC's and how many quantiles are left out."""
        dropped = self.top_quantiles_to_drop_per_net
        return super().learner_arguments(num_commands) | {"top_quantiles_to_drop_per_net": dropped}

    def policy_arguments(self) -> dict[str, Any]:
        """Return the number of critics and of their quantiles."""
        return super().policy_arguments() | {"n_quantiles": self.n_quantiles}

    @staticmethod
    def implementation() -> Algorithm:
        """Return sb3-contrib's TQC."""
        from sb3_contrib import TQC
        from sb3_contrib.tqc.policies import TQCPolicy

        from pm01_nav.training.off_policy import OffPolicy

        return OffPolicy(TQC, TQCPolicy)
