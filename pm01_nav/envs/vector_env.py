# SPDX-License-Identifier: Apache-2.0
"""The batch as a Gymnasium ``VectorEnv``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from pm01_nav.envs.contract import (
    Seeds,
    autoreset_mode_of,
    checked_actions,
    checked_mask,
    one_each,
    stream_numbers,
)
from pm01_nav.envs.devices import arrays_on
from pm01_nav.envs.render import RENDER_MODES, BatchRenderer
from pm01_nav.envs.spaces import action_space, described, observation_space, resolve_task
from pm01_nav.errors import InputError
from pm01_nav.task.config import TaskConfig
from pm01_nav.task.navigation import NavigationBatch
from pm01_nav.task.outcomes import BatchStep
from pm01_nav.task.worlds import world_pool

BatchInfo = dict[str, Any]


class NavVectorEnv(VectorEnv[Any, NDArray[Any], NDArray[Any]]):
    """Many robots stepped together; see ``NavEnv`` for the task.

    Environment i does exactly what one environment does that is reset with its seed. Gymnasium's
    three ways to go on after an episode can be asked for by ``autoreset_mode``:

    - ``SameStep`` (default): a new one begins in the same step; ``infos`` then holds ``final_obs``
      and ``final_info`` with the masks ``_final_obs`` and ``_final_info``.
    - ``NextStep``: a new one begins in the next step, whose action does not count and whose reward
      is 0. Gymnasium's wrappers of observations need this.
    - ``Disabled``: whoever steps resets: ``reset(options={"reset_mask": ended})``.
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
        autoreset_mode: str | AutoresetMode = AutoresetMode.SAME_STEP,
        **changes: Any,
    ) -> None:
        """Make ``num_envs`` environments of a task; ``changes`` are keys of ``TaskConfig``.

        On the device ``cuda`` the simulator runs on an NVIDIA GPU; observations, rewards and ends
        are torch tensors there, and actions may be.

        Raises:
            InputError: the task, the mode or a changed key is unknown, a value is not allowed,
                there is no usable GPU, or pictures are asked for from one.
        """
        config = resolve_task(task, changes)
        if num_envs < 1:
            raise InputError(f"num_envs = {num_envs}: must be at least 1")
        if render_mode and device != "cpu":
            raise InputError(f"render_mode = {render_mode!r}: needs device='cpu'")
        self.num_envs = num_envs
        self._mode = autoreset_mode_of(autoreset_mode)
        self.metadata = described(self.metadata, config, autoreset_mode=self._mode)
        pool, arrays = world_pool(config, "train", config.num_worlds), arrays_on(device)
        self.batch = NavigationBatch(config, pool, num_envs, autoreset=False, arrays=arrays)
        self.single_observation_space = observation_space(self.batch.layout)
        self.single_action_space = action_space(self.batch.layout)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.render_mode = render_mode
        shown = range(1 if render_mode == "human" else num_envs) if render_mode else ()
        self._renderers = [BatchRenderer(self.batch, render_mode or "", i) for i in shown]
        self._seeded = np.zeros(num_envs, dtype=np.bool_)
        self._ended: Any = None  # Which episodes are over; None before the first reset.

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Any, BatchInfo]:
        """Start new episodes everywhere, or where the mask ``options["reset_mask"]`` says.

        An int gives environment i the seed ``seed + i``, a list to each its own. Without a seed,
        and where the list has None, an environment goes on with its random numbers.

        Raises:
            InputError: the list or the mask has another length, a seed is negative, or the first
                reset leaves some environments out.
        """
        seeds = one_each(seed, self.num_envs)
        mask = checked_mask(options, self.num_envs, self.batch.arrays)
        if mask is None:
            mask = np.ones(self.num_envs, dtype=np.bool_)
        elif self._ended is None and not mask.all():
            raise InputError("options['reset_mask']: the first reset is one of all environments")
        if not isinstance(seed, Sequence | np.ndarray):
            VectorEnv.reset(self, seed=seeds[0])
        self._seed(seeds, mask)
        begins = self.batch.arrays.from_numpy(mask)
        self.batch.begin(self.batch.arrays.xp.nonzero(begins)[0])
        self._ended = self._none() if self._ended is None else self._ended & ~begins
        for i, renderer in enumerate(self._renderers):
            if mask[i]:
                renderer.update(begin=True)
        return self.batch.layout.as_space(self.batch.observe()), {}

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, BatchInfo]:
        """Apply actions (num_envs, axes) in [-1, 1].

        Raises:
            ResetNeeded: there was no ``reset`` yet, or none of what ended, if nobody else resets.
            InputError: the actions have another shape or are not finite.
        """
        begins = self._to_begin()
        shape = (self.num_envs, self.batch.layout.drive.size)
        actions = checked_actions(actions, shape, self.batch.arrays)
        result = self.batch.step(actions, begins)
        observation, infos = result.observation, {}
        ended = result.terminated | result.truncated
        facts, begun, self._ended = self._facts(result), begins, ended
        if result.episodes is not None and self._mode is AutoresetMode.SAME_STEP:
            done = result.episodes.indices
            infos = self._told({"final_info": facts}, ended)
            infos |= {"final_obs": self._final(observation, done), "_final_obs": ended}
            observation[done] = self.batch.begin(done)
            begun, self._ended = ended, self._none()
        for i, renderer in enumerate(self._renderers):
            renderer.update(begin=begun is not None and bool(begun[i]))
        if begun is None or not begun.all():
            infos |= self._told(facts, ~(self._none() if begun is None else begun))
        observation = self.batch.layout.as_space(observation)
        return observation, result.reward, result.terminated, result.truncated, infos

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Return a picture of each robot; in mode ``human`` a window shows the first one.

        Raises:
            ResetNeeded: there was no ``reset`` yet.
        """
        if self._ended is None:
            raise ResetNeeded("call reset before render")
        if self.render_mode != "rgb_array":
            return None
        return tuple(renderer.frame() for renderer in self._renderers)

    def close_extras(self, **kwargs: Any) -> None:
        """Close the window."""
        for renderer in self._renderers:
            renderer.close()

    def _final(self, observation: Any, done: Any) -> Any:
        """Return last observations, zero where an episode goes on; as dicts, None there."""
        layout = self.batch.layout
        if layout.space == "flat":
            final = self.batch.arrays.xp.zeros_like(observation)
            final[done] = observation[done]
            return final
        # Gymnasium's own vector environments have an array of objects here, too.
        final = np.full(self.num_envs, None, dtype=object)
        for i, row in zip(self.batch.arrays.to_numpy(done), observation[done], strict=True):
            final[i] = layout.split(row)
        return final

    def _none(self) -> Any:
        """Return a mask of no environment."""
        arrays = self.batch.arrays
        return arrays.xp.zeros(self.num_envs, dtype=arrays.xp.bool, device=arrays.place)

    def _seed(self, seeds: Seeds, mask: NDArray[np.bool_]) -> None:
        """Seed those of the mask that are given a seed; one that never had any draws it."""
        fresh = np.flatnonzero(mask & ~self._seeded & np.array([s is None for s in seeds]))
        drawn = self.np_random.integers(2**31, size=len(fresh)) if len(fresh) else ()
        chosen = {int(i): int(s) for i, s in zip(fresh, drawn, strict=True)}
        chosen |= {i: s for i, s in enumerate(seeds) if s is not None and mask[i]}
        if chosen:
            numbers = stream_numbers(list(chosen.values()))
            self.batch.simulator.seed(numbers, list(chosen))
            self._seeded[list(chosen)] = True

    def _to_begin(self) -> Any:
        """Return where the next step begins an episode, if anywhere."""
        if self._ended is None:
            raise ResetNeeded("call reset before step")
        if self._mode is AutoresetMode.SAME_STEP or not self._ended.any():
            return None
        if self._mode is AutoresetMode.DISABLED:
            over = self.batch.arrays.to_numpy(self._ended)
            raise ResetNeeded(
                f"the episodes of environments {np.flatnonzero(over).tolist()} are over: "
                "reset(options={'reset_mask': terminated | truncated}) before the next step"
            )
        return self._ended

    def _facts(self, result: BatchStep) -> BatchInfo:
        """Return what ``NavEnv`` tells of a step, of every environment."""
        state, episodes = self.batch.simulator.state, result.episodes
        success, collision = self._none(), self._none()
        if episodes is not None:
            success[episodes.indices] = episodes.success
            collision[episodes.indices] = episodes.collision
        return {
            "goal_distance": state.goal_polar[:, 0],
            "clearance": state.clearance,
            "rewards": result.rewards,
            "is_success": success,
            "is_collision": collision,
        }

    def _told(self, facts: BatchInfo, mask: Any) -> BatchInfo:
        """Return facts as ``infos`` have them: zero where the mask beside them is not set."""
        xp, told = self.batch.arrays.xp, {}
        for name, value in facts.items():
            if isinstance(value, dict):
                told[name] = self._told(value, mask)
            else:
                told[name] = xp.where(mask, value, False if value.dtype == xp.bool else 0.0)
            told[f"_{name}"] = mask
        return told
