# SPDX-License-Identifier: Apache-2.0
"""The table of algorithms: their hyper-parameters, and what a run expects of them.

Hyper-parameters have the names that SB3 and RL Zoo give them. Their values stand in
``hyperparameters/<algorithm>.yaml``, if there is such a file, and else in the algorithm's own class
(``algorithms/``); those that are given go over them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Protocol, TypeVar

from pydantic import Field, model_validator

from pm01_nav.config import FrozenModel
from pm01_nav.robot import Positive
from pm01_nav.training.hyperparameters import stored_values

if TYPE_CHECKING:
    from stable_baselines3.common.vec_env import VecEnv

    from pm01_nav.task.observation import ObservationLayout

Count = Annotated[int, Field(ge=1)]
Fraction = Annotated[float, Field(ge=0.0, le=1.0)]
Rate = Callable[[float], float]
"""The learning rate as SB3 asks for it."""


class Algorithm(Protocol):
    """How learners are built, stored and gone on with; ``config`` is a section of ``train``."""

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


class ConvolutionConfig(FrozenModel):
    """Two convolutions: over the sectors of the scans, which close to a circle, or over images."""

    channels: tuple[Count, Count] = (8, 16)
    kernel_size: Annotated[int, Field(ge=3, le=15)] = 5
    """Sectors, or rows and columns, that an output sees; odd."""
    stride: Annotated[int, Field(ge=1, le=8)] = 2
    """How many of them lie between two outputs."""

    @model_validator(mode="after")
    def _is_centred(self) -> ConvolutionConfig:
        if self.kernel_size % 2 == 0:
            raise ValueError("kernel_size: must be odd")
        return self


class AlgorithmConfig(FrozenModel):
    """What all algorithms have in common. One is a subclass under ``@algorithm``."""

    name: ClassVar[str] = ""
    """What ``@algorithm`` says."""
    off_policy: ClassVar[bool] = False
    """Whether it learns from a replay buffer."""

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
    """For ``features_extractor: circular_conv``, and for images in a ``Dict``."""
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
        return {**stored_values(cls.name), **given} if isinstance(given, Mapping) else given

    @property
    def samples(self) -> int:
        """Environment steps of an iteration, after which one is logged, all robots together."""
        raise NotImplementedError

    @classmethod
    def few_robots(cls, n_envs: int) -> dict[str, Any]:
        """Return what suits a simulator better that drives ``n_envs`` robots and no more."""
        return {"n_envs": n_envs}

    @staticmethod
    def implementation() -> Algorithm:
        """Return what builds the learner; torch and its like are imported here and no sooner."""
        raise NotImplementedError


ALGORITHMS: dict[str, type[AlgorithmConfig]] = {}
Config = TypeVar("Config", bound=type[AlgorithmConfig])


def algorithm(name: str) -> Callable[[Config], Config]:
    """Enter an algorithm, by its hyper-parameters, in the table."""

    def enter(config: Config) -> Config:
        config.name = name
        ALGORITHMS[name] = config
        return config

    return enter


class OffPolicyConfig(AlgorithmConfig):
    """What algorithms with a replay buffer have in common."""

    off_policy = True
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
            raise ValueError(f"{self.name}.buffer_size must be {round_size} or more: one round")
        return self

    @classmethod
    def few_robots(cls, n_envs: int) -> dict[str, Any]:
        """Begin to learn early, since steps are dear."""
        return {"n_envs": n_envs, "learning_starts": 1000}

    def learner_arguments(self, num_commands: int) -> dict[str, Any]:
        """Return the arguments that this algorithm's learner alone takes."""
        del num_commands
        return {}

    def policy_arguments(self) -> dict[str, Any]:
        """Return those of its policy, beside the network's."""
        return {"n_critics": self.n_critics}
