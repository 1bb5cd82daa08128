# SPDX-License-Identifier: Apache-2.0
"""One robot as a ``gym.Env``: a batch of one."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.error import ResetNeeded
from numpy.typing import ArrayLike, NDArray

from pm01_nav.envs.contract import checked_actions, stream_numbers
from pm01_nav.envs.render import RENDER_MODES, BatchRenderer
from pm01_nav.envs.spaces import action_space, described, observation_space, resolve_task
from pm01_nav.task.config import TaskConfig
from pm01_nav.task.navigation import NavigationBatch
from pm01_nav.task.worlds import world_pool

FEW_WORLDS = 32
"""Worlds of one environment of a task by name: they are made at once, hundreds take a while."""


class NavEnv(gym.Env[Any, NDArray[Any]]):
    r"""Drive a wheeled robot with a 2D lidar to a goal among obstacles it has never seen.

    ## Action space
    ``Box(-1, 1, (2,))``: v from the robot's least to its greatest linear speed, and w from its
    fastest turn right to its fastest turn left; one action a control step of 0.1 s.

    ## Observation space
    ``PM01Nav-v0``, the article's 24 numbers in physical units:

    | index | quantity | min | max | unit |
    |---|---|---|---|---|
    | 0-19 | range of the beam at -180 + 18 k degrees | 0 | 3.5 | m |
    | 20 | distance of the goal | 0 | 10 | m |
    | 21 | bearing of the goal in base_link | -pi | pi | rad |
    | 22 | linear velocity | -0.2 | 0.5 | m/s |
    | 23 | angular velocity | -1.5 | 1.5 | rad/s |

    ``PM01Nav-v1``, each part divided by its greatest magnitude:

    | index | quantity | min | max | unit before division |
    |---|---|---|---|---|
    | 0-35 | nearness (d - r) / (d + r), d = 0.3 m, of the nearest return r in each sector of 10 \
degrees, the first one behind | -1 | 1 | 1 |
    | 36 | distance of the goal | 0 | 10 | m |
    | 37-38 | sine and cosine of the goal's bearing | -1 | 1 | 1 |
    | 39 | linear velocity | -0.2 | 0.5 | m/s |
    | 40 | angular velocity | -1.5 | 1.5 | rad/s |
    | 41-42 | the last action | -1 | 1 | 1 |

    With ``observation={"space": "dict"}`` it is a ``Dict`` instead, a ``Box`` for each part.

    ## Rewards
    A table of named, weighted terms (``TaskConfig.rewards``): +100 at the goal, -50 for a
    collision, 10 per metre of progress, -0.05 a step, -0.01 |w|, -0.005 |v|. v1 takes 100 for a
    collision, and up to 0.5 a step for driving within 0.15 m of an obstacle. ``info["rewards"]``
    holds each term of the step; ``goal_distance``, ``clearance`` [m], ``is_success`` and
    ``is_collision`` stand beside it.

    ## Starting state
    At rest. v0: pose (0, 0, 0), goal in x [3, 7], y [-2, 2] m. v1: start, heading and goal are
    drawn from the free space of a random world, the goal at least 2 m away and reachable.

    ## Episode end
    Terminated: (1) within 0.3 m of the goal; (2) in a collision: v0 by a return nearer than
    0.2 m, v1 by a touch of the footprint. Truncated: after 50 s.

    ## Arguments
    ``task``: a task's name or a ``TaskConfig``; further keywords change keys of it, for example
    ``gym.make("pm01_nav.envs:PM01Nav-v1", task="empty", time_limit_s=20)``. ``gym.make``'s
    own ``max_episode_steps`` never gets here: it wraps the environment in a ``TimeLimit``, which
    can only shorten episodes. One environment of a task by name has 32 worlds at most, so that it
    is there at once; to learn in more, say ``num_worlds=1024``, as ``gym.make_vec`` has them.

    ## Version history
    v1: dense beams pooled by sector minimum. v0: the article's task to the letter.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 (the base class declares it so)
        "render_modes": list(RENDER_MODES),
        "render_fps": 10,
    }

    def __init__(
        self,
        task: str | TaskConfig = "static",
        render_mode: str | None = None,
        **changes: Any,
    ) -> None:
        """Make one environment of a task; ``changes`` are keys of ``TaskConfig``.

        Raises:
            InputError: the task or a changed key is unknown, or a value is not allowed.
        """
        config = resolve_task(task, changes)
        if isinstance(task, str) and "num_worlds" not in changes:
            config = config.model_copy(update={"num_worlds": min(config.num_worlds, FEW_WORLDS)})
        pool = world_pool(config, "train", config.num_worlds)
        self.batch = NavigationBatch(config, pool, 1, autoreset=False)
        self.metadata = described(self.metadata, config)
        self.observation_space = observation_space(self.batch.layout)
        self.action_space = action_space(self.batch.layout)
        self.render_mode = render_mode
        self._renderer = BatchRenderer(self.batch, render_mode) if render_mode else None
        self._begun = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start a new episode; with a seed, begin its sequence of episodes anew."""
        super().reset(seed=seed)
        if seed is None and not self._begun:
            seed = int(self.np_random.integers(2**31))
        self._begun = True
        observation = self.batch.reset(None if seed is None else stream_numbers([seed]))
        if self._renderer:
            self._renderer.update(begin=True)
        return self.batch.layout.as_space(observation[0]), {}

    def step(self, action: ArrayLike) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Apply one action (2,) in [-1, 1].

        Raises:
            ResetNeeded: there was no ``reset`` yet.
            InputError: the action has another shape or is not finite.
        """
        if not self._begun:
            raise ResetNeeded("call reset before step")
        result = self.batch.step(checked_actions(action, (self.batch.layout.drive.size,))[None])
        if self._renderer:
            self._renderer.update()
        state, episodes = self.batch.simulator.state, result.episodes
        info: dict[str, Any] = {
            "goal_distance": float(state.goal_polar[0, 0]),
            "clearance": float(state.clearance[0]),
            "rewards": {name: float(value[0]) for name, value in result.rewards.items()},
            "is_success": bool(episodes and episodes.success[0]),
            "is_collision": bool(episodes and episodes.collision[0]),
        }
        return (
            self.batch.layout.as_space(result.observation[0]),
            float(result.reward[0]),
            bool(result.terminated[0]),
            bool(result.truncated[0]),
            info,
        )

    def render(self) -> NDArray[np.uint8] | None:
        """Return a picture (height, width, 3); in mode ``human`` the window shows it already."""
        if self._renderer is None or self.render_mode == "human":
            return None
        return self._renderer.frame()

    def close(self) -> None:
        """Close the window."""
        if self._renderer:
            self._renderer.close()
