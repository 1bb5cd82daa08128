# SPDX-License-Identifier: Apache-2.0
"""How a policy is trained."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, ConfigDict, Field, create_model, model_validator

from pm01_nav.arrays import Device
from pm01_nav.backends import BACKENDS
from pm01_nav.config import FrozenModel, merge, validate
from pm01_nav.robot import Positive
from pm01_nav.task.config import TaskConfig
from pm01_nav.task.curriculum import AutomaticConfig, CurriculumName, StagedConfig
from pm01_nav.training.algorithm_config import Count
from pm01_nav.training.algorithms import ALGORITHMS
from pm01_nav.training.curiosity_config import ICMConfig, RNDConfig
from pm01_nav.training.hyperparameters import stored_values

DEFAULT_TIME_BUDGET = 60.0
"""Of a run that is told no end [s]."""


def algorithm_defaults(algo: str) -> dict[str, Any]:
    """Return settings of ``train`` that suit an algorithm better than those for PPO.

    With a replay buffer a step costs several times as much and teaches more, and success wavers
    from one evaluation to the next: the best of many is kept.
    """
    config = ALGORITHMS.get(str(algo))
    return {"eval_every": 100_000} if config and config.off_policy else {}


def preset_defaults(preset: str) -> dict[str, dict[str, Any]]:
    """Return what a preset changes of ``task`` and ``train``, beside hyper-parameters.

    In some seconds a policy sees few worlds, and an evaluation is a large part of the budget.
    """
    if preset != "quick":
        return {}
    return {"task": {"num_worlds": 256}, "train": {"eval_every": 1_000_000}}


def device_defaults(device: str) -> dict[str, Any]:
    """Return settings of ``train`` that suit a device better than those for the CPU."""
    if device != "cuda":
        return {}
    ppo = {"n_envs": 4096, "n_steps": 28, "batch_size": 14336}
    return {"learner": "rsl_rl", "eval_every": 50_000_000, "ppo": ppo}


def backend_defaults(backend: str) -> dict[str, Any]:
    """Return settings of ``train`` for a backend that makes a hundred steps/s, not a million."""
    n_envs = BACKENDS[backend].most_robots
    if n_envs is None:
        return {}
    sections = {name: config.few_robots(n_envs) for name, config in ALGORITHMS.items()}
    return {"eval_every": 50_000, "eval_episodes": 20, **sections}


def _known(name: str) -> str:
    if name not in ALGORITHMS:
        raise ValueError(f"unknown; allowed: {', '.join(ALGORITHMS)}")
    return name


class TrainConfig(FrozenModel):
    """One training run: what, how, how long and how often to look.

    Beside these keys there is the section of the algorithm, under its name.
    """

    model_config = ConfigDict(extra="allow")

    algo: Annotated[str, AfterValidator(_known)] = "ppo"
    """The algorithm: a name of the table ``ALGORITHMS``."""
    preset: Literal["default", "quick"] = "default"
    """Hyper-parameters to begin with; ``quick`` is PPO for budgets of some seconds."""
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
    workers: Count | None = None
    """Processes or machines that collect the experience, each with its share of the robots."""
    track: Literal["none", "wandb"] = "none"
    """Where metrics go beside TensorBoard."""
    icm: ICMConfig | None = None
    """Intrinsic curiosity beside the task's reward; ``{}`` takes its defaults."""
    rnd: RNDConfig | None = None
    """Random network distillation likewise; both can be had at once."""
    curriculum: CurriculumName = "none"
    """How the worlds of the training episodes are chosen."""
    staged: StagedConfig = StagedConfig()
    """For ``curriculum: staged``."""
    automatic: AutomaticConfig = AutomaticConfig()
    """For ``curriculum: automatic``."""

    @model_validator(mode="before")
    @classmethod
    def _with_hyperparameters(cls, given: Any) -> Any:
        """Put the algorithm's section in place; those of others are checked and left out."""
        if not isinstance(given, Mapping) or str(given.get("algo", "ppo")) not in ALGORITHMS:
            return given
        algo = given.get("algo", "ppo")
        own = {name: value for name, value in given.items() if name in cls.model_fields}
        sections = {algo: {}, **{name: given[name] for name in given if name not in own}}
        if given.get("preset") == "quick":
            sections[algo] = _over_quick(algo, sections[algo])
        fields: Any = {name: (ALGORITHMS[name], ...) for name in sections if name in ALGORITHMS}
        known = create_model("Sections", __base__=FrozenModel, **fields)
        return {**own, algo: getattr(known.model_validate(sections), algo)}

    @classmethod
    def keys(cls) -> dict[str, Any]:
        """Return the sections of all algorithms as well."""
        return super().keys() | ALGORITHMS

    @model_validator(mode="after")
    def _ends(self) -> TrainConfig:
        if self.steps is None and self.time_budget is None:
            raise ValueError("give steps, time_budget or both")
        if self.learner == "sb3" and self.device != "cpu":
            raise ValueError(f"device = {self.device}: needs learner = rsl_rl")
        if self.learner == "rsl_rl":
            self._check_rsl_rl()
        if self.workers is not None:
            self._check_workers(self.workers)
        return self

    def _check_rsl_rl(self) -> None:
        if self.algo != "ppo":
            raise ValueError(f"algo = {self.algo}: rsl_rl has ppo alone; give learner = sb3")
        plain = {"features_extractor": "flat", "asymmetric_critic": False}
        plain |= {"norm_obs": False, "norm_reward": False}
        for name, value in plain.items():
            if getattr(self.hyperparameters, name) != value:
                raise ValueError(f"ppo.{name}: rsl_rl does not have it; give learner = sb3")
        for name in ("icm", "rnd"):
            if getattr(self, name) is not None:
                raise ValueError(f"{name}: rsl_rl does not have it; give learner = sb3")

    def _check_workers(self, workers: int) -> None:
        if self.algo != "ppo" or self.learner != "sb3":
            raise ValueError(f"workers = {workers}: they collect for algo ppo, learner sb3 alone")
        # Their statistics would have to be shared step by step.
        ppo = self.hyperparameters
        shared = {"ppo.norm_obs": ppo.norm_obs, "ppo.norm_reward": ppo.norm_reward}
        shared |= {"icm": self.icm is not None, "rnd": self.rnd is not None}
        for name, given in shared.items():
            if given:
                raise ValueError(f"{name}: cannot be had with workers")
        if ppo.n_envs % workers:
            raise ValueError(f"workers = {workers}: must divide ppo.n_envs = {ppo.n_envs}")

    @property
    def hyperparameters(self) -> Any:
        """The section of the algorithm, an ``AlgorithmConfig``."""
        return getattr(self, self.algo)


def _over_quick(algo: str, given: Any) -> Any:
    """Lay hyper-parameters over those of ``preset: quick``."""
    if algo != "ppo":
        raise ValueError("preset = quick: is for ppo alone")
    return {**stored_values("ppo_quick"), **given} if isinstance(given, Mapping) else given


class RunConfig(FrozenModel):
    """The whole configuration of a run, as stored in its ``config.yaml``."""

    task: TaskConfig
    train: TrainConfig

    @model_validator(mode="after")
    def _knows_dicts(self) -> RunConfig:
        if self.task.observation.space == "flat":
            return self
        train, chosen = self.train, self.train.hyperparameters
        unable = {
            f"algo = {train.algo}": chosen.off_policy,
            "learner = rsl_rl": train.learner == "rsl_rl",
            "workers": train.workers is not None,
            "icm": train.icm is not None,
            "rnd": train.rnd is not None,
            f"{train.algo}.norm_obs": chosen.norm_obs,
            f"{train.algo}.asymmetric_critic": chosen.asymmetric_critic,
        }
        for name, given in unable.items():
            if given:
                raise ValueError(f"train.{name}: needs task.observation.space = flat")
        return self


def with_flags(
    settings: Mapping[str, Any], n_envs: int | None, flags: Mapping[str, Any]
) -> dict[str, Any]:
    """Lay over settings of ``train`` those of ``flags`` that are not None, and ``n_envs`` robots.

    ``n_envs`` belongs to the section of the algorithm.
    """
    merged = merge(settings, {name: value for name, value in flags.items() if value is not None})
    if n_envs is None:
        return merged
    return merge(merged, {merged.get("algo") or "ppo": {"n_envs": n_envs}})


def run_config(
    task: TaskConfig,
    train_settings: dict[str, Any],
    source: str,
    defaults: dict[str, Any] | None = None,
) -> RunConfig:
    """Return a run's whole configuration from settings of ``train``.

    Without steps and without a time budget it gets the default one.

    ``defaults`` stand below all others.

    Raises:
        InputError: a key is unknown or a value not allowed.
    """
    settings = defaults or {}
    for more in (
        algorithm_defaults(train_settings.get("algo") or "ppo"),
        device_defaults(train_settings.get("device") or "cpu"),
        backend_defaults(task.backend),
        preset_defaults(train_settings.get("preset") or "default").get("train", {}),
        train_settings,
    ):
        settings = merge(settings, more)
    if settings.get("steps") is None and settings.get("time_budget") is None:
        settings["time_budget"] = DEFAULT_TIME_BUDGET
    return validate(RunConfig, {"task": task.model_dump(), "train": settings}, source)
