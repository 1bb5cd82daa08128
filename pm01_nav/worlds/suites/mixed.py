# SPDX-License-Identifier: Apache-2.0
"""A bit of everything."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pm01_nav.worlds.suites.indoor import corridors, rooms
from pm01_nav.worlds.suites.maze import maze
from pm01_nav.worlds.suites.moving import crowd, warehouse
from pm01_nav.worlds.suites.open import static
from pm01_nav.worlds.suites.registry import suite
from pm01_nav.worlds.suites.traps import u_traps
from pm01_nav.worlds.world import World

# The law of ``mixed``. Not in it: `empty`, which teaches nothing that `static` does not; `article`
# and `barn_like`, whose fixed start and goal belong to another robot's or version's task.
WEIGHTS: dict[Callable[[np.random.Generator], World], float] = {
    static: 0.20,
    corridors: 0.15,
    rooms: 0.20,
    maze: 0.10,
    u_traps: 0.15,
    crowd: 0.10,
    warehouse: 0.10,
}
"""Probability of each suite."""


@suite(frozen="035d3b4cce0ae87393d18f996654eff59f5f07a65860ccc37db77454644a1096")
def mixed(rng: np.random.Generator) -> World:
    """Draw a world of one of the suites in ``WEIGHTS``; it keeps that suite's name."""
    suites = list(WEIGHTS)
    index = rng.choice(len(suites), p=list(WEIGHTS.values()))
    return suites[index](rng)
