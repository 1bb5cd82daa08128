# SPDX-License-Identifier: Apache-2.0
"""The tasks by name. A factory returns a fresh configuration; variants are its arguments."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from pm01_nav.errors import InputError
from pm01_nav.robot import full_circle
from pm01_nav.task.config import ObservationConfig, RewardTerm, TaskConfig
from pm01_nav.task.frames import FramesLayout
from pm01_nav.task.trail import TrailLayout

TaskFactory = Callable[[], TaskConfig]
TASKS: dict[str, TaskFactory] = {}


def task(factory: TaskFactory) -> TaskFactory:
    """Enter a factory in the table of tasks under its own name."""
    TASKS[factory.__name__] = factory
    return factory


def task_config(name: str) -> TaskConfig:
    """Return the configuration of a task by its name; a suite without one has our default task.

    Raises:
        InputError: no such task.
    """
    if name in TASKS:
        return TASKS[name]()
    if name in task_names():
        return navigation(name)
    raise InputError(f"task = {name!r}: unknown; allowed: {', '.join(task_names())}")


def task_names() -> list[str]:
    """Return what ``task_config`` knows, in alphabetical order."""
    from pm01_nav.worlds.suites import SOURCES  # which need numba

    return sorted({*TASKS, *SOURCES})


def article_rewards() -> dict[str, RewardTerm]:
    """Return the reward table of the article."""
    return {
        "goal": RewardTerm(weight=100.0),
        "collision": RewardTerm(weight=-50.0),
        "progress": RewardTerm(weight=10.0),
        "time": RewardTerm(weight=-0.05),
        "turning": RewardTerm(weight=-0.01),
        "speed": RewardTerm(weight=-0.005),
    }


@task
def article() -> TaskConfig:
    """The article's task to the letter (``PM01Nav-v0``): 20 beams, 24 numbers, fixed start."""
    return TaskConfig(
        name="article",
        suite="article",
        robot_changes={"lidar": full_circle(20)},
        goal_distance=(0.0, None),
        collision="scan",
        collision_distance=0.2,
        observation=ObservationConfig(
            sectors=0,
            nearness_distance=0.0,
            goal="polar",
            previous_action=False,
            normalize=False,
        ),
        rewards=article_rewards(),
    )


def safe_rewards(proximity_distance: float = 0.15) -> dict[str, RewardTerm]:
    """Return the article's table with a dearer collision and a price for driving close by.

    The price counts within ``proximity_distance`` of the footprint [m]. Together with the
    nearness observation it took held-out success on ``static`` from 94 % to 99.5 % (2 M steps).
    """
    proximity = RewardTerm(weight=-0.5, params={"distance": proximity_distance})
    return article_rewards() | {"collision": RewardTerm(weight=-100.0), "proximity": proximity}


def navigation(suite: str, **changes: Any) -> TaskConfig:
    """Our default task (``PM01Nav-v1``) in the worlds of a suite."""
    return TaskConfig(**{"name": suite, "suite": suite, "rewards": safe_rewards(), **changes})


@task
def static() -> TaskConfig:
    """10 m x 10 m with up to 12 discs and some boxes; random start, heading and goal."""
    return navigation("static")


@task
def empty() -> TaskConfig:
    """10 m x 10 m with nothing in it."""
    return navigation("empty", num_worlds=1)


def _winding(suite: str, **changes: Any) -> TaskConfig:
    """A task whose ways wind: paid by progress along the way, with a memory of places.

    On ``u_traps`` 3 M steps reached 31 % of the held-out goals with progress along the straight
    line, 92 % with progress along the way, and 94 % with the trail as well.
    """
    # Twice the price of `static`: being lost costs, too, and must not make risk look cheap.
    rewards = safe_rewards() | {"collision": RewardTerm(weight=-200.0)}
    rewards["path_progress"] = rewards.pop("progress")
    rewards["revisiting"] = RewardTerm(weight=-0.5)
    observation = ObservationConfig(trail=TrailLayout(), frames=FramesLayout())
    settings = {"observation": observation, "rewards": rewards, "time_limit_s": 100.0}
    return navigation(suite, **(settings | changes))


@task
def corridors() -> TaskConfig:
    """Corridors between solid blocks, with dead ends and things left standing."""
    return _winding("corridors")


@task
def rooms() -> TaskConfig:
    """A flat or an office: rooms with doors and furniture, some along a hall."""
    return _winding("rooms")


@task
def maze() -> TaskConfig:
    """A maze with passages 0.85 to 1.6 m wide; the way is often several times the distance."""
    # At 0.5 m/s one drives 100 m in 200 s. Of 3500 shortest ways 1 % were above 28 m, but who
    # has no map also sees dead ends from inside.
    return _winding("maze", time_limit_s=200.0)


@task
def u_traps() -> TaskConfig:
    """Dead ends between start and goal that must be left or gone around."""
    return _winding("u_traps")


@task
def crowd() -> TaskConfig:
    """A lightly furnished room with about ten pedestrians."""
    config = _winding("crowd", num_worlds=4096)
    # Who makes way for people scrapes the furniture: of 96 collisions 94 were with what stands.
    dearer = {
        "collision": RewardTerm(weight=-400.0),
        "proximity": RewardTerm(weight=-2.0, params={"distance": 0.25}),
        "personal_space": RewardTerm(weight=-0.5),
    }
    return config.model_copy(update={"rewards": config.rewards | dearer})


@task
def warehouse() -> TaskConfig:
    """Rows of shelves with moving carts and a few workers."""
    return _winding("warehouse")


@task
def mixed() -> TaskConfig:
    """Worlds of the suites from static to warehouse, drawn by fixed weights."""
    return _winding("mixed")


@task
def map() -> TaskConfig:
    """One's own ROS map (``--map FILE.yaml``); random start, heading and goal."""
    return navigation("map", num_worlds=1, goal_distance=(1.0, 10.0))


def _barn(suite: str, **changes: Any) -> TaskConfig:
    """The BARN challenge's robot, time limit and goal radius (sources: the Jackal's file)."""
    settings: dict[str, Any] = {
        "robot": "jackal",
        # The Jackal reverses at 2 m/s; half of all actions would be spent on what nobody needs.
        "robot_changes": {"limits": {"linear_min": -0.5}},
        "time_limit_s": 100.0,
        "goal_radius": 1.0,
        "goal_distance": (0.0, None),
        "margin": 0.03,
        "observation": ObservationConfig(sectors=72, range_max=5.0),
        "rewards": safe_rewards(0.1),
    }
    return navigation(suite, **(settings | changes))


def _dynabarn(suite: str) -> TaskConfig:
    """The same among discs that come at up to 2 m/s: seen from afar, and how they move."""
    observation = ObservationConfig(sectors=72, range_max=10.0, frames=FramesLayout())
    return _barn(suite, observation=observation, rewards=safe_rewards(0.3))


@task
def barn_like() -> TaskConfig:
    """Generated obstacle fields of the BARN kind, to train on."""
    # Dead ends of these fields kept robots going back and forth, and speed made them scrape.
    rewards = safe_rewards(0.2) | {"collision": RewardTerm(weight=-200.0)}
    rewards["proximity"] = rewards["proximity"].model_copy(update={"weight": -1.0})
    # Both kinds of progress are paid: the ways are nearly straight.
    rewards["path_progress"] = RewardTerm(weight=10.0)
    rewards["revisiting"] = RewardTerm(weight=-0.25)
    observation = ObservationConfig(sectors=72, range_max=5.0, trail=TrailLayout())
    return _barn("barn_like", num_worlds=4096, rewards=rewards, observation=observation)


@task
def barn() -> TaskConfig:
    """The BARN dataset (``--worlds DIR``), for testing only."""
    return _barn("barn")


@task
def dynabarn_like() -> TaskConfig:
    """Generated halls of the DynaBARN kind, crossed by moving discs, to train on."""
    return _dynabarn("dynabarn_like")


@task
def dynabarn() -> TaskConfig:
    """The DynaBARN worlds (``--worlds FILE.json``) of moving discs, for testing only."""
    return _dynabarn("dynabarn")
