# SPDX-License-Identifier: Apache-2.0
"""What the held-out worlds of each suite are, as one hash a suite.

Results on held-out worlds can be compared as long as the hashes stay. Who changes a generator, or
the rule by which ``generate_pool`` draws again, changes them: then the results of before no longer
count, and the changelog must say so. To renew the table, put in place of it what this prints:

    python -m pm01_nav.worlds.suites.frozen
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from pm01_nav.worlds.pool import generate_pool
from pm01_nav.worlds.suites import SUITES
from pm01_nav.worlds.world import World

SEEDS = range(1, 129, 2)
"""The first 64 held-out seeds."""
RADIUS = 0.27
"""Of pm01 with the margin that tasks keep [m]: it decides which draws can be crossed."""
DIGITS = 6
"""Numbers are rounded to so many decimals, since the last bits differ between platforms."""

FROZEN: dict[str, str] = {
    "empty": "a0e178d46efa40e2633f7335eebde67bf97229793f74c1c2909aa84919258784",
    "static": "48aff46f09a49f5b4c911086356f7063164f3ebd1de34a0cbc3a4e9b84ef6bc2",
    "article": "698aed3d74a87fa78c8366822237c7a42c1533419f28dc7ae1ce4224ad927125",
    "barn_like": "a779dcf47f1ec0b0c7eb8934d95351199300552248829aba36aa315fbe9d5884",
    "dynabarn_like": "0d883dc4b57f7e8fe52791ae82399822651940b65f6471b4a4ccfb4bbcbd5419",
    "corridors": "227249e33609d86c497da562594e9c11333c7d9e7aecbd97a512ac37eb876896",
    "rooms": "3993ade670af5fd404fcdaeea26fa58e551f71cc38d00c9cb4120cf46ddab771",
    "maze": "e44d4f408981ad4626c431a2eb6f95960e04dcd2a073878fa239979d5ce276be",
    "u_traps": "7df7fe439991f8d70735d4d6a33c27d6122150c929ee25a9eaf929be810a5633",
    "crowd": "94f37fe9abb65617c7ebb4c0b34415ecf5a7a2366cfb0951642648e7edcb7b24",
    "warehouse": "e0e5939665fe45597e942c2e6994e2697d70f86158585ad1062f21bdb5a4810f",
    "mixed": "035d3b4cce0ae87393d18f996654eff59f5f07a65860ccc37db77454644a1096",
}
"""``suite_hash`` of each suite."""


def suite_hash(name: str) -> str:
    """Return the SHA-256 of the first held-out worlds of a suite, in hexadecimal."""
    return worlds_hash(generate_pool(SUITES[name], SEEDS, RADIUS).worlds)


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
    for suite in SUITES:
        sys.stdout.write(f'    "{suite}": "{suite_hash(suite)}",\n')
