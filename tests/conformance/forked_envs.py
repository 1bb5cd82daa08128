# SPDX-License-Identifier: Apache-2.0
"""Step environments in processes of their own and print as JSON how far they are from ones here.

python forked_envs.py gymnasium|sb3 fork|spawn|forkserver

The parent has started OpenMP's threads before, which a forked process must not use.
"""

from __future__ import annotations

import json
import sys
from typing import Any

import gymnasium as gym
import numpy as np
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv

from pm01_nav.envs.vector_env import NavVectorEnv

ID = "pm01_nav.envs:PM01Nav-v1"
CHANGES = {"num_worlds": 4, "time_limit_s": 0.8}
STEPS = 20


def actions() -> np.ndarray:
    """Return actions (STEPS, 2, 2)."""
    return np.random.default_rng(0).uniform(-1, 1, (STEPS, 2, 2)).astype(np.float32)


def of_gymnasium(context: str) -> list[Any]:
    """Return what Gymnasium's asynchronous and synchronous environments give."""
    rows = []
    for mode, how in (("async", {"context": context}), ("sync", {})):
        env = gym.make_vec(ID, 2, vectorization_mode=mode, vector_kwargs=how, **CHANGES)
        steps = [env.reset(seed=7)[0].copy()]
        steps += [np.column_stack(env.step(a)[:4]) for a in actions()]
        env.close()
        rows.append(np.concatenate(steps, axis=1))
    return rows


def of_sb3(context: str) -> list[Any]:
    """Return what SB3's environments in processes, and those here, give."""
    rows = []
    for kind, how in ((SubprocVecEnv, {"start_method": context}), (DummyVecEnv, {})):
        env = make_vec_env(ID, 2, seed=7, env_kwargs=CHANGES, vec_env_cls=kind, vec_env_kwargs=how)
        steps = [env.reset()]
        steps += [np.column_stack(env.step(a)[:3]) for a in actions()]
        env.close()
        rows.append(np.concatenate(steps, axis=1))
    return rows


if __name__ == "__main__":
    threaded = NavVectorEnv(64, **CHANGES)
    threaded.reset(seed=0)
    for _ in range(20):
        threaded.step(threaded.action_space.sample())
    there, here = {"gymnasium": of_gymnasium, "sb3": of_sb3}[sys.argv[1]](sys.argv[2])
    # SB3 makes float32 of rewards in one of its two only.
    apart = np.abs(there.astype(np.float32) - here.astype(np.float32))
    found = {"size": there.shape[1], "apart": float(apart.max())}
    sys.stdout.write(json.dumps(found) + "\n")
