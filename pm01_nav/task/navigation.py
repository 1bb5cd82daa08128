# SPDX-License-Identifier: Apache-2.0
"""The navigation task on a batch of simulated robots: act, move, judge, reset, observe."""

from __future__ import annotations

from functools import cached_property, reduce
from operator import add
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pm01_nav.arrays import NUMPY, Arrays
from pm01_nav.backends import make_simulator
from pm01_nav.durations import whole_steps
from pm01_nav.errors import InputError
from pm01_nav.sim.settings import SWITCHES, Features, TrailParams
from pm01_nav.sim.simulator import Simulator
from pm01_nav.task.config import TaskConfig, observation_layout
from pm01_nav.task.observation import ObservationLayout, Observer
from pm01_nav.task.outcomes import BatchStep, Episodes, MaskedStep
from pm01_nav.task.parts.base import ALL, Elapsed, Seen
from pm01_nav.task.people import nearest_mover
from pm01_nav.task.privileged import Privileged
from pm01_nav.task.rewards import RewardTable, needed
from pm01_nav.task.step import Step
from pm01_nav.task.terminations import judge, out_of_time
from pm01_nav.worlds.pool import WorldPool


def features(config: TaskConfig, layout: ObservationLayout) -> Features:
    """Return what observations and rewards need from the simulator.

    Raises:
        InputError: two parts need the same in different ways.
    """
    needs: dict[str, Any] = dict.fromkeys(needed(config.rewards) & SWITCHES, True)
    for part in layout.parts:
        for name, value in part.needs.items():
            if needs.setdefault(name, value) != value:
                raise InputError(f"observation.parts.{part.name}: another part needs other {name}")
    if "trail" in needs:
        trail = dict(needs["trail"])
        interval = whole_steps(trail.pop("interval_s"), config.control_dt)
        needs["trail"] = TrailParams(**trail, interval_steps=interval)
    return Features(**needs)


class SeenInSimulation(Seen):
    """What a simulator's robots measure; scans are read only where a part wants every beam."""

    def __init__(self, simulator: Simulator, action: Any, robots: Any) -> None:
        """Look at these of the robots, whose last actions are in ``action`` (num_envs, axes)."""
        self._simulator = simulator
        self.robots = robots
        self.goal = simulator.measured_goal[robots]
        self.velocity = simulator.measured_twist[robots]
        self.previous_action = action[robots]
        self.elapsed = Elapsed(simulator.control_dt)

    @cached_property
    def ranges(self) -> Any:  # type: ignore[override]
        """Scans as the lidar says them, shape (n, num_beams) [m]."""
        return self._simulator.scan[self.robots]

    def nearest(self, sectors: int) -> Any:
        """Return the nearest range of each sector, which the simulator knows for one number."""
        nearest = self._simulator.state.nearest
        if nearest.shape[1] == (sectors or self._simulator.robot.lidar.num_beams):
            return nearest[self.robots]
        return super().nearest(sectors)


def total(terms: Any) -> Any:
    """Return the sum of reward terms, (num_terms, n) -> (n,), added up in the order of the table.

    A library's sum would take another order for one robot than for many, and round otherwise.
    """
    return reduce(add, terms)


class NavigationBatch:
    """Many robots on the same task; a finished episode is followed by a new one at once."""

    def __init__(
        self,
        config: TaskConfig,
        pool: WorldPool,
        num_envs: int,
        *,
        autoreset: bool = True,
        arrays: Arrays = NUMPY,
        privileged: Privileged | None = None,
    ) -> None:
        """Prepare ``num_envs`` robots in the worlds of ``pool``; call ``reset`` before ``step``.

        Without ``autoreset`` the caller resets after an episode's end. ``arrays`` are those that
        the batch keeps, takes and returns; where they are on a GPU, so is the simulator.
        ``privileged`` numbers, for a critic, follow those of each observation (numpy only).
        """
        self.config = config
        self.autoreset = autoreset
        self.robot = config.robot_spec()
        self.layout = observation_layout(config, self.robot)
        self.num_envs = num_envs
        self.arrays = arrays
        self.privileged = privileged
        computed = features(config, self.layout)
        self._knows_ways = computed.path_distances
        self.simulator = make_simulator(
            config.backend,
            arrays,
            self.robot,
            pool,
            num_envs,
            config.gazebo,
            control_dt=config.control_dt,
            goal_distance=config.goal_distance_limits(),
            features=computed,
            pedestrians=config.pedestrians,
            pedestrians_avoid_robot=config.pedestrians_avoid_robot,
        )
        if config.randomization is not None:
            self.simulator.perturb(config.randomization.ranges(self.robot, config.control_dt))
        self._rewards = RewardTable(config.rewards, num_envs, arrays)
        simulator = self.simulator
        self.observer = Observer(self.layout, lambda part: part.simulated_memory(simulator, arrays))
        self._count = self._zeros((num_envs,), arrays.xp.int64)
        self._action = self._zeros((num_envs, self.layout.drive.size), arrays.xp.float64)
        self._term_sums = self._zeros((len(config.rewards), num_envs), arrays.xp.float64)

    def _zeros(self, shape: tuple[int, ...], dtype: Any) -> Any:
        return self.arrays.xp.zeros(shape, dtype=dtype, device=self.arrays.place)

    def reset(
        self, seeds: ArrayLike | None = None, worlds: NDArray[np.int64] | None = None
    ) -> NDArray[np.float32]:
        """Start a new episode everywhere; return observations (num_envs, size).

        ``seeds`` (num_envs,) begin the random streams anew, ``worlds`` (num_envs,) fix the worlds.
        """
        if seeds is not None:
            self.simulator.seed(seeds)
        self._begin(self.arrays.xp.arange(self.num_envs, device=self.arrays.place), worlds)
        return self.observe()

    def begin(self, indices: NDArray[np.int64]) -> NDArray[np.float32]:
        """Start new episodes in some environments (n,); return their observations (n, size)."""
        self._begin(indices, None)
        return self.observe(indices)

    def observe(self, indices: NDArray[np.int64] | slice = ALL) -> NDArray[np.float32]:
        """Return the present observations as environments give them, shape (n, size)."""
        seen = self._seen(indices)
        observation = self.observer.show(seen, normalized=self.layout.normalize)
        if self.privileged is None:
            return observation
        more = self.privileged.observe(self.simulator.state, indices)
        return self.arrays.xp.concat([observation, more], axis=-1)

    def _seen(self, indices: NDArray[np.int64] | slice = ALL) -> Seen:
        return SeenInSimulation(self.simulator, self._action, indices)

    def advance(self, command: NDArray[np.float64]) -> Step:
        """Apply commands (num_envs, axes) [m/s, rad/s] and judge the outcome; nothing is reset."""
        state = self.simulator.state
        xp, radius = self.arrays.xp, self.robot.footprint.circumscribed_radius
        before = xp.asarray(state.goal_polar[:, 0], copy=True)
        way, way_before = None, None
        if self._knows_ways:
            way = state.path_distance
            way_before = xp.asarray(way, copy=True)
        self.simulator.step(command)
        self._count += 1
        step = Step(
            xp=xp,
            pose=state.pose,
            twist=state.twist,
            command=command,
            read_scan=self.simulator.true_scan,
            read_mover_gap=lambda: nearest_mover(state, radius),
            clearance=state.clearance,
            contact=state.contact,
            goal_distance=state.goal_polar[:, 0],
            goal_bearing=state.goal_polar[:, 1],
            previous_goal_distance=before,
            path_distance=way,
            previous_path_distance=way_before,
            visited=state.visited if state.visited.shape[1] else None,
            count=self._count,
            faults=self.simulator.faults,
        )
        step.reached, step.collided = judge(step, self.config)
        return step

    def step(self, action: Any, begins: Any = None) -> BatchStep:
        """Apply actions (num_envs, axes), clipped to [-1, 1]; reset what ended.

        Where the mask ``begins`` (num_envs,) says so, a new episode begins instead: its action
        does not count, and nothing is paid.

        Raises:
            InputError: an action is not finite.
        """
        xp, drawn = self.arrays.xp, None
        if begins is not None:
            action = xp.where(begins[:, None], 0.0, action)
            drawn = xp.asarray(self.simulator.state.rng_count, copy=True)
        if not xp.all(xp.isfinite(action)):
            raise InputError("actions must be finite numbers")
        step, terms, terminated, truncated = self._play(action)
        if begins is not None:
            self._begin_instead(begins, drawn, terms)
            terminated, truncated = terminated & ~begins, truncated & ~begins
        (done,) = xp.nonzero(terminated | truncated)
        observation = self.observe()
        episodes = None
        if len(done):
            episodes = self._finish(step, done, observation)
            if self.autoreset:
                observation[done] = self.begin(done)
        reward = total(terms)
        return BatchStep(observation, reward, self._named(terms), terminated, truncated, episodes)

    def _begin_instead(self, begins: Any, drawn: Any, terms: Any) -> None:
        """Let robots of a mask begin anew as if they had not made this step.

        ``drawn`` says how many random numbers each had drawn before.
        """
        xp, state = self.arrays.xp, self.simulator.state
        state.rng_count[...] = xp.where(begins, drawn, state.rng_count)
        self._begin_where(begins)
        terms[:, begins] = 0.0

    def step_all(self, action: Any) -> MaskedStep:
        """Do the same as ``step``, in the same way whatever happens, so that a CUDA graph holds it.

        Nothing is waited for and actions are not checked: they must be finite.
        """
        xp = self.arrays.xp
        step, terms, terminated, truncated = self._play(action)
        done = terminated | truncated
        sums = xp.asarray(self._term_sums, copy=True)
        episode = (
            xp.asarray(self.simulator.state.world, copy=True),
            xp.asarray(self._count, copy=True),
            total(sums),
            sums,
        )
        self._begin_where(done)
        reward = total(terms)
        return MaskedStep(self.observe(), reward, terminated, truncated, step.reached, *episode)

    def _play(self, action: Any) -> tuple[Step, Any, Any, Any]:
        """Apply actions; return the step, its rewards by term, and what terminated or timed out."""
        xp = self.arrays.xp
        action = xp.minimum(xp.maximum(action, -1.0), 1.0)
        step = self.advance(self.layout.drive.to_command(action))
        step.action, step.previous_action = action, self._action
        terms = self.reward_terms(step)
        self._term_sums += terms
        self._action[...] = action
        self.observer.push(self._seen())
        terminated = step.reached | step.collided
        truncated = out_of_time(step, self.config) & ~terminated
        if step.faults:
            truncated[list(step.faults)] = True
        return step, terms, terminated, truncated

    def reward_terms(self, step: Step) -> NDArray[np.float64]:
        """Return each term's weighted share of the reward, shape (num_terms, num_envs).

        ``step.action`` and ``step.previous_action`` must be known.
        """
        terms = self.arrays.xp.empty_like(self._term_sums)
        self._rewards.pay(step, terms)
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
            returns=total(self._term_sums[:, done]),
            terms=self._named(self._term_sums[:, done]),
            final_observation=observation[done],
            faults=step.faults,
        )

    def _begin(self, indices: NDArray[np.int64], worlds: NDArray[np.int64] | None) -> None:
        self.simulator.reset(indices, worlds)
        self._count[indices] = 0
        self._action[indices] = 0.0
        self._term_sums[:, indices] = 0.0
        self._rewards.reset(indices)
        self.observer.begin(self._seen(indices))

    def _begin_where(self, begins: Any) -> None:
        """Start new episodes where a mask of all environments says so."""
        self.simulator.reset(begins)
        self._count *= ~begins
        self._action *= ~begins[:, None]
        self._term_sums *= ~begins
        self._rewards.reset(begins)
        self.observer.begin_where(begins, self._seen())

    def keep(self, robots: NDArray[np.int64]) -> None:
        """Go on with these of the robots only; each goes on where it is."""
        self.num_envs = len(robots)
        self.simulator.keep(robots)
        self.observer.keep(robots)
        self._rewards.keep(robots)
        self._count, self._action = self._count[robots], self._action[robots]
        self._term_sums = self.arrays.xp.take(self._term_sums, robots, axis=1)

    def state_dict(self) -> dict[str, NDArray[Any]]:
        """Return copies of every array that makes up the batch's state."""
        return {name: np.array(self.arrays.to_numpy(a)) for name, a in self._arrays().items()}

    def load_state_dict(self, arrays: dict[str, NDArray[Any]]) -> None:
        """Go on from a state returned by ``state_dict``.

        Raises:
            ValueError: it belongs to a batch of another size or task.
        """
        mine = self._arrays()
        if set(arrays) != set(mine):
            raise ValueError(f"state has {sorted(arrays)}, this batch needs {sorted(mine)}")
        for name, array in mine.items():
            shape = tuple(array.shape)
            if arrays[name].shape != shape:
                raise ValueError(f"state.{name}: {arrays[name].shape}, needs {shape}")
            kept_here = isinstance(array, np.ndarray)
            given = arrays[name] if kept_here else self.arrays.from_numpy(arrays[name])
            array[...] = given.view(array.dtype)
        self.simulator.resume()

    def _arrays(self) -> dict[str, NDArray[Any]]:
        own = {"count": self._count, "action": self._action, "term_sums": self._term_sums}
        return self.simulator.arrays() | own | self._rewards.arrays() | self.observer.arrays()
