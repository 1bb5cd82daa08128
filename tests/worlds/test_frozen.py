# SPDX-License-Identifier: Apache-2.0
"""The hash of worlds sees every change, and no noise in the last bits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pm01_nav.worlds.frozen import SEEDS, worlds_hash
from pm01_nav.worlds.mover import Mover
from pm01_nav.worlds.world import OccupancyGrid, World

TRIANGLE = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
MOVER = Mover("spline", 0.3, TRIANGLE, times=np.array([0.0, 1.0, 2.0]))
WORLD = World(
    "world",
    (0.0, 0.0, 4.0, 4.0),
    discs=np.array([[1.0, 2.0, 0.3]]),
    polygons=(TRIANGLE,),
    segments=np.array([[0.0, 1.0, 2.0, 3.0]]),
    movers=(MOVER,),
    start_area=(0.0, 0.0, 1.0, 1.0),
    goal_area=(2.0, 2.0, 3.0, 3.0),
)
CHANGES = {
    "name": {"name": "other"},
    "bounds": {"bounds": (0.0, 0.0, 4.0, 4.001)},
    "discs": {"discs": np.array([[1.0, 2.0, 0.3001]])},
    "no discs": {"discs": np.zeros((0, 3))},
    "polygons": {"polygons": (TRIANGLE + 0.001,)},
    "one more polygon": {"polygons": (TRIANGLE, TRIANGLE)},
    "segments": {"segments": np.array([[0.0, 1.0, 2.0, 3.001]])},
    "start": {"start": (0.5, 0.5, 0.0)},
    "start area": {"start_area": None},
    "areas changed over": {"start_area": WORLD.goal_area, "goal_area": WORLD.start_area},
    "grid": {"grid": OccupancyGrid(np.ones((2, 2), dtype=np.uint8), 0.1, (0.0, 0.0))},
    "no movers": {"movers": ()},
    "motion": {"movers": (Mover("loop", 0.3, TRIANGLE, speed=1.0),)},
    "speed": {"movers": (Mover("loop", 0.3, TRIANGLE, speed=1.001),)},
    "times": {"movers": (replace(MOVER, times=np.array([0.0, 1.0, 2.001])),)},
}


def test_seeds_are_held_out() -> None:
    assert len(SEEDS) == 64
    assert all(seed % 2 for seed in SEEDS)


def test_every_change_is_seen() -> None:
    hashes = [worlds_hash([replace(WORLD, **change)]) for change in CHANGES.values()]
    assert len({worlds_hash([WORLD]), *hashes}) == len(CHANGES) + 1


@pytest.mark.parametrize("number", [1.0, -1.0, 0.0])
def test_noise_of_another_platform_is_not_seen(number: float) -> None:
    noise = 1e-12
    worlds = [
        replace(WORLD, discs=np.array([[number + delta, -delta, 0.3]])) for delta in (0.0, noise)
    ]
    assert worlds_hash(worlds[:1]) == worlds_hash(worlds[1:])


def test_order_matters() -> None:
    other = replace(WORLD, name="other")
    assert worlds_hash([WORLD, other]) != worlds_hash([other, WORLD])
