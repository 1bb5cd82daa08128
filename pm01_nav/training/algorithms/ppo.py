# SPDX-License-Identifier: Apache-2.0
"""PPO (Schulman et al. 2017)."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field, model_validator

from pm01_nav.robot import NonNegative, Positive
from pm01_nav.training.algorithm_config import (
    Algorithm,
    AlgorithmConfig,
    Count,
    Fraction,
    algorithm,
)


@algorithm("ppo")
class PPOConfig(AlgorithmConfig):
    """Hyper-parameters of PPO."""

    batch_size: Annotated[int, Field(ge=2)]
    """Samples in a minibatch, 2 or more: each one's advantages are divided by their deviation."""
    n_steps: Count
    """Steps of each robot between two updates."""
    n_epochs: Count
    """Passes over the steps between two updates."""
    gae_lambda: Fraction
    clip_range: Positive
    ent_coef: NonNegative
    """Without it the exploration on ``mixed`` ends after 5 M steps, and the learning with it."""
    vf_coef: NonNegative
    max_grad_norm: Positive
    log_std_init: float

    @property
    def samples(self) -> int:
        """Environment steps of an iteration: those between two updates."""
        return self.n_envs * self.n_steps

    @model_validator(mode="after")
    def _is_divided(self) -> PPOConfig:
        if self.samples % self.batch_size:
            raise ValueError(
                f"{self.name}.batch_size must divide {self.name}.n_envs x {self.name}.n_steps = "
                f"{self.samples}, not {self.batch_size}"
            )
        return self

    @classmethod
    def few_robots(cls, n_envs: int) -> dict[str, Any]:
        """Learn more from each step, since steps are dear."""
        few = {"n_envs": n_envs, "n_steps": 256, "batch_size": 256}
        return few | {"n_epochs": 10, "learning_rate": 3e-4, "learning_rate_final": 1.0}

    @staticmethod
    def implementation() -> Algorithm:
        """Return Stable-Baselines3's PPO."""
        from pm01_nav.training.ppo import PPOAlgorithm

        return PPOAlgorithm()
