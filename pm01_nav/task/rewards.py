# SPDX-License-Identifier: Apache-2.0
"""Reward terms: pure functions of one step, weighted and summed by the task's table.

A term returns shape (num_envs,). What a term measures is positive; its sign stands in the weight.
A new term is a function here and a line in a task's ``rewards``. It says what it ``needs`` of what
is not computed for every task.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

from pm01_nav.task.step import ON_DEMAND, Step

RewardFunction = Callable[..., Any]
REWARDS: dict[str, RewardFunction] = {}
NEEDS: dict[str, frozenset[str]] = {}
"""What each term reads of the step that is only computed on demand."""


def reward_term(
    function: RewardFunction | None = None, *, needs: tuple[str, ...] = ()
) -> RewardFunction | Callable[[RewardFunction], RewardFunction]:
    """Enter a function in the table of reward terms under its own name.

    ``needs`` names what it reads of the step that is only computed on demand: ``path_distance``
    (``previous_path_distance`` comes with it), or ``visited``, for which a task needs a trail.

    Raises:
        ValueError: nothing of that name is computed on demand.
    """
    if function is None:
        return partial(reward_term, needs=needs)
    if unknown := set(needs) - set(ON_DEMAND):
        raise ValueError(f"needs {min(unknown)!r}: unknown; allowed: {', '.join(ON_DEMAND)}")
    REWARDS[function.__name__] = function
    NEEDS[function.__name__] = frozenset(needs)
    return function


def needed(terms: Iterable[str]) -> frozenset[str]:
    """Return what some terms together need of what is only computed on demand."""
    return frozenset[str]().union(*(NEEDS[name] for name in terms))


@reward_term
def goal(step: Step) -> Any:
    """1 in the step that reaches the goal."""
    return step.reached


@reward_term
def collision(step: Step) -> Any:
    """1 in the step that collides."""
    return step.collided


@reward_term
def progress(step: Step) -> Any:
    """Decrease of the straight distance to the goal [m]."""
    return step.previous_goal_distance - step.goal_distance


@reward_term(needs=("path_distance",))
def path_progress(step: Step) -> Any:
    """Decrease of the length of the way to the goal [m]: it leads out of dead ends."""
    return step.previous_path_distance - step.path_distance


@reward_term
def time(step: Step) -> Any:
    """1 in every step."""
    return step.xp.ones_like(step.goal_distance)


@reward_term
def turning(step: Step) -> Any:
    """Commanded turn to either side [rad/s]."""
    return step.xp.abs(step.command[:, -1])


@reward_term
def speed(step: Step) -> Any:
    """Commanded speed in any direction [m/s]."""
    ahead, *aside, _ = (step.command[:, k] for k in range(step.command.shape[1]))
    return step.xp.hypot(ahead, aside[0]) if aside else step.xp.abs(ahead)


@reward_term
def heading(step: Step) -> Any:
    """1 when facing the goal, 0 when it lies behind."""
    return 1.0 - step.xp.abs(step.goal_bearing) / math.pi


@reward_term
def proximity(step: Step, distance: float = 0.2) -> Any:
    """How deep the nearest obstacle intrudes into a margin around the footprint, 0 to 1."""
    return _intrusion(step, step.clearance, distance)


@reward_term
def personal_space(step: Step, distance: float = 0.5) -> Any:
    """How deep the robot intrudes into a margin between it and the nearest mover, 0 to 1."""
    return _intrusion(step, step.mover_gap, distance)


@reward_term(needs=("visited",))
def revisiting(step: Step) -> Any:
    """1 at a place that the robot had left, 0 away from all such places (``trail.near``)."""
    return step.visited[:, -1]


@reward_term
def jerkiness(step: Step) -> Any:
    """Squared change of the action since the last step, summed over its parts."""
    return step.xp.sum((step.action - step.previous_action) ** 2, axis=-1)


def _intrusion(step: Step, gap: Any, margin: float) -> Any:
    return step.xp.minimum(step.xp.maximum(1.0 - gap / margin, 0.0), 1.0)
