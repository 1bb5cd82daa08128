# SPDX-License-Identifier: Apache-2.0
"""Robots with changes, and simulators with robots at chosen poses."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

from pm01_nav.config import merge, validate
from pm01_nav.robot import RobotSpec, load_robot
from pm01_nav.sim.simulator import PlanarSimulator
from pm01_nav.task.randomization import RandomizationConfig
from pm01_nav.worlds.pool import build_pool
from pm01_nav.worlds.world import World

MakeRobot = Callable[..., RobotSpec]
Simulate = Callable[..., PlanarSimulator]


@pytest.fixture
def make_robot() -> MakeRobot:
    """Return a robot of the package with changes laid over it."""

    def make(base: str = "pm01", **changes: Any) -> RobotSpec:
        return validate(RobotSpec, merge(load_robot(base).model_dump(), changes), "test")

    return make


@pytest.fixture
def simulate() -> Simulate:
    """Return a simulator with one robot at each pose, all in the same world or each in its own.

    ``errors`` says what is wrong with the robots: a range or a fixed number for each quantity.
    """

    def make(
        robot: RobotSpec,
        worlds: World | Sequence[World],
        poses: ArrayLike,
        errors: dict[str, Any] | None = None,
        **arguments: Any,
    ) -> PlanarSimulator:
        poses = np.atleast_2d(np.asarray(poses, dtype=np.float64))
        worlds = [worlds] if isinstance(worlds, World) else list(worlds)
        # The radius decides only where episodes start; these robots are placed by hand.
        pool = build_pool(worlds, radius=0.01)
        simulator = PlanarSimulator(robot, pool, len(poses), **arguments)
        if errors is not None:
            ranges = {n: v if isinstance(v, tuple) else (v, v) for n, v in errors.items()}
            config = RandomizationConfig.model_validate(ranges)
            simulator.perturb(config.ranges(robot, simulator.control_dt))
        simulator.seed(np.arange(len(poses)))
        simulator.reset(worlds=np.arange(len(poses)) % len(worlds))
        simulator.place(np.arange(len(poses)), poses, np.zeros((len(poses), 2)))
        return simulator

    return make
