# SPDX-License-Identifier: Apache-2.0
"""The same simulator with its state on a GPU, where one launch steps the whole batch."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pm01_nav.arrays import Arrays
from pm01_nav.cuda import THREADS, BoundKernel
from pm01_nav.errors import InputError
from pm01_nav.robot import RobotSpec
from pm01_nav.sim import cuda_kernels
from pm01_nav.sim.kernels import ABSENT
from pm01_nav.sim.lidar import FEW_BEAMS
from pm01_nav.sim.pedestrians import Tables, new_tables
from pm01_nav.sim.perturbation import Perturbation
from pm01_nav.sim.random import stream_keys
from pm01_nav.sim.simulator import Simulator
from pm01_nav.worlds.pool import WorldPool

UNSIGNED = ("rng_key", "rng_count", "dark_key")
"""Arrays of unsigned numbers, for which array libraries on devices have few functions."""
BEAMS_A_THREAD, MANY_BEAMS_A_THREAD = 8, 72
"""Beams that a thread casts of a lidar with few, and with many, of which it tests only some."""
MAX_WALKING_THREADS = 1 << 14
"""Threads that move pedestrians; each needs tables of its own, and several robots share one."""
Group = TypeVar("Group", bound=tuple[Any, ...])


class CudaSimulator(Simulator):
    """``PlanarSimulator`` on a GPU: the same functions, compiled for it.

    ``state`` and all other arrays are those of ``arrays``; ``step``, ``reset`` and the rest take
    and return such arrays, and nothing is copied to the CPU. Numbers agree with the CPU's to
    rounding, since a GPU fuses multiplications and additions.
    """

    def __init__(
        self, robot: RobotSpec, pool: WorldPool, num_envs: int, *, arrays: Arrays, **options: Any
    ) -> None:
        """Allocate the batch on the device; ``options`` are those of ``Simulator``.

        Raises:
            InputError: it does not fit into the device's memory.
        """
        super().__init__(robot, pool, num_envs, **options)
        self._on = arrays
        self._check_memory()
        self.state = self._moved(self.state)
        self._scratch = self._moved(self._scratch)
        base, lidar, worlds = self._scene
        self._scene = (self._moved(base), self._moved(lidar), self._moved(worlds))
        self._goal_distance = arrays.from_numpy(self._goal_distance)
        self._allocate()

    def _check_memory(self) -> None:
        """Look whether the arrays, which are still on the CPU, fit on the device.

        Raises:
            InputError: they do not; it says how many environments do.
        """
        shared = sum(size_of(group) for group in self._scene)
        own = size_of(self.state) + size_of(self._scratch)
        free = self._on.free_bytes()
        if shared + own > free:
            fit = max(int(self.num_envs * (free - shared) / own), 0)
            raise InputError(
                f"num_envs = {self.num_envs}: needs {(shared + own) / 1e9:.1f} GB on the GPU, of "
                f"which {free / 1e9:.1f} GB are free; at most {fit} environments fit"
            )

    def _allocate(self) -> None:
        """Make room for what a launch reads: commands and the numbers of environments."""
        xp, place = self._on.xp, self._on.place
        self._command = xp.zeros((self.num_envs, self.drive.size), dtype=xp.float64, device=place)
        self._everyone = xp.arange(self.num_envs, dtype=xp.int64, device=place)
        self._chosen = xp.zeros(self.num_envs + THREADS, dtype=xp.int64, device=place)
        self._came_from = xp.zeros((self.num_envs, 3), dtype=xp.float64, device=place)
        self._true_ranges: Any = None
        self._readings: Any = None
        self._launches: dict[str, Callable[[int], None]] = {}

    def _moved(self, group: Group) -> Group:
        """Return a named tuple whose arrays are on the device."""
        moved = (self._on.from_numpy(v) if isinstance(v, np.ndarray) else v for v in group)
        return type(group)(*moved)

    def _for_kernel(self, value: Any, name: str = "") -> Any:
        """Return a number, an array or a named tuple of them as kernels take it."""
        if isinstance(value, bool | int | float) or value is ABSENT:
            return value
        fields: tuple[str, ...] | None = getattr(value, "_fields", None)
        if fields is not None:
            named = zip(value, fields, strict=True)
            return type(value)(*(self._for_kernel(part, field) for part, field in named))
        array = self._on.for_kernel(value)
        return array.view(np.uint64) if name in UNSIGNED else array

    def _launch(self, name: str, threads: int, *arguments: Any, use: str = "") -> None:
        """Launch a kernel of ``cuda_kernels``; its arguments count at the first launch only.

        One that is launched with different arguments tells them apart by their ``use``.
        """
        launch = self._launches.get(name + use)
        if launch is None:
            function = getattr(cuda_kernels, name)
            given = tuple(self._for_kernel(argument) for argument in arguments)
            launch = self._launches[name + use] = BoundKernel(function, given, self._on.stream)
        launch(threads)

    def perturb(self, ranges: Perturbation) -> None:
        """Let each episode draw what is wrong with its robot; see ``Simulator``."""
        super().perturb(ranges)
        assert self.errors is not None
        assert self.drawn is not None
        self.errors, self.drawn = self._moved(self.errors), self._moved(self.drawn)
        self._ranges = self._moved(ranges)
        self._launches = {}

    def limit_goal_distance(self, limits: tuple[float, float]) -> None:
        """Set the least and the greatest distance from a start to its goal [m] from now on."""
        self._goal_distance[...] = self._on.from_numpy(np.array(limits, dtype=np.float64))

    def draw_worlds(self, weights: NDArray[np.float64]) -> None:
        """Draw worlds in proportion to ``weights`` (num_worlds,) from the next reset on."""
        super().draw_worlds(weights)
        cumulative = self._on.from_numpy(self.pool.arrays.cumulative_weight)
        self._scene[2].cumulative_weight[...] = cumulative

    def seed(self, seeds: ArrayLike, indices: Any = slice(None)) -> None:
        """Begin random streams anew; see ``Simulator``."""
        self.state.rng_key[indices] = self._on.from_numpy(stream_keys(np.asarray(seeds)))
        self.state.rng_count[indices] = 0

    def step(self, command: Any) -> None:
        """Apply velocity commands (num_envs, axes) [m/s, rad/s]; see ``Simulator``."""
        needed = (self.num_envs, self.drive.size)
        if tuple(np.shape(command)) != needed:
            raise ValueError(f"command: shape {np.shape(command)}, needs {needed}")
        self._command[...] = command
        base, _, worlds = self._scene
        own = (*self._own(), self._command, self._came_from)
        self._move(*own, base, worlds, self._time, self._crowd)
        if self.errors is None:
            self._observe(self._everyone, self.num_envs, "all")
        else:
            self._observe_wrongly(self._everyone, self.num_envs, first=False)

    def _own(self) -> tuple[Any, Any, Any]:
        """Return the state, and errors if there are any, as kernels begin with them."""
        return self.state, self.errors or ABSENT, self.drawn or ABSENT

    def _move(self, *arguments: Any) -> None:
        """Launch the kernel that moves robots and movers."""
        threads, tables = self.num_envs, ABSENT
        if self._has_movers:
            threads = min(-(-threads // THREADS) * THREADS, MAX_WALKING_THREADS)
            tables = ABSENT if "move_all" in self._launches else self._tables(threads)
        self._launch("move_all", threads, *arguments, tables)

    def _tables(self, threads: int) -> Tables:
        """Return room to work out the velocities of pedestrians, a row for each thread."""
        one = new_tables(self.state.mover_position.shape[1])
        rows: Any = [np.zeros((threads, *t.shape), t.dtype) for t in one]
        return self._moved(Tables(*rows))

    def _observe(self, indices: Any, count: int, use: str) -> None:
        """Measure and read the scans of the first ``count`` of ``indices``."""
        self._look(indices, count, self.state.ranges, use)
        rest = (self._scene[1], self._trail)
        self._launch("read_some", count, self.state, indices, *rest, use=use)

    def _observe_wrongly(self, indices: Any, count: int, *, first: bool) -> None:
        """Measure what sensors with errors say; the ``first`` scans begin their episodes."""
        own = (self.state, self.errors, self.drawn, indices, self._came_from)
        rest = (*self._scene, self._trail, first)
        self._launch("observe_some_wrongly", count, *own, *rest, use="first" if first else "")

    def _look(self, indices: Any, count: int, ranges: Any, use: str) -> None:
        """Write exact ranges, several threads an environment."""
        _, lidar, worlds = self._scene
        width = BEAMS_A_THREAD if lidar.num_beams <= FEW_BEAMS else MANY_BEAMS_A_THREAD
        threads = count * -(-ranges.shape[1] // width)
        self._launch(
            "look_some", threads, self.state, indices, lidar, worlds, ranges, width, use=use
        )

    def reset(self, indices: Any = None, worlds: Any = None) -> None:
        """Start new episodes in some environments (all by default); see ``Simulator``."""
        chosen = self._everyone if indices is None else indices
        count = self._choose(chosen)
        if worlds is not None:
            self.state.world[chosen] = self._on.xp.asarray(worlds)
        elif chosen.dtype == self._on.xp.bool:
            self.state.world[...] = self._on.xp.where(chosen, -1, self.state.world)
        else:
            self.state.world[chosen] = -1
        base, _, worlds_ = self._scene
        own = (*self._own(), self._ranges or ABSENT, self._chosen, self._came_from)
        end = (self._goal_distance, self._scratch, self._crowd)
        self._launch("reset_some", count, *own, base, worlds_, *end)
        self._begin(count)

    def _choose(self, indices: Any) -> int:
        """Note the environments of the next launch, of which it returns how many there may be.

        Spare threads have none, nor have those that a mask leaves out: so a reset by a mask does
        the same work whatever is in it, and a CUDA graph can hold it.
        """
        xp = self._on.xp
        count = len(indices)
        if indices.dtype == xp.bool:
            indices = xp.where(indices, self._everyone, -1)
        self._chosen[:count] = indices
        self._chosen[count : count + THREADS] = -1
        return count

    def place(self, indices: Any, poses: Any, goals: Any) -> None:
        """Put robots at rest at ``poses`` (n, 3) with ``goals`` (n, 2) in their present worlds."""
        self._stand(indices, self._on.xp.asarray(poses), self._on.xp.asarray(goals))
        count = self._choose(indices)
        base, _, worlds = self._scene
        own = (*self._own(), self._chosen, self._came_from)
        self._launch("begin_some", count, *own, base, worlds, self._scratch)
        self._begin(count)

    def _begin(self, count: int) -> None:
        """Look around for the first time in the episodes of the first ``count`` of the chosen."""
        if self.errors is None:
            self._observe(self._chosen, count, "some")
        else:
            self._observe_wrongly(self._chosen, count, first=True)

    def true_scan(self) -> Any:
        """Return the scan of a lidar without errors; see ``Simulator``."""
        if self.errors is None:
            return self.scan
        if self._true_ranges is None:
            self._true_ranges = self._on.xp.empty_like(self.state.ranges)
        self._look(self._everyone, self.num_envs, self._true_ranges, "true")
        return self._read(self._true_ranges)

    def _read(self, ranges: Any) -> Any:
        lidar, on = self.robot.lidar, self._on
        if self._readings is None:
            shape = (self.num_envs, lidar.num_beams)
            self._readings = on.xp.empty(shape, dtype=on.xp.float32, device=on.place)
        limits = (lidar.range_min, lidar.range_max)
        use = "true" if ranges is self._true_ranges else "measured"
        count = self.num_envs * lidar.num_beams
        self._launch("read_scans", count, ranges, self._readings, *limits, use=use)
        return on.xp.asarray(self._readings, copy=True)

    def keep(self, indices: Any) -> None:
        """Go on with some of the environments only, as if there had never been others."""
        super().keep(indices)
        self._allocate()

    def movers(self, i: int) -> NDArray[np.float64]:
        """Return x, y and radius of the movers of environment i, shape (n, 3) [m], on the CPU."""
        count, to_numpy = int(self.state.mover_count[i]), self._on.to_numpy
        position = to_numpy(self.state.mover_position[i, :count])
        return np.concatenate(
            [position, to_numpy(self.state.mover_radius[i, :count])[:, None]], axis=1
        )


def size_of(group: tuple[Any, ...]) -> int:
    """Return how much memory the arrays of a named tuple take [bytes]."""
    return sum(value.nbytes for value in group if isinstance(value, np.ndarray))
