# SPDX-License-Identifier: Apache-2.0
"""The worlds a task is trained and evaluated in."""

from __future__ import annotations

from typing import Any, Literal

from pm01_nav.errors import InputError
from pm01_nav.robot import RobotSpec
from pm01_nav.task.config import TaskConfig
from pm01_nav.worlds.pool import WorldPool
from pm01_nav.worlds.suites import SOURCES, Wanted, WorldSource, world_source_of

Split = Literal["train", "held_out"]
KEYS = ("suite_params", "map", "models", "partial", "region", "worlds")
"""What a task tells its source of worlds; no source reads all of it."""
SEEDS_PER_RUN = 1 << 20
"""World seeds set aside for each run seed, so that no two runs share worlds."""


def world_pool(
    config: TaskConfig,
    split: Split,
    count: int,
    seed: int = 0,
    *,
    first: int = 0,
    robot: RobotSpec | None = None,
) -> WorldPool:
    """Make or read worlds for a task, as its suite says.

    Generated worlds of the two splits never share a seed; ``seed`` chooses among those of a
    split, and the first of them can be left out. Worlds from files are the same in both splits
    and ``count`` and ``first`` do not apply. ``robot`` takes the place of the task's.

    Raises:
        InputError: the suite is unknown, its files are unusable, or no way leads to a goal.
    """
    source = world_source_of(config.suite)
    footprint = (robot or config.robot_spec()).footprint
    seeds = world_seeds(split, first + count, seed)[first:]
    return source.build(Wanted(seeds, footprint, config.margin), **_given(config, source))


def world_seeds(split: Split, count: int, seed: int) -> range:
    """Return the world seeds that a run with ``seed`` draws from: even to train, odd held out."""
    first = 2 * seed * SEEDS_PER_RUN + (split == "held_out")
    return range(first, first + 2 * count, 2)


def _given(config: TaskConfig, source: WorldSource) -> dict[str, Any]:
    """Return what a task tells its source.

    Raises:
        InputError: the path of its files is missing, or something is given that it does not read.
    """
    for key in KEYS:
        if key not in source.keys and getattr(config, key):
            readers = ", ".join(name for name, other in SOURCES.items() if key in other.keys)
            raise InputError(f"{key}: is for the suites {readers}, not for {config.suite}")
    if source.path is not None and getattr(config, source.path) is None:
        raise InputError(f"{source.path}: this task needs it; give --{source.path} PATH")
    return {key: getattr(config, key) for key in source.keys}
