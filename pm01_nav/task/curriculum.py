# SPDX-License-Identifier: Apache-2.0
"""Which worlds to practise in next, and how far away the goals may lie.

A curriculum changes nothing but the weights with which worlds of the training pool are drawn and
the limits of the goal distance. Held-out worlds never know of it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from pm01_nav.config import FrozenModel
from pm01_nav.errors import InputError
from pm01_nav.robot import NonNegative, Positive

if TYPE_CHECKING:
    from pm01_nav.task.config import TaskConfig
    from pm01_nav.task.outcomes import Episodes

FloatArray = NDArray[np.float64]
Limits = tuple[float, float]
Count = Annotated[int, Field(ge=1)]
Share = Annotated[float, Field(ge=0.0, le=1.0)]


class Stage(FrozenModel):
    """One lesson of a staged curriculum."""

    worlds: dict[str, Positive] = Field(default_factory=dict)
    """Kinds of worlds (``World.name``) and how their episodes are shared out; empty: all evenly."""
    goal_distance: tuple[NonNegative, NonNegative | None] | None = None
    """Least and greatest distance from start to goal [m]; None leaves the task's."""

    @model_validator(mode="after")
    def _is_a_range(self) -> Stage:
        low, high = self.goal_distance or (0.0, None)
        if high is not None and high <= low:
            raise ValueError("goal_distance: the greatest must exceed the least")
        return self


class StagedConfig(FrozenModel):
    """Stages, and when one is passed. By default goals move away, from 3 m to the task's own."""

    stages: Annotated[tuple[Stage, ...], Field(min_length=1)] = (
        Stage(goal_distance=(1.0, 3.0)),
        Stage(goal_distance=(1.0, 6.0)),
        Stage(),
    )
    threshold: Share = 0.9
    """The next stage begins when this part of the last ``window`` episodes succeeded."""
    window: Count = 512


class AutomaticConfig(FrozenModel):
    """How worlds are chosen by learnability; the first two numbers are the paper's for JaxNav."""

    top: Count = 100
    """As many of the most learnable worlds are practised in."""
    share: Share = 0.5
    """This part of the episodes is drawn from them, the rest from all worlds evenly."""
    rate: Annotated[float, Field(gt=0.0, le=1.0)] = 0.1
    """Weight of the newest episode in a world's running success rate."""


class Curriculum(Protocol):
    """Decide, from the episodes so far, which come next."""

    def update(self, episodes: Episodes | None) -> None:
        """Take in the episodes that ended in one step of the batch; call it once a step."""
        ...

    def advance(self) -> None:
        """Move on if it is time; what follows is drawn by the new weights and limits."""
        ...

    def weights(self) -> FloatArray:
        """Return in which proportion worlds are to be drawn, shape (num_worlds,)."""
        ...

    def goal_distance(self) -> Limits | None:
        """Return the least and greatest distance to the goal [m]; None leaves the task's."""
        ...

    def metrics(self) -> dict[str, float]:
        """Return what is worth logging."""
        ...

    def state_dict(self) -> dict[str, Any]:
        """Return numbers and lists of numbers to go on from."""
        ...

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from ``state_dict``.

        Raises:
            ValueError: it is of another curriculum.
        """
        ...


class Uniform:
    """All worlds evenly, always: no curriculum."""

    def __init__(self, num_worlds: int) -> None:
        """Keep the number of worlds."""
        self._num_worlds = num_worlds

    def update(self, episodes: Episodes | None) -> None:
        """Do nothing."""

    def advance(self) -> None:
        """Do nothing."""

    def weights(self) -> FloatArray:
        """Return the same number for each world."""
        return np.ones(self._num_worlds)

    def goal_distance(self) -> Limits | None:
        """Return None."""
        return None

    def metrics(self) -> dict[str, float]:
        """Return nothing."""
        return {}

    def state_dict(self) -> dict[str, Any]:
        """Return nothing."""
        return {}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Expect nothing; see ``Curriculum``."""
        _expect(state, self.state_dict())


class Staged:
    """One stage after the other, never back.

    A stage is judged by the episodes that it drew, so not by those under way when it began.
    """

    def __init__(self, config: StagedConfig, names: Sequence[str]) -> None:
        """Keep the stages; ``names`` are the worlds' in the pool.

        Raises:
            InputError: a stage names a kind of world that is not in the pool.
        """
        self._config = config
        self._weights = [_stage_weights(config, i, names) for i in range(len(config.stages))]
        self._recent: deque[bool] = deque(maxlen=config.window)
        # Steps since the stage began; one more in the first, which draws the first episodes too.
        self._age = 1
        self.stage = 0
        """Index of the present stage."""

    def update(self, episodes: Episodes | None) -> None:
        """Count successes; see ``Curriculum``."""
        self._age += 1
        if episodes is not None:
            self._recent.extend(episodes.success[episodes.steps < self._age].tolist())

    def advance(self) -> None:
        """Begin the next stage if enough of the last episodes succeeded."""
        full = len(self._recent) == self._config.window
        last = self.stage == len(self._config.stages) - 1
        if full and not last and self._success_rate() >= self._config.threshold:
            self.stage += 1
            self._recent.clear()
            self._age = 0

    def weights(self) -> FloatArray:
        """Return the present stage's weights, shape (num_worlds,)."""
        return self._weights[self.stage]

    def goal_distance(self) -> Limits | None:
        """Return the present stage's limits [m], if it has any."""
        limits = self._config.stages[self.stage].goal_distance
        if limits is None:
            return None
        return limits[0], np.inf if limits[1] is None else limits[1]

    def metrics(self) -> dict[str, float]:
        """Return the stage, its success rate so far and the effective number of worlds."""
        return {
            "stage": float(self.stage),
            "stage_success_rate": self._success_rate(),
            "effective_worlds": effective_number(self.weights()),
        }

    def state_dict(self) -> dict[str, Any]:
        """Return the stage and what was seen of it."""
        return {"stage": self.stage, "age": self._age, "recent": list(self._recent)}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from ``state``; see ``Curriculum``."""
        _expect(state, self.state_dict())
        if not 0 <= state["stage"] < len(self._weights):
            raise ValueError(f"curriculum stage {state['stage']} of {len(self._weights)}")
        self.stage, self._age = state["stage"], state["age"]
        self._recent = deque(state["recent"], maxlen=self._config.window)

    def _success_rate(self) -> float:
        return float(np.mean(self._recent)) if self._recent else float("nan")


class Automatic:
    """Sampling for learnability (Rutherford et al. 2024, "No Regrets"), on a fixed pool.

    A world that the policy solves with probability p teaches it most where p (1 - p) is large. The
    paper draws thousands of new levels every so often, tries each for some episodes to estimate p,
    and keeps the most learnable ones in a buffer. Here the worlds are fixed, so p is an
    exponential average over the training episodes of each, without episodes of its own; the
    evenly drawn share of the episodes keeps the estimates of all worlds fresh. A world never seen
    counts as p = 1/2, the most learnable.
    """

    def __init__(self, config: AutomaticConfig, num_worlds: int) -> None:
        """Begin with p = 1/2 everywhere."""
        self._config = config
        self.success = np.full(num_worlds, 0.5)
        """Running success rate of each world, shape (num_worlds,)."""

    def update(self, episodes: Episodes | None) -> None:
        """Move the success rates of the episodes' worlds; see ``Curriculum``."""
        if episodes is None:
            return
        # One by one: a world may have ended several episodes in this step.
        for world, success in zip(episodes.world, episodes.success, strict=True):
            self.success[world] += self._config.rate * (success - self.success[world])

    def advance(self) -> None:
        """Do nothing: the weights follow the success rates."""

    def learnability(self) -> FloatArray:
        """Return p (1 - p) for each world, shape (num_worlds,)."""
        return self.success * (1.0 - self.success)

    def weights(self) -> FloatArray:
        """Return an even share for all worlds, and the share of the most learnable ones on top.

        Worlds as learnable as the last of the ``top`` ones are among them, so that the order in
        the pool never matters.
        """
        learnability = self.learnability()
        top = min(self._config.top, len(learnability))
        chosen = learnability >= np.partition(learnability, -top)[-top]
        even = (1.0 - self._config.share) / len(learnability)
        return even + self._config.share * chosen / chosen.sum()

    def goal_distance(self) -> Limits | None:
        """Return None."""
        return None

    def metrics(self) -> dict[str, float]:
        """Return the mean learnability, plain and as drawn, and the effective number of worlds."""
        learnability, weights = self.learnability(), self.weights()
        return {
            "learnability": float(learnability.mean()),
            "learnability_drawn": float(weights @ learnability),
            "effective_worlds": effective_number(weights),
        }

    def state_dict(self) -> dict[str, Any]:
        """Return the success rates."""
        return {"success": self.success.tolist()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from ``state``; see ``Curriculum``."""
        _expect(state, self.state_dict())
        if len(state["success"]) != len(self.success):
            raise ValueError(
                f"curriculum of {len(state['success'])}, not {len(self.success)} worlds"
            )
        self.success = np.array(state["success"], dtype=np.float64)


CurriculumName = Literal["none", "staged", "automatic"]


def make_curriculum(
    name: CurriculumName, staged: StagedConfig, automatic: AutomaticConfig, names: Sequence[str]
) -> Curriculum:
    """Build a curriculum by its name for a pool of worlds called ``names``.

    Raises:
        InputError: a stage does not fit the pool.
    """
    if name == "staged":
        return Staged(staged, names)
    if name == "automatic":
        return Automatic(automatic, len(names))
    return Uniform(len(names))


class DrawsEpisodes(Protocol):
    """Whatever draws the worlds and goals of the next episodes."""

    def draw_worlds(self, weights: FloatArray) -> None:
        """Draw worlds in proportion to ``weights`` (num_worlds,) from now on."""
        ...

    def limit_goal_distance(self, limits: Limits) -> None:
        """Set the least and the greatest distance from a start to its goal [m] from now on."""
        ...


class Practises(Protocol):
    """A batch, as far as a curriculum must know it."""

    @property
    def config(self) -> TaskConfig:
        """The task."""
        ...

    @property
    def simulator(self) -> DrawsEpisodes:
        """What draws its episodes."""
        ...


def apply(curriculum: Curriculum, batch: Practises) -> None:
    """Advance ``curriculum`` and let the next episodes of ``batch`` be drawn as it says."""
    curriculum.advance()
    batch.simulator.draw_worlds(curriculum.weights())
    limits = curriculum.goal_distance()
    batch.simulator.limit_goal_distance(limits or batch.config.goal_distance_limits())


def effective_number(weights: FloatArray) -> float:
    """Return how many evenly drawn worlds would be as varied: 1 / sum of squared probabilities."""
    return float(weights.sum() ** 2 / np.square(weights).sum())


def _stage_weights(config: StagedConfig, index: int, names: Sequence[str]) -> FloatArray:
    """Share each kind's weight out among its worlds; return the weights, shape (num_worlds,)."""
    shares = config.stages[index].worlds
    kinds, kind, count = np.unique(list(names), return_inverse=True, return_counts=True)
    if unknown := sorted(set(shares) - set(kinds.tolist())):
        raise InputError(
            f"train.staged.stages.{index}.worlds.{unknown[0]}: no world of the pool is called so; "
            f"allowed: {', '.join(kinds.tolist())}"
        )
    if not shares:
        return np.ones(len(names))
    share = np.array([shares.get(k, 0.0) for k in kinds.tolist()])
    return (share / share.sum() / count)[kind]


def _expect(state: dict[str, Any], like: dict[str, Any]) -> None:
    if set(state) != set(like):
        raise ValueError(f"curriculum state has {sorted(state)}, needs {sorted(like)}")
