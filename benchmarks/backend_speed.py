# SPDX-License-Identifier: Apache-2.0
"""Environment steps a second in the physics engines: 10 Hz control, 5 ms physics, 20 beams.

python benchmarks/backend_speed.py --out benchmarks/results/backend_speed.json
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np
from report import rate, write_report

from pm01_nav.backends import BackendName
from pm01_nav.config import merge, validate
from pm01_nav.robot import full_circle
from pm01_nav.task.config import TaskConfig
from pm01_nav.task.navigation import NavigationBatch
from pm01_nav.task.tasks import task_config
from pm01_nav.task.worlds import world_pool

NUM_ENVS: dict[BackendName, int] = {"mujoco": 256, "pybullet": 32}
OBSTACLES = 12


def batch_on(backend: BackendName, num_envs: int) -> NavigationBatch:
    """Return robots among 12 obstacles, ready to step."""
    changes = {
        "backend": backend,
        "suite_params": {"obstacles": OBSTACLES},
        "robot_changes": {"lidar": full_circle(20)},
        "observation": {"sectors": 0},
    }
    task = validate(TaskConfig, merge(task_config("static").model_dump(), changes), "speed")
    batch = NavigationBatch(task, world_pool(task, "train", 64), num_envs)
    batch.reset(np.arange(num_envs))
    return batch


def measure(backend: BackendName, seconds: float, repeats: int) -> dict[str, Any]:
    """Return environment steps a second, resets included."""
    num_envs = NUM_ENVS[backend]
    batch = batch_on(backend, num_envs)
    rng = np.random.default_rng(0)
    for _ in range(60):  # until most worlds were compiled once
        batch.step(rng.uniform(-1.0, 1.0, (num_envs, 2)))

    def step() -> None:
        batch.step(rng.uniform(-1.0, 1.0, (num_envs, 2)))

    return {"num_envs": num_envs} | rate(step, num_envs, seconds, repeats)


def main() -> None:
    """Measure and report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", required=True)
    parser.add_argument("--seconds", type=float, default=2.0, help="of each repeat")
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    rates = {backend: measure(backend, options.seconds, options.repeats) for backend in NUM_ENVS}
    write_report(options.out, {"env_steps_per_second": rates})


if __name__ == "__main__":
    main()
