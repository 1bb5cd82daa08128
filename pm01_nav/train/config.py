# SPDX-License-Identifier: Apache-2.0
"""How a policy is trained; PPO's parameters carry the names that SB3 and RL Zoo give them."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from pm01_nav.arrays import Device
from pm01_nav.config import FrozenModel
from pm01_nav.robot import NonNegative, Positive
from pm01_nav.task.config import TaskConfig
from pm01_nav.task.curriculum import AutomaticConfig, CurriculumName, StagedConfig

Count = Annotated[int, Field(ge=1)]
Fraction = Annotated[float, Field(ge=0.0, le=1.0)]


class PPOConfig(FrozenModel):
    """Hyper-parameters of PPO, tuned for the batched environment."""

    n_envs: Count = 512
    """Robots that drive side by side."""
    n_steps: Count = 32
    """Steps of each robot between two updates."""
    batch_size: Count = 4096
    n_epochs: Count = 5
    learning_rate: Positive = 2e-3
    learning_rate_final: Fraction = 0.03
    """Part of the learning rate that is left at the end of the budget; it falls linearly."""
    gamma: Fraction = 0.995
    gae_lambda: Fraction = 0.95
    clip_range: Positive = 0.2
    ent_coef: NonNegative = 0.01
    """Without it the exploration on ``mixed`` ends after 5 M steps, and the learning with it."""
    vf_coef: NonNegative = 0.5
    max_grad_norm: Positive = 0.5
    net_arch: tuple[Count, ...] = (128, 128)
    activation: Literal["relu", "tanh", "elu"] = "relu"
    log_std_init: float = -0.5
    reward_scale: Positive = 0.02
    """The algorithm sees rewards times this; logged returns are not scaled."""


def device_defaults(device: str) -> dict[str, Any]:
    """Return settings of ``train`` that suit a device better than those for the CPU."""
    if device != "cuda":
        return {}
    ppo = {"n_envs": 4096, "n_steps": 28, "batch_size": 14336}
    return {"learner": "rsl_rl", "eval_every": 50_000_000, "ppo": ppo}


class TrainConfig(FrozenModel):
    """One training run: what, how, how long and how often to look."""

    algo: Literal["ppo"] = "ppo"
    learner: Literal["sb3", "rsl_rl"] = "sb3"
    """Who implements the algorithm: Stable-Baselines3, or rsl_rl, made for thousands of robots."""
    device: Device = "cpu"
    """Where robots are simulated and, with rsl_rl, the policy learns; ``cuda`` is an NVIDIA GPU."""
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 0
    steps: Count | None = None
    """Environment steps, all robots together."""
    time_budget: Positive | None = None
    """Seconds from the start of the command; whichever of the two comes first ends the run."""
    eval_every: Count = 1_000_000
    """Steps between two evaluations on held-out worlds."""
    eval_episodes: Count = 512
    checkpoint_every: Positive = 10.0
    """Seconds between two checkpoints."""
    threads: Annotated[int, Field(ge=0)] = 0
    """Threads of the learner; 0 measures at the start which number is fastest."""
    ppo: PPOConfig = PPOConfig()
    curriculum: CurriculumName = "none"
    """How the worlds of the training episodes are chosen."""
    staged: StagedConfig = StagedConfig()
    """For ``curriculum: staged``."""
    automatic: AutomaticConfig = AutomaticConfig()
    """For ``curriculum: automatic``."""

    @model_validator(mode="after")
    def _ends(self) -> TrainConfig:
        if self.steps is None and self.time_budget is None:
            raise ValueError("give steps, time_budget or both")
        if self.learner == "sb3" and self.device != "cpu":
            raise ValueError(f"device = {self.device}: needs learner = rsl_rl")
        samples = self.ppo.n_envs * self.ppo.n_steps
        if samples % self.ppo.batch_size:
            raise ValueError(
                f"ppo.batch_size must divide ppo.n_envs x ppo.n_steps = {samples}, "
                f"not {self.ppo.batch_size}"
            )
        return self


class RunConfig(FrozenModel):
    """The whole configuration of a run, as stored in its ``config.yaml``."""

    task: TaskConfig
    train: TrainConfig
