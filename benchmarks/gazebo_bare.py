# SPDX-License-Identifier: Apache-2.0
"""Gazebo's server stepped by a bare loop, for ``gazebo_speed.py``; it runs in a process of its own.

It is a module because that process has to find it.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np

from pm01_nav.backends.engine import Scenario
from pm01_nav.backends.gazebo.worker import Reading, Setup, open_gazebo
from pm01_nav.worlds.world import World


class BareServer:
    """A server whose step is a loop of ``run`` and a wait for its scan, many times over."""

    def __init__(self, world: Path, setup: Setup) -> None:
        """Start the usual server, then use what is under it."""
        self._inner: Any = open_gazebo(world, setup)
        self._setup = setup

    def reset(self, scenario: Scenario, world: World | None) -> Reading:
        """Reset as usual."""
        return self._inner.reset(scenario, world)

    def bare_loop(self, loops: int) -> float:
        """Return real seconds of so many control steps."""
        inner, setup = self._inner, self._setup
        iterations = setup.ticks * setup.iterations
        # The robot drives as it does in what this is compared with.
        commands = np.random.default_rng(0).uniform([-0.2, -1.5], [0.5, 1.5], (loops, 2))
        began = time.perf_counter()
        for command in commands:
            inner._publish(command)
            inner._left = 0
            inner._server.run(True, iterations, False)
            inner._time_ns += round(setup.control_dt * 1e9)
            inner._scans.wait(inner._time_ns, 20.0)
        return time.perf_counter() - began


def open_bare(world: Path, setup: Setup) -> Any:
    """Start a server for the bare loop in the process that this is called in."""
    return BareServer(world, setup)
