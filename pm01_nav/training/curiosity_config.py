# SPDX-License-Identifier: Apache-2.0
"""How much a learner pays itself for what is new to it."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from pm01_nav.config import FrozenModel
from pm01_nav.robot import NonNegative, Positive
from pm01_nav.training.algorithm_config import Count


class CuriosityConfig(FrozenModel):
    """What ICM and RND have in common."""

    weight: NonNegative = 0.002
    """Intrinsic reward for a novelty of one running deviation, beside the scaled task's reward."""
    learning_rate: Positive = 1e-3
    update_every: Count = 32
    """Steps of every robot between two rounds of learning."""
    share: Annotated[float, Field(gt=0.0, le=1.0)] = 0.25
    """Part of the steps that is learned from."""
    batch_size: Count = 1024
    hidden_size: Count = 64
    feature_size: Count = 16


class ICMConfig(CuriosityConfig):
    """The intrinsic curiosity module."""

    beta: Annotated[float, Field(ge=0.0, le=1.0)] = 0.2
    """Weight of the forward model's loss against the inverse model's (the paper's value)."""


class RNDConfig(CuriosityConfig):
    """Random network distillation."""
