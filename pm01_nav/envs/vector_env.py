# SPDX-License-Identifier: Apache-2.0
"""The batch as a Gymnasium ``VectorEnv``."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from pm01_nav.envs.devices import arrays_on
from pm01_nav.envs.render import RENDER_MODES, BatchRenderer
from pm01_nav.envs.spaces import action_space, observation_space, resolve_task
from pm01_nav.errors import InputError
from pm01_nav.task.config import TaskConfig
from pm01_nav.task.navigation import Episodes, NavigationBatch
from pm01_nav.task.worlds import world_pool

BatchInfo = dict[str, Any]


class NavVectorEnv(VectorEnv[NDArray[Any], NDArray[Any], NDArray[Any]]):
    """Many robots stepped together; see ``NavEnv`` for the task.

    Environment i of a batch reset with seed s does exactly what one environment reset with seed
    s + i does. A finished episode is followed by a new one in the same step: ``infos`` then holds
    ``final_obs`` and ``final_info`` with the masks ``_final_obs`` and ``_final_info``.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 (the base class declares it so)
        "render_modes": list(RENDER_MODES),
        "render_fps": 10,
        "autoreset_mode": AutoresetMode.SAME_STEP,
    }

    def __init__(
        self,
        num_envs: int = 1,
        task: str | TaskConfig = "static",
        render_mode: str | None = None,
        device: str = "cpu",
        **changes: Any,
    ) -> None:
        """Make ``num_envs`` environments of a task; ``changes`` are keys of ``TaskConfig``.

        On the device ``cuda`` the simulator runs on an NVIDIA GPU; observations, rewards and ends
        are torch tensors there, and actions may be.

        Raises:
            InputError: the task or a changed key is unknown, a value is not allowed, there is no
                usable GPU, or pictures are asked for from one.
        """
        config = resolve_task(task, changes)
        if render_mode and device != "cpu":
            raise InputError(f"render_mode = {render_mode!r}: needs device='cpu'")
        self.num_envs = num_envs
        pool = world_pool(config, "train", config.num_worlds)
        self.batch = NavigationBatch(config, pool, num_envs, arrays=arrays_on(device))
        self.single_observation_space = observation_space(self.batch.layout)
        self.single_action_space = action_space()
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.render_mode = render_mode
        shown = range(1 if render_mode == "human" else num_envs) if render_mode else ()
        self._renderers = [BatchRenderer(self.batch, render_mode or "", i) for i in shown]

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, BatchInfo]:
        """Start new episodes everywhere; an int seed gives environment i the seed ``seed + i``."""
        observation = self.batch.reset(self._seeds(seed))
        for renderer in self._renderers:
            renderer.update(begin=True)
        return observation, {}

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, BatchInfo]:
        """Apply actions (num_envs, 2) in [-1, 1]."""
        arrays = self.batch.arrays
        float64 = arrays.xp.float64
        result = self.batch.step(arrays.xp.asarray(actions, dtype=float64, device=arrays.place))
        ended = result.terminated | result.truncated
        for i, renderer in enumerate(self._renderers):
            renderer.update(begin=bool(ended[i]))
        infos = self._infos(result.episodes) if result.episodes else {}
        return result.observation, result.reward, result.terminated, result.truncated, infos

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Return a picture of each robot; in mode ``human`` a window shows the first one."""
        if self.render_mode != "rgb_array":
            return None
        return tuple(renderer.frame() for renderer in self._renderers)

    def close_extras(self, **kwargs: Any) -> None:
        """Close the window."""
        for renderer in self._renderers:
            renderer.close()

    def _seeds(self, seed: int | list[int | None] | None) -> NDArray[np.int64] | None:
        if isinstance(seed, list):
            given = [s if s is not None else int(self.np_random.integers(2**31)) for s in seed]
            return np.array(given)
        if seed is not None:
            VectorEnv.reset(self, seed=seed)
            return seed + np.arange(self.num_envs)
        if self._np_random is None:
            return self.np_random.integers(2**31, size=self.num_envs)
        return None

    def _infos(self, episodes: Episodes) -> BatchInfo:
        xp, place = self.batch.arrays.xp, self.batch.arrays.place
        ended = xp.zeros(self.num_envs, dtype=xp.bool, device=place)
        ended[episodes.indices] = True
        size = (self.num_envs, self.batch.layout.size)
        final = xp.zeros(size, dtype=xp.float32, device=place)
        final[ended] = episodes.final_observation
        success, collision = xp.zeros_like(ended), xp.zeros_like(ended)
        success[ended], collision[ended] = episodes.success, episodes.collision
        final_info = {
            "is_success": success,
            "_is_success": ended,
            "is_collision": collision,
            "_is_collision": ended,
        }
        return {
            "final_obs": final,
            "_final_obs": ended,
            "final_info": final_info,
            "_final_info": ended,
        }
