# SPDX-License-Identifier: Apache-2.0
"""Compile the simulator's kernels in two processes, each one once, before tests run side by side.

Else every worker of pytest-xdist that comes to a test of a kernel compiles it by itself.
"""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np

from pm01_nav.task.navigation import NavigationBatch
from pm01_nav.task.randomization import default_randomization
from pm01_nav.task.tasks import task_config
from pm01_nav.task.worlds import world_pool


def compile_for(errors: bool) -> None:
    """Step robots with errors or without, in worlds that stand and that move, many and one.

    One alone has kernels without threads.
    """
    for name in ("static", "mixed"):
        changes = {"num_worlds": 4, "randomization": default_randomization() if errors else None}
        config = task_config(name).model_copy(update=changes)
        pool = world_pool(config, "train", 4)
        for num_envs in (2, 1):
            batch = NavigationBatch(config, pool, num_envs)
            batch.reset(np.arange(num_envs))
            batch.step(np.zeros((num_envs, batch.layout.drive.size)))


if __name__ == "__main__":
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as processes:
        list(processes.map(compile_for, (True, False)))
