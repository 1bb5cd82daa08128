# SPDX-License-Identifier: Apache-2.0
"""Compile every kernel, so that no later command has to; ``python -m pm01_nav.sim.warm_up``."""

from __future__ import annotations

import numpy as np

from pm01_nav.robot import load_robot
from pm01_nav.sim.simulator import PlanarSimulator
from pm01_nav.worlds.free_space import shortest_path_length
from pm01_nav.worlds.global_plan import GlobalPlan, inflate, plan_path
from pm01_nav.worlds.pool import build_pool
from pm01_nav.worlds.world import World


def warm_up() -> None:
    """Run each kernel once on a tiny world; takes half a minute the first time, then no time.

    Those for worlds that move and for perturbed robots are compiled where they are first used.
    """
    disc = np.array([[1.5, 1.5, 0.3]])
    wall = np.array([[0.0, 0.0, 3.0, 0.0]])
    world = World("warm_up", (0.0, 0.0, 3.0, 3.0), discs=disc, segments=wall)
    pool = build_pool([world], radius=0.2)
    for num_envs in (1, 2):  # One robot has a kernel without threads.
        simulator = PlanarSimulator(load_robot("pm01"), pool, num_envs)
        simulator.seed(np.arange(num_envs))
        simulator.reset()
        simulator.step(np.zeros((num_envs, 2)))
        state = simulator.state
        simulator.place(np.arange(num_envs), state.pose.copy(), state.goal.copy())
    space, start, goal = pool.free_space(0), (0.3, 1.5), (2.7, 1.5)
    shortest_path_length(space, start, goal)
    costmap = inflate(space, pool.radius)
    GlobalPlan(costmap, plan_path(costmap, start, goal)).look_ahead(start, 1.0)


if __name__ == "__main__":
    warm_up()
