# SPDX-License-Identifier: Apache-2.0
"""What comes of a step of a batch, and of the episodes that end in it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Episodes:
    """Episodes that ended in one step; one row each."""

    indices: NDArray[np.int64]
    """Which environments, shape (n,)."""
    world: NDArray[np.int64]
    """The world of each in the pool, shape (n,)."""
    success: NDArray[np.bool_]
    collision: NDArray[np.bool_]
    steps: NDArray[np.int64]
    returns: NDArray[np.float64]
    """Sum of rewards, shape (n,)."""
    terms: dict[str, NDArray[np.float64]]
    """Each reward term's weighted sum, shape (n,)."""
    final_observation: NDArray[np.float32]
    """The last observation before the reset, shape (n, observation size)."""
    faults: dict[int, str] = field(default_factory=dict)
    """Why the simulator gave environments up, if it did."""


@dataclass(frozen=True)
class BatchStep:
    """The outcome of one step of every environment, after the finished ones were reset."""

    observation: NDArray[np.float32]
    reward: NDArray[np.float64]
    rewards: dict[str, NDArray[np.float64]]
    """Each term's weighted share of ``reward``, shape (num_envs,)."""
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    episodes: Episodes | None
    """Those that ended, if any."""


class MaskedStep(NamedTuple):
    """The outcome of one step where nothing may depend on which environments ended.

    All have one row an environment; the last five tell of the episode and are final where it ended.
    """

    observation: Any
    reward: Any
    terminated: Any
    truncated: Any
    success: Any
    world: Any
    """The episode's world in the pool."""
    steps: Any
    returns: Any
    """Sum of rewards."""
    term_sums: Any
    """Each reward term's weighted sum, shape (num_terms, num_envs)."""
