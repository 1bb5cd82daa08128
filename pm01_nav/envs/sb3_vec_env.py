# SPDX-License-Identifier: Apache-2.0
"""The batch as a native Stable-Baselines3 ``VecEnv``: no copies, no processes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvStepReturn

from pm01_nav.envs.contract import checked_actions, stream_numbers
from pm01_nav.envs.render import BatchRenderer
from pm01_nav.envs.spaces import action_space, observation_space, widened
from pm01_nav.errors import InputError
from pm01_nav.task.navigation import NavigationBatch
from pm01_nav.task.outcomes import Episodes


class NavVecEnv(VecEnv):
    """A ``NavigationBatch`` as SB3's algorithms expect it.

    At the end of an episode ``infos[i]`` holds ``terminal_observation``,
    ``TimeLimit.truncated``, ``is_success`` and ``episode`` (return, length).
    """

    def __init__(
        self,
        batch: NavigationBatch,
        *,
        seed: int = 0,
        reward_scale: float = 1.0,
        render_mode: str | None = None,
    ) -> None:
        """Wrap ``batch``; rewards are multiplied by ``reward_scale`` (episode returns are not).

        In the mode ``rgb_array`` each robot is drawn, as SB3's ``VecVideoRecorder`` needs it.

        Raises:
            InputError: the mode is another one.
        """
        if render_mode not in (None, "rgb_array"):
            raise InputError(f"render_mode = {render_mode!r}: allowed: None, 'rgb_array'")
        self.batch = batch
        self.render_mode = render_mode
        shown = range(batch.num_envs) if render_mode else ()
        self._renderers = [BatchRenderer(batch, "rgb_array", i) for i in shown]
        self.reward_scale = reward_scale
        self.last_episodes: Episodes | None = None
        self._actions = np.zeros((batch.num_envs, batch.layout.drive.size))
        self._next_seeds: list[int] | None = None
        self.seed(seed)
        space = widened(observation_space(batch.layout), batch.privileged)
        super().__init__(batch.num_envs, space, action_space(batch.layout))

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Give environment i the seed ``seed + i`` from the next reset on."""
        if seed is None:
            seed = int(np.random.default_rng().integers(2**31))
        self._next_seeds = [seed + i for i in range(self.batch.num_envs)]
        return list(self._next_seeds)

    def reset(self) -> Any:
        """Start new episodes everywhere; return observations (num_envs, size), or a dict."""
        seeds, self._next_seeds = self._next_seeds, None
        observation = self.batch.reset(None if seeds is None else stream_numbers(seeds))
        for renderer in self._renderers:
            renderer.update(begin=True)
        return self.batch.layout.as_space(observation)

    def step_async(self, actions: ArrayLike) -> None:
        """Take the actions (num_envs, axes) for the next ``step_wait``.

        Raises:
            InputError: they have another shape, or are no numbers.
        """
        self._actions = np.array(checked_actions(actions, self._actions.shape))

    def step_wait(self) -> VecEnvStepReturn:
        """Step; finished environments already hold their next episode's first observation."""
        result = self.batch.step(self._actions)
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        self.last_episodes = result.episodes
        if result.episodes is not None:
            self._describe(result.episodes, result.truncated, infos)
        rewards = (self.reward_scale * result.reward).astype(np.float32)
        dones = result.terminated | result.truncated
        for done, renderer in zip(dones, self._renderers, strict=False):
            renderer.update(begin=bool(done))
        return self.batch.layout.as_space(result.observation), rewards, dones, infos

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """Return a picture (height, width, 3) of each robot; None without a ``render_mode``."""
        return [renderer.frame() for renderer in self._renderers] or [None] * self.num_envs

    def _describe(
        self, episodes: Episodes, truncated: NDArray[np.bool_], infos: list[dict[str, Any]]
    ) -> None:
        as_space = self.batch.layout.as_space
        for k, i in enumerate(episodes.indices):
            infos[i]["terminal_observation"] = as_space(episodes.final_observation[k])
            infos[i]["TimeLimit.truncated"] = bool(truncated[i])
            infos[i]["is_success"] = bool(episodes.success[k])
            infos[i]["episode"] = {
                "r": float(episodes.returns[k]),
                "l": int(episodes.steps[k]),
                "t": 0.0,
            }

    def close(self) -> None:
        """Release nothing: the batch holds arrays only."""

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """Return an attribute of this object, once for each environment asked for."""
        return [getattr(self, attr_name)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Set an attribute of this object; all environments share it.

        Raises:
            InputError: ``indices`` leave some of them out.
        """
        if len(set(self._get_indices(indices))) < self.num_envs:
            raise InputError(
                f"set_attr({attr_name!r}): the environments of a batch share their attributes; "
                "leave indices out"
            )
        setattr(self, attr_name, value)

    def env_method(
        self, method_name: str, *args: Any, indices: VecEnvIndices = None, **kwargs: Any
    ) -> list[Any]:
        """Call a method of this object once; return its result for each environment asked for."""
        result = getattr(self, method_name)(*args, **kwargs)
        return [result] * len(list(self._get_indices(indices)))

    def env_is_wrapped(self, wrapper_class: Any, indices: VecEnvIndices = None) -> list[bool]:
        """Return False for each environment: a batch has no wrappers inside."""
        return [False] * len(list(self._get_indices(indices)))
