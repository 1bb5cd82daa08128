# SPDX-License-Identifier: Apache-2.0
"""What the algorithms' hyper-parameters mean, by the names that SB3 and RL Zoo give them.

Their values stand in ``hyperparameters/<algorithm>.yaml``; those that are given go over them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, model_validator

from pm01_nav.config import FrozenModel
from pm01_nav.robot import NonNegative, Positive
from pm01_nav.training.hyperparameters import stored_values

Count = Annotated[int, Field(ge=1)]
Fraction = Annotated[float, Field(ge=0.0, le=1.0)]
EntropyCoefficient = Annotated[str, Field(pattern=r"^auto(_[0-9.]+)?$")] | NonNegative


class ConvolutionConfig(FrozenModel):
    """Two convolutions over the sectors of the scans, which close to a circle."""

    channels: tuple[Count, Count] = (8, 16)
    kernel_size: Annotated[int, Field(ge=3, le=15)] = 5
    """Sectors that an output sees; odd."""
    stride: Annotated[int, Field(ge=1, le=8)] = 2
    """Sectors between two outputs."""

    @model_validator(mode="after")
    def _is_centred(self) -> ConvolutionConfig:
        if self.kernel_size % 2 == 0:
            raise ValueError("kernel_size: must be odd")
        return self


class AlgorithmConfig(FrozenModel):
    """What all algorithms have in common."""

    file: ClassVar[str]
    """The YAML file with the values that are not given."""

    n_envs: Count
    """Robots that drive side by side."""
    batch_size: Count
    """Samples in a minibatch."""
    learning_rate: Positive
    learning_rate_final: Fraction
    """Part of the learning rate that is left at the end of the budget; it falls linearly."""
    gamma: Fraction
    net_arch: tuple[Count, ...]
    """Hidden layers; actor and critic have their own."""
    activation: Literal["relu", "tanh", "elu"]
    features_extractor: Literal["flat", "circular_conv"] = "flat"
    """What comes before the hidden layers: nothing, or convolutions over the scans' sectors."""
    conv: ConvolutionConfig = ConvolutionConfig()
    """For ``features_extractor: circular_conv``."""
    asymmetric_critic: bool = False
    """Whether the critic also sees what only a simulator knows (``task.privileged``)."""
    norm_obs: bool = False
    """Whether observations are normalized by their running mean and variance (VecNormalize)."""
    norm_reward: bool = False
    """Whether rewards are divided by the running deviation of the return (VecNormalize)."""
    reward_scale: Positive
    """The algorithm sees rewards times this; logged returns are not scaled."""

    @model_validator(mode="before")
    @classmethod
    def _over_stored(cls, given: Any) -> Any:
        return {**stored_values(cls.file), **given} if isinstance(given, Mapping) else given

    @property
    def samples(self) -> int:
        """Environment steps of an iteration, after which one is logged, all robots together."""
        raise NotImplementedError


class PPOConfig(AlgorithmConfig):
    """Hyper-parameters of PPO."""

    file = "ppo"
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
                f"{self.file}.batch_size must divide {self.file}.n_envs x {self.file}.n_steps = "
                f"{self.samples}, not {self.batch_size}"
            )
        return self


class PPOLSTMConfig(PPOConfig):
    """Hyper-parameters of RecurrentPPO: PPO whose actor remembers."""

    file = "ppo_lstm"
    lstm_hidden_size: Count
    n_lstm_layers: Count
    enable_critic_lstm: bool
    """Whether the critic has a memory of its own; else it sees the present alone."""


class OffPolicyConfig(AlgorithmConfig):
    """What algorithms with a replay buffer have in common."""

    buffer_size: Count
    """Steps that are remembered, all robots together."""
    learning_starts: Count
    """Steps of random actions before anything is learned, all robots together."""
    train_freq: Count
    """Steps of each robot between two rounds of updates."""
    gradient_steps: Count
    """Updates in a round."""
    log_interval: Count
    """Rounds between two points of the log, at which runs are evaluated, saved and ended, too."""
    tau: Fraction
    """How far the target network follows in an update."""
    n_steps: Count
    """Steps whose rewards are added up before the critic's estimate (n-step returns)."""
    n_critics: Count

    @property
    def samples(self) -> int:
        """Environment steps between two points of the log, all robots together."""
        return self.n_envs * self.train_freq * self.log_interval

    @model_validator(mode="after")
    def _holds_a_round(self) -> OffPolicyConfig:
        round_size = self.n_envs * self.train_freq
        if self.buffer_size < round_size:
            raise ValueError(f"{self.file}.buffer_size must be {round_size} or more: one round")
        return self


class SACConfig(OffPolicyConfig):
    """Hyper-parameters of SAC."""

    file = "sac"
    ent_coef: EntropyCoefficient
    """Weight of the entropy; ``auto_X`` begins with X and keeps to ``target_entropy``."""
    target_entropy: Literal["auto"] | float
    """``auto`` is minus the number of actions."""


class TQCConfig(SACConfig):
    """Hyper-parameters of TQC: SAC with a distribution of returns, its top left out."""

    file = "tqc"
    n_quantiles: Count
    top_quantiles_to_drop_per_net: Annotated[int, Field(ge=0)]


class TD3Config(OffPolicyConfig):
    """Hyper-parameters of TD3."""

    file = "td3"
    noise_std: NonNegative
    """Deviation of the exploration's normal noise, of actions in [-1, 1]."""
    policy_delay: Count
    """Updates of the critics for each one of the actor."""
    target_policy_noise: NonNegative
    target_noise_clip: NonNegative
