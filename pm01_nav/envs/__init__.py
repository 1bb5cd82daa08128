# SPDX-License-Identifier: Apache-2.0
"""The environments; importing this package registers them with Gymnasium."""

from __future__ import annotations

import gymnasium as gym

ENVIRONMENTS: dict[str, dict[str, str]] = {
    "PM01Nav-v0": {"task": "article"},
    "PM01Nav-v1": {"task": "static"},
    "PM01NavGazebo-v0": {"task": "static", "backend": "gazebo"},
}
"""Gymnasium id -> the environment's arguments."""

for _id, _arguments in ENVIRONMENTS.items():
    if _id not in gym.registry:
        gym.register(
            id=_id,
            entry_point="pm01_nav.envs.nav_env:NavEnv",
            vector_entry_point="pm01_nav.envs.vector_env:NavVectorEnv",
            kwargs=_arguments,
        )
