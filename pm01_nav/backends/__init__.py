# SPDX-License-Identifier: Apache-2.0
"""Where robots drive: the planar simulator, or a physics engine around the same task."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from ctypes.util import find_library
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from pydantic import AfterValidator

from pm01_nav.arrays import Arrays
from pm01_nav.backends.gazebo.config import GazeboConfig, require_gazebo
from pm01_nav.errors import InputError
from pm01_nav.robot import RobotSpec

if TYPE_CHECKING:
    from pm01_nav.sim.simulator import Simulator
    from pm01_nav.worlds.pool import WorldPool

WHEEL_PAIR = ("differential",)
"""Engines turn two wheels, and casters follow (``body.py``)."""
DEFAULT_GAZEBO = GazeboConfig()
Build = Callable[..., Any]


class Backend(NamedTuple):
    """What makes a simulator."""

    build: Build
    """From what a task says of Gazebo, the robot, the pool, ``num_envs`` and ``how``."""
    most_robots: int | None
    """How many robots are worth driving at once, where each is a process; None is no limit."""
    drives: tuple[str, ...] | None
    """The drives that it can move; None is all."""


BACKENDS: dict[str, Backend] = {}


def backend(
    name: str, most_robots: int | None = None, drives: tuple[str, ...] | None = None
) -> Callable[[Build], Build]:
    """Enter a function in the table of backends; it imports its engine when it is called."""

    def enter(build: Build) -> Build:
        BACKENDS[name] = Backend(build, most_robots, drives)
        return build

    return enter


def _known(name: str) -> str:
    if name not in BACKENDS:
        raise ValueError(f"unknown; allowed: {', '.join(BACKENDS)}")
    return name


BackendName = Annotated[str, AfterValidator(_known)]
"""A name of the table ``BACKENDS``."""


@backend("planar")
def _planar(
    _: GazeboConfig, robot: RobotSpec, pool: WorldPool, num_envs: int, **how: Any
) -> Simulator:
    from pm01_nav.sim.simulator import PlanarSimulator

    return PlanarSimulator(robot, pool, num_envs, **how)


@backend("mujoco", drives=WHEEL_PAIR)
def _mujoco(
    _: GazeboConfig, robot: RobotSpec, pool: WorldPool, num_envs: int, **how: Any
) -> Simulator:
    _require("mujoco", extra="physics")
    _draw_without_screen()
    from pm01_nav.backends.mujoco_engine import MujocoEngine
    from pm01_nav.backends.physics import PhysicsSimulator

    return PhysicsSimulator(MujocoEngine, robot, pool, num_envs, **how)


@backend("pybullet", drives=WHEEL_PAIR)
def _pybullet(
    _: GazeboConfig, robot: RobotSpec, pool: WorldPool, num_envs: int, **how: Any
) -> Simulator:
    _require("pybullet", extra="pybullet")
    with _silent():
        import_module("pybullet")
    from pm01_nav.backends.physics import PhysicsSimulator
    from pm01_nav.backends.pybullet_engine import PybulletEngine

    return PhysicsSimulator(PybulletEngine, robot, pool, num_envs, **how)


@backend("gazebo", most_robots=os.cpu_count() or 1, drives=WHEEL_PAIR)
def _gazebo(
    gazebo: GazeboConfig, robot: RobotSpec, pool: WorldPool, num_envs: int, **how: Any
) -> Simulator:
    require_gazebo("gazebo")
    from pm01_nav.backends.gazebo.engine import GazeboEngine
    from pm01_nav.backends.physics import PhysicsSimulator

    localized = gazebo.localization == "ground_truth"
    return PhysicsSimulator(GazeboEngine, robot, pool, num_envs, localized=localized, **how)


@backend("gazebo_transport", most_robots=1, drives=WHEEL_PAIR)
def _gazebo_transport(
    gazebo: GazeboConfig, robot: RobotSpec, pool: WorldPool, num_envs: int, **how: Any
) -> Simulator:
    require_gazebo("gazebo_transport")
    gazebo.require_running(pool.worlds, num_envs)
    from pm01_nav.backends.gazebo.running import RunningEngine
    from pm01_nav.backends.physics import PhysicsSimulator

    make = partial(RunningEngine, gazebo)
    return PhysicsSimulator(make, robot, pool, num_envs, feels=False, **how)


def make_simulator(
    backend: BackendName,
    arrays: Arrays,
    robot: RobotSpec,
    pool: WorldPool,
    num_envs: int,
    gazebo: GazeboConfig = DEFAULT_GAZEBO,
    **how: Any,
) -> Simulator:
    """Return ``num_envs`` robots in the worlds of ``pool``; ``how`` is as for ``Simulator``.

    Where ``arrays`` are on a GPU, so is the simulator. ``gazebo`` is for Gazebo alone.

    Raises:
        InputError: the engine is not installed, cannot move the robot, or cannot run on a GPU.
    """
    drives = BACKENDS[backend].drives
    if drives is not None and robot.drive not in drives:
        raise InputError(
            f"backend = {backend!r}: cannot move robot {robot.name}, whose drive is {robot.drive}; "
            f"it can move: {', '.join(drives)}; give --backend planar"
        )
    if arrays.device != "cpu":
        if backend != "planar":
            raise InputError(f"backend = {backend!r}: runs on the CPU only; give --device cpu")
        from pm01_nav.sim.cuda_simulator import CudaSimulator

        return CudaSimulator(robot, pool, num_envs, arrays=arrays, **how)
    return BACKENDS[backend].build(gazebo, robot, pool, num_envs, **how)


def _require(backend: str, extra: str) -> None:
    if find_spec(backend) is None:
        raise InputError(
            f"backend = {backend!r}: is not installed; pip install 'pm01-nav[{extra}]'"
        )


def _draw_without_screen() -> None:
    """Let MuJoCo draw by EGL where there is no screen; it decides when it is imported."""
    screen = "MUJOCO_GL" in os.environ or "DISPLAY" in os.environ
    if not screen and find_library("EGL"):
        os.environ["MUJOCO_GL"] = "egl"


@contextmanager
def _silent() -> Iterator[None]:
    """Keep what a library prints from the terminal; PyBullet greets whoever imports it."""
    sys.stdout.flush()
    sys.stderr.flush()
    kept, nowhere = [os.dup(1), os.dup(2)], os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 1)
        os.dup2(nowhere, 2)
        yield
    finally:
        for number, original in enumerate(kept, start=1):
            os.dup2(original, number)
            os.close(original)
        os.close(nowhere)
