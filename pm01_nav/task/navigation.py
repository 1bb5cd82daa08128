# SPDX-License-Identifier: Apache-2.0
"""The navigation task on a batch of simulated robots: act, move, judge, reset, observe."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pm01_nav.backends import make_simulator
from pm01_nav.errors import InputError
from pm01_nav.sim.state import Features, TrailParams
from pm01_nav.task.config import TaskConfig, observation_layout
from pm01_nav.task.frames import FrameStack
from pm01_nav.task.observation import ObservationLayout, build_observation, show_ranges
from pm01_nav.task.rewards import REWARDS
from pm01_nav.task.step import Step
from pm01_nav.task.terminations import judge, out_of_time
from pm01_nav.worlds.pool import WorldPool

ALL = slice(None)


@dataclass(frozen=True)
class Episodes:
    """Episodes that ended in one step; one row each."""

    indices: NDArray[np.int64]
    """Which environments, shape (n,)."""
    world: NDArray[np.int64]
    """The world of each in the pool, shape (n,)."""
    success: NDArray[np.bool_]
    collision: NDArray[np.bool_]
    steps: NDArray[np.int64]
    returns: NDArray[np.float64]
    """Sum of rewards, shape (n,)."""
    terms: dict[str, NDArray[np.float64]]
    """Each reward term's weighted sum, shape (n,)."""
    final_observation: NDArray[np.float32]
    """The last observation before the reset, shape (n, observation size)."""
    faults: dict[int, str] = field(default_factory=dict)
    """Why the simulator gave environments up, if it did."""


@dataclass(frozen=True)
class BatchStep:
    """The outcome of one step of every environment, after the finished ones were reset."""

    observation: NDArray[np.float32]
    reward: NDArray[np.float64]
    rewards: dict[str, NDArray[np.float64]]
    """Each term's weighted share of ``reward``, shape (num_envs,)."""
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    episodes: Episodes | None
    """Those that ended, if any."""


def _features(config: TaskConfig, layout: ObservationLayout) -> Features:
    """Return what observations and rewards need from the simulator."""
    return Features(
        sectors=layout.sectors,
        trail=TrailParams(**asdict(layout.trail)) if layout.trail else TrailParams(),
        path_distances="path_progress" in config.rewards,
    )


class NavigationBatch:
    """Many robots on the same task; a finished episode is followed by a new one at once."""

    def __init__(
        self, config: TaskConfig, pool: WorldPool, num_envs: int, *, autoreset: bool = True
    ) -> None:
        """Prepare ``num_envs`` robots in the worlds of ``pool``; call ``reset`` before ``step``.

        Without ``autoreset`` the caller resets after an episode's end.
        """
        self.config = config
        self.autoreset = autoreset
        self.robot = config.robot_spec()
        self.layout = observation_layout(config, self.robot)
        self.num_envs = num_envs
        self.simulator = make_simulator(
            config.backend,
            self.robot,
            pool,
            num_envs,
            control_dt=config.control_dt,
            goal_distance=config.goal_distance_limits(),
            features=_features(config, self.layout),
            pedestrians=config.pedestrians,
            pedestrians_avoid_robot=config.pedestrians_avoid_robot,
        )
        if config.randomization is not None:
            self.simulator.perturb(config.randomization.ranges(self.robot))
        # Attributes of pydantic models are slow to read.
        self._rewards = [(REWARDS[n], t.weight, t.params) for n, t in config.rewards.items()]
        frames, sectors = self.layout.frames, self.simulator.state.nearest.shape[1]
        self._frames = FrameStack(frames, num_envs, sectors) if frames else None
        self._count = np.zeros(num_envs, dtype=np.int64)
        self._action = np.zeros((num_envs, 2))
        self._term_sums = np.zeros((len(config.rewards), num_envs))

    def reset(
        self, seeds: ArrayLike | None = None, worlds: NDArray[np.int64] | None = None
    ) -> NDArray[np.float32]:
        """Start a new episode everywhere; return observations (num_envs, size).

        ``seeds`` (num_envs,) begin the random streams anew, ``worlds`` (num_envs,) fix the worlds.
        """
        if seeds is not None:
            self.simulator.seed(seeds)
        self._begin(np.arange(self.num_envs), worlds)
        return self.observe()

    def observe(self, indices: NDArray[np.int64] | slice = ALL) -> NDArray[np.float32]:
        """Return the present observations as environments give them, shape (n, size)."""
        sim = self.simulator
        return build_observation(
            self.layout,
            self._frames.show(indices) if self._frames else [self._scan(indices)],
            sim.measured_goal[indices],
            sim.measured_twist[indices],
            self._action[indices],
            sim.state.visited[indices],
            normalized=self.layout.normalize,
        )

    def _scan(self, indices: NDArray[np.int64] | slice = ALL) -> NDArray[np.float32]:
        """Return the present scans as observations show them, shape (n, sectors)."""
        nearest = self.simulator.state.nearest[indices]
        return show_ranges(self.layout, nearest, normalized=self.layout.normalize)

    def advance(self, command: NDArray[np.float64]) -> Step:
        """Apply commands (num_envs, 2) [m/s, rad/s] and judge the outcome; nothing is reset."""
        state = self.simulator.state
        before, path_before = state.goal_polar[:, 0].copy(), state.path_distance.copy()
        self.simulator.step(command)
        if self._frames:
            self._frames.push(self._scan())
        self._count += 1
        step = Step(
            xp=np,
            pose=state.pose,
            twist=state.twist,
            command=command,
            read_scan=self.simulator.true_scan,
            clearance=state.clearance,
            contact=state.contact,
            goal_distance=state.goal_polar[:, 0],
            goal_bearing=state.goal_polar[:, 1],
            previous_goal_distance=before,
            path_distance=state.path_distance,
            previous_path_distance=path_before,
            visited=state.visited,
            count=self._count,
            faults=self.simulator.faults,
        )
        step.reached, step.collided = judge(step, self.config)
        return step

    def step(self, action: NDArray[Any]) -> BatchStep:
        """Apply actions (num_envs, 2), clipped to [-1, 1]; reset what ended.

        Raises:
            InputError: an action is not finite.
        """
        if not np.isfinite(action).all():
            raise InputError("actions must be finite numbers")
        action = np.minimum(np.maximum(action, -1.0), 1.0)
        step = self.advance(self.layout.limits.to_command(action))
        step.action, step.previous_action = action, self._action
        terms = self.reward_terms(step)
        self._term_sums += terms
        self._action = action
        terminated = step.reached | step.collided
        truncated = out_of_time(step, self.config) & ~terminated
        truncated[list(step.faults)] = True
        done = np.flatnonzero(terminated | truncated)
        observation = self.observe()
        episodes = None
        if len(done):
            episodes = self._finish(step, done, observation)
            if self.autoreset:
                self._begin(done, None)
                observation[done] = self.observe(done)
        return BatchStep(
            observation, terms.sum(axis=0), self._named(terms), terminated, truncated, episodes
        )

    def reward_terms(self, step: Step) -> NDArray[np.float64]:
        """Return each term's weighted share of the reward, shape (num_terms, num_envs).

        ``step.action`` and ``step.previous_action`` must be known.
        """
        terms = np.empty_like(self._term_sums)
        for row, (function, weight, params) in zip(terms, self._rewards, strict=True):
            np.multiply(weight, function(step, **params), out=row)
        return terms

    def _named(self, terms: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
        return dict(zip(self.config.rewards, terms, strict=True))

    def _finish(
        self, step: Step, done: NDArray[np.int64], observation: NDArray[np.float32]
    ) -> Episodes:
        return Episodes(
            indices=done,
            world=self.simulator.state.world[done],
            success=step.reached[done],
            collision=step.collided[done],
            steps=self._count[done],
            returns=self._term_sums[:, done].sum(axis=0),
            terms=self._named(self._term_sums[:, done]),
            final_observation=observation[done],
            faults=step.faults,
        )

    def _begin(self, indices: NDArray[np.int64], worlds: NDArray[np.int64] | None) -> None:
        self.simulator.reset(indices, worlds)
        if self._frames:
            self._frames.begin(indices, self._scan(indices))
        self._count[indices] = 0
        self._action[indices] = 0.0
        self._term_sums[:, indices] = 0.0

    def keep(self, robots: NDArray[np.int64]) -> None:
        """Go on with these of the robots only; each goes on where it is."""
        self.num_envs = len(robots)
        self.simulator.keep(robots)
        if self._frames:
            self._frames.keep(robots)
        self._count, self._action = self._count[robots], self._action[robots]
        self._term_sums = np.ascontiguousarray(self._term_sums[:, robots])

    def state_dict(self) -> dict[str, NDArray[Any]]:
        """Return copies of every array that makes up the batch's state."""
        return {name: array.copy() for name, array in self._arrays().items()}

    def load_state_dict(self, arrays: dict[str, NDArray[Any]]) -> None:
        """Go on from a state returned by ``state_dict``.

        Raises:
            ValueError: it belongs to a batch of another size or task.
        """
        mine = self._arrays()
        if set(arrays) != set(mine):
            raise ValueError(f"state has {sorted(arrays)}, this batch needs {sorted(mine)}")
        for name, array in mine.items():
            if arrays[name].shape != array.shape:
                raise ValueError(f"state.{name}: {arrays[name].shape}, needs {array.shape}")
            array[...] = arrays[name].view(array.dtype)
        self.simulator.resume()

    def _arrays(self) -> dict[str, NDArray[Any]]:
        own = {"count": self._count, "action": self._action, "term_sums": self._term_sums}
        frames = self._frames.arrays() if self._frames else {}
        return self.simulator.arrays() | own | frames
