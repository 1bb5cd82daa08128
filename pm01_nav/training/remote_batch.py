# SPDX-License-Identifier: Apache-2.0
"""Robots that workers drive, as far as the learner must know of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pm01_nav.task.config import observation_layout
from pm01_nav.task.navigation import NavigationBatch
from pm01_nav.training.config import RunConfig


@dataclass(frozen=True)
class Draws:
    """Which episodes come next."""

    weights: NDArray[np.float64]
    """In which proportion worlds are drawn, shape (num_worlds,)."""
    goal_distance: tuple[float, float]
    """Least and greatest distance from start to goal [m]."""


class DrawnEpisodes:
    """Keep what a curriculum asks a simulator for, until the workers are told."""

    def __init__(self, num_worlds: int, goal_distance: tuple[float, float]) -> None:
        """Begin with all worlds alike."""
        self.draws = Draws(np.ones(num_worlds), goal_distance)

    def draw_worlds(self, weights: NDArray[np.float64]) -> None:
        """Draw worlds in proportion to ``weights`` (num_worlds,) from the next rollout on."""
        self.draws = Draws(weights, self.draws.goal_distance)

    def limit_goal_distance(self, limits: tuple[float, float]) -> None:
        """Set the least and the greatest distance from a start to its goal [m] from then on."""
        self.draws = Draws(self.draws.weights, limits)


class RemoteBatch:
    """The robots of all workers, as far as a run must know of them: who they are, and where."""

    def __init__(self, config: RunConfig) -> None:
        """Begin without any state: the workers will make it."""
        assert config.train.workers is not None
        self.config = config.task
        self.layout = observation_layout(config.task, config.task.robot_spec())
        self.num_envs = config.train.hyperparameters.n_envs
        self.workers = config.train.workers
        self.robots = self.num_envs // self.workers
        """Of each worker."""
        limits = config.task.goal_distance_limits()
        self.simulator = DrawnEpisodes(config.task.num_worlds, limits)
        self.states: list[dict[str, NDArray[Any]] | None] = [None] * self.workers

    def state_dict(self) -> dict[str, NDArray[Any]]:
        """Return the arrays of all workers' states, worker 1's ``pose`` as ``1/pose``."""
        return {
            f"{worker}/{name}": array
            for worker, state in enumerate(self.states)
            for name, array in (state or {}).items()
        }

    def load_state_dict(self, arrays: dict[str, NDArray[Any]]) -> None:
        """Go on from a state returned by ``state_dict``."""
        states: list[dict[str, NDArray[Any]]] = [{} for _ in range(self.workers)]
        for key, array in arrays.items():
            worker, _, name = key.partition("/")
            states[int(worker)][name] = array
        self.states = [state or None for state in states]


Batch = NavigationBatch | RemoteBatch
"""The robots of a run: here, or with workers."""
