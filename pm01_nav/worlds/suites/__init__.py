# SPDX-License-Identifier: Apache-2.0
"""Families of generated worlds. A generator draws one world from the random numbers it is given.

Nothing here checks that a world can be crossed: ``pool.generate_pool`` draws again until it can.
"""

from collections.abc import Callable

import numpy as np

from pm01_nav.worlds.suites.barn_like import barn_like
from pm01_nav.worlds.suites.indoor import corridors, rooms
from pm01_nav.worlds.suites.maze import maze
from pm01_nav.worlds.suites.mixed import mixed
from pm01_nav.worlds.suites.moving import crowd, warehouse
from pm01_nav.worlds.suites.open import article, empty, static
from pm01_nav.worlds.suites.traps import u_traps
from pm01_nav.worlds.world import World

Generator = Callable[[np.random.Generator], World]

SUITES: dict[str, Generator] = {
    "empty": empty,
    "static": static,
    "article": article,
    "barn_like": barn_like,
    "corridors": corridors,
    "rooms": rooms,
    "maze": maze,
    "u_traps": u_traps,
    "crowd": crowd,
    "warehouse": warehouse,
    "mixed": mixed,
}
"""Generators by name; ``generate_pool`` turns one and a range of seeds into a pool."""

__all__ = [
    "SUITES",
    "Generator",
    "article",
    "barn_like",
    "corridors",
    "crowd",
    "empty",
    "maze",
    "mixed",
    "rooms",
    "static",
    "u_traps",
    "warehouse",
]
