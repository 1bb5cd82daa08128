# SPDX-License-Identifier: Apache-2.0
"""Drive the same robots on the CPU and on the GPU and print how far apart they are, as JSON.

python cuda_agreement.py TASK NUM_ENVS STEPS [--errors] [--omni]

With NUMBA_ENABLE_CUDASIM=1 numba's CUDA simulator stands in for the GPU. A process of its own,
since numba decides at its import which of the two it is.
"""

from __future__ import annotations

import json
import sys
from typing import Any

import gymnasium as gym
import numpy as np

from pm01_nav.envs.devices import arrays_on
from pm01_nav.sim.cuda_simulator import CudaSimulator
from pm01_nav.sim.simulator import PlanarSimulator
from pm01_nav.task.config import observation_layout
from pm01_nav.task.navigation import NavigationBatch, features
from pm01_nav.task.randomization import default_randomization
from pm01_nav.task.tasks import task_config
from pm01_nav.task.worlds import world_pool

SEED = 5


def simulators(name: str, num_envs: int, errors: bool) -> tuple[PlanarSimulator, CudaSimulator]:
    """Return the same robots on the CPU and on the GPU, reset."""
    robot_name = "omni_disc" if "--omni" in sys.argv else "pm01"
    task = task_config(name).model_copy(update={"num_worlds": 4, "robot": robot_name})
    robot, pool = task.robot_spec(), world_pool(task, "train", 4)
    options: dict[str, Any] = {"features": features(task, observation_layout(task, robot))}
    cpu = PlanarSimulator(robot, pool, num_envs, **options)
    gpu = CudaSimulator(robot, pool, num_envs, arrays=arrays_on("cuda"), **options)
    for simulator in (cpu, gpu):
        if errors:
            simulator.perturb(default_randomization().ranges(robot, simulator.control_dt))
        simulator.draw_worlds(np.array([0.1, 0.4, 0.4, 0.1]))
        simulator.limit_goal_distance((1.0, 5.0))
        simulator.seed(SEED + np.arange(num_envs))
        simulator.reset()
    return cpu, gpu


def differences(name: str, num_envs: int, steps: int, errors: bool) -> dict[str, float]:
    """Return the greatest difference of each array of the state after driving a while."""
    cpu, gpu = simulators(name, num_envs, errors)
    on, some = arrays_on("cuda"), np.array([0, num_envs - 1])
    rng = np.random.default_rng(SEED)
    for step in range(steps):
        command = rng.uniform(cpu.drive.low, cpu.drive.high, cpu.state.twist.shape)
        cpu.step(command)
        gpu.step(on.from_numpy(command))
        if step == steps // 3:
            mask = np.arange(num_envs) % 2 == 0
            cpu.reset(mask)
            gpu.reset(on.from_numpy(mask))
        if step == steps // 2:
            poses, goals = cpu.state.pose[some[::-1]], cpu.state.goal[some]
            cpu.place(some, poses, goals)
            gpu.place(on.from_numpy(some), on.from_numpy(poses), on.from_numpy(goals))
    expected = cpu.arrays() | {"scan": cpu.scan, "true_scan": cpu.true_scan()}
    actual = gpu.arrays() | {"scan": gpu.scan, "true_scan": gpu.true_scan()}
    return {n: difference(expected[n], on.to_numpy(actual[n])) for n in expected}


def batch_differences(name: str, num_envs: int, steps: int) -> dict[str, float]:
    """Return the same for observations, rewards and ends of a task with automatic resets."""
    task = task_config(name).model_copy(update={"num_worlds": 4, "time_limit_s": 1.2})
    pool, on = world_pool(task, "train", 4), arrays_on("cuda")
    cpu, gpu = (
        NavigationBatch(task, pool, num_envs),
        NavigationBatch(task, pool, num_envs, arrays=on),
    )
    masked = NavigationBatch(task, pool, num_envs, arrays=on)
    seeds = SEED + np.arange(num_envs)
    worst = {"observation": difference(cpu.reset(seeds), on.to_numpy(gpu.reset(seeds)))}
    masked.reset(seeds)
    rng = np.random.default_rng(SEED)
    for _ in range(steps):
        action = rng.uniform(-1.0, 1.0, (num_envs, 2))
        step = cpu.step(action)
        for other in (gpu.step(on.from_numpy(action)), masked.step_all(on.from_numpy(action))):
            for n in ("observation", "reward", "terminated", "truncated"):
                now = difference(getattr(step, n), on.to_numpy(getattr(other, n)))
                worst[n] = max(worst.get(n, 0.0), now)
    return worst


def vector_env_differences(num_envs: int, steps: int) -> dict[str, float]:
    """Return the same for what Gymnasium's vector environment gives."""
    changes = {"num_worlds": 4, "time_limit_s": 1.0}
    name, on = "pm01_nav.envs:PM01Nav-v1", arrays_on("cuda")
    cpu, gpu = (gym.make_vec(name, num_envs, device=d, **changes) for d in ("cpu", "cuda"))
    worst = {
        "reset_observation": difference(
            cpu.reset(seed=SEED)[0], on.to_numpy(gpu.reset(seed=SEED)[0])
        )
    }
    rng = np.random.default_rng(SEED)
    for _ in range(steps):
        action = rng.uniform(-1.0, 1.0, (num_envs, 2))
        (*expected, told), (*actual, info) = cpu.step(action), gpu.step(action)
        assert set(told) == set(info)
        expected += [told[key] for key in ("final_obs", "_final_obs") if key in told]
        actual += [info[key] for key in ("final_obs", "_final_obs") if key in info]
        for n, (a, b) in enumerate(zip(expected, actual, strict=True)):
            part = f"vector_env_{n}_{'observation' if n in (0, 4) else 'rest'}"
            worst[part] = max(worst.get(part, 0.0), difference(a, on.to_numpy(b)))
    return worst


def difference(expected: np.ndarray, actual: np.ndarray) -> float:
    """Return the greatest difference; infinities and NaN must be in the same places."""
    if expected.dtype == np.uint64:
        expected = expected.view(np.int64)
    if expected.dtype.kind != "f":
        return float(np.sum(expected != actual))
    finite = np.isfinite(expected)
    if not np.array_equal(expected[~finite], actual[~finite], equal_nan=True):
        return np.inf
    apart = np.abs(expected[finite].astype(np.float64) - actual[finite])
    return float(apart.max(initial=0.0))


if __name__ == "__main__":
    name, num_envs, steps = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
    found = differences(name, num_envs, steps, "--errors" in sys.argv)
    if "--errors" not in sys.argv:
        found |= batch_differences(name, num_envs, steps)
    if name == "static":
        found |= vector_env_differences(num_envs, steps)
    sys.stdout.write(json.dumps(found) + "\n")
