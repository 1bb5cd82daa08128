# SPDX-License-Identifier: Apache-2.0
"""Families of generated worlds. A generator draws one world from the random numbers it is given.

Nothing here checks that a world can be crossed: ``pool.generate_pool`` draws again until it can.
"""

import inspect
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from pm01_nav.errors import InputError
from pm01_nav.worlds.suites.barn_like import barn_like
from pm01_nav.worlds.suites.dynabarn_like import dynabarn_like
from pm01_nav.worlds.suites.indoor import corridors, rooms
from pm01_nav.worlds.suites.maze import maze
from pm01_nav.worlds.suites.mixed import mixed
from pm01_nav.worlds.suites.moving import crowd, crowd_of, warehouse
from pm01_nav.worlds.suites.open import article, empty, static, static_of
from pm01_nav.worlds.suites.traps import u_traps
from pm01_nav.worlds.world import World

Generator = Callable[[np.random.Generator], World]

SUITES: dict[str, Generator] = {
    "empty": empty,
    "static": static,
    "article": article,
    "barn_like": barn_like,
    "dynabarn_like": dynabarn_like,
    "corridors": corridors,
    "rooms": rooms,
    "maze": maze,
    "u_traps": u_traps,
    "crowd": crowd,
    "warehouse": warehouse,
    "mixed": mixed,
}
"""Generators by name; ``generate_pool`` turns one and a range of seeds into a pool."""

VARIANTS: dict[str, Callable[..., Generator]] = {"static": static_of, "crowd": crowd_of}
"""What makes a suite's generator with fixed values of its parameters, for those that have any."""


class ParameterLimits(NamedTuple):
    """What a parameter of a variant may be."""

    low: float
    high: float
    whole: bool


PARAMETERS: dict[str, ParameterLimits] = {
    "obstacles": ParameterLimits(0, 60, whole=True),
    "pedestrians": ParameterLimits(0, 60, whole=True),
    "speed_factor": ParameterLimits(0.1, 5.0, whole=False),
}
"""More than 60 hardly find a place in a room of 10 m x 10 m."""


def suite_generator(name: str, params: Mapping[str, float]) -> Generator:
    """Return the generator of a suite, or of its variant with some parameters fixed.

    Raises:
        InputError: no such suite, it has no such parameter, or a value is not allowed.
    """
    if name not in SUITES:
        raise InputError(f"suite = {name!r}: unknown; allowed: {', '.join(sorted(SUITES))}")
    if not params:
        return SUITES[name]
    allowed = inspect.signature(VARIANTS[name]).parameters if name in VARIANTS else {}
    for key, value in params.items():
        if key not in allowed:
            known = ", ".join(allowed) or "none"
            raise InputError(f"suite_params.{key}: unknown for suite {name}; allowed: {known}")
        low, high, whole = PARAMETERS[key]
        if not low <= value <= high or (whole and value % 1):
            kind = "a whole number" if whole else "a number"
            raise InputError(f"suite_params.{key} = {value:g}: must be {kind}, {low:g} to {high:g}")
    return VARIANTS[name](**{k: int(v) if PARAMETERS[k].whole else v for k, v in params.items()})


__all__ = [
    "SUITES",
    "Generator",
    "article",
    "barn_like",
    "corridors",
    "crowd",
    "dynabarn_like",
    "empty",
    "maze",
    "mixed",
    "rooms",
    "static",
    "suite_generator",
    "u_traps",
    "warehouse",
]
