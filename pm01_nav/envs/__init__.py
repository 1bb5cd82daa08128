# SPDX-License-Identifier: Apache-2.0
"""The environments; importing this package registers them with Gymnasium."""

from __future__ import annotations

import gymnasium as gym

ENVIRONMENTS = {"PM01Nav-v0": "article", "PM01Nav-v1": "static"}
"""Gymnasium id -> task."""

for _id, _task in ENVIRONMENTS.items():
    if _id not in gym.registry:
        gym.register(
            id=_id,
            entry_point="pm01_nav.envs.nav_env:NavEnv",
            vector_entry_point="pm01_nav.envs.vector_env:NavVectorEnv",
            kwargs={"task": _task},
        )
