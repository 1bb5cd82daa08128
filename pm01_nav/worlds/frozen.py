# SPDX-License-Identifier: Apache-2.0
"""What the held-out worlds of each suite are, as one hash a suite.

Results on held-out worlds can be compared as long as the hashes stay. Who changes a generator, or
the rule by which ``generate_pool`` draws again, changes them: then the results of before no longer
count, and the changelog must say so. ``@suite(frozen=...)`` has the hash; this prints all of them:

    python -m pm01_nav.worlds.frozen
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from pm01_nav.worlds.pool import generate_pool
from pm01_nav.worlds.suites import suites
from pm01_nav.worlds.world import World

SEEDS = range(1, 129, 2)
"""The first 64 held-out seeds."""
RADIUS = 0.27
"""Of pm01 with the margin that tasks keep [m]: it decides which draws can be crossed."""
DIGITS = 6
"""Numbers are rounded to so many decimals, since the last bits differ between platforms."""


def suite_hash(name: str) -> str:
    """Return the SHA-256 of the first held-out worlds of a suite, in hexadecimal."""
    return worlds_hash(generate_pool(suites()[name].generator, SEEDS, RADIUS).worlds)


def worlds_hash(worlds: Iterable[World]) -> str:
    """Return the SHA-256 of worlds, in hexadecimal; it covers all that a ``World`` holds."""
    digest = hashlib.sha256()
    for world in worlds:
        digest.update(f"{world.name}\0".encode())
        for numbers in _numbers(world):
            array = np.asarray(numbers, dtype=np.float64)
            digest.update(f"{array.shape}\0".encode())
            digest.update(np.rint(array * 10**DIGITS).astype("<i8").tobytes())
        for mover in world.movers:
            digest.update(f"{mover.motion}\0".encode())
    return digest.hexdigest()


def _numbers(world: World) -> list[ArrayLike]:
    """Return all numbers of a world as arrays, what is missing as an array of size 0."""
    numbers: list[ArrayLike] = [world.bounds, world.discs, world.segments]
    numbers += [world.start or (), world.start_area or (), world.goal_area or ()]
    numbers += [len(world.polygons), *world.polygons]
    for mover in world.movers:
        numbers += [mover.points, mover.times, (mover.radius, mover.speed, mover.heading)]
    grid = world.grid
    if grid is not None:
        numbers += [grid.occupied, grid.origin, grid.resolution, grid.yaw, grid.closed]
    return numbers


if __name__ == "__main__":
    for suite in suites():
        sys.stdout.write(f"{suite_hash(suite)}  {suite}\n")
