# SPDX-License-Identifier: Apache-2.0
"""Reward terms: functions of one step, weighted and summed by the task's table.

A term returns shape (num_envs,). What a term measures is positive; its sign stands in the weight.
A new term is a function here and a line in a task's ``rewards``; one that remembers something is
a ``StatefulTerm``. It says what it ``needs`` of what is not computed for every task.
"""

from __future__ import annotations

import inspect
import json
import math
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any, ClassVar

from pydantic import TypeAdapter, ValidationError

from pm01_nav.arrays import Arrays
from pm01_nav.errors import InputError
from pm01_nav.robot import Positive
from pm01_nav.task.step import ON_DEMAND, Step

RewardFunction = Callable[..., Any]
REWARDS: dict[str, RewardFunction] = {}
NEEDS: dict[str, frozenset[str]] = {}
"""What each term reads of the step that is only computed on demand."""


class StatefulTerm:
    """A term that remembers something of each episode, built once for all robots of a batch.

    Its parameters are keyword arguments of ``__init__``. Its state is every attribute that is an
    array with a row an environment; checkpoints hold it. Write into these arrays (``|=``,
    ``[...] =``) instead of replacing them, and let no condition depend on what they hold, so that
    a CUDA graph can hold the term.
    """

    name: ClassVar[str]
    """By which tasks call it."""

    def __init__(self, num_envs: int, arrays: Arrays) -> None:
        """Keep how many environments there are; ``arrays.xp`` makes arrays on ``arrays.place``."""
        self.num_envs = num_envs

    def __call__(self, step: Step) -> Any:
        """Return what is paid in this step, shape (num_envs,)."""
        raise NotImplementedError

    def reset(self, env_ids: Any) -> None:
        """Forget the last episode where one begins: ``array[env_ids] = 0``.

        ``env_ids`` are numbers of environments, or a mask of all of them.
        """
        raise NotImplementedError

    def arrays(self) -> dict[str, Any]:
        """Return the arrays of the state by name, not copied."""
        shapes = {n: getattr(a, "shape", ()) for n, a in vars(self).items()}
        return {n: getattr(self, n) for n, s in shapes.items() if s and s[0] == self.num_envs}

    def keep(self, robots: Any) -> None:
        """Go on with these of the robots only."""
        for name, array in self.arrays().items():
            setattr(self, name, array[robots])
        self.num_envs = len(robots)


def reward_term(function: Any = None, *, needs: tuple[str, ...] = ()) -> Any:
    """Enter a function, or a ``StatefulTerm``, in the table of reward terms under its own name.

    ``needs`` names what it reads of the step that is only computed on demand: ``path_distance``
    (``previous_path_distance`` comes with it), or ``visited``, for which a task needs a trail.

    Raises:
        ValueError: nothing of that name is computed on demand.
    """
    if function is None:
        return partial(reward_term, needs=needs)
    if unknown := set(needs) - set(ON_DEMAND):
        raise ValueError(f"needs {min(unknown)!r}: unknown; allowed: {', '.join(ON_DEMAND)}")
    name = getattr(function, "name", function.__name__)
    REWARDS[name] = function
    NEEDS[name] = frozenset(needs)
    return function


def needed(terms: Iterable[str]) -> frozenset[str]:
    """Return which features of the simulator some terms together need (``sim.settings``)."""
    return frozenset(ON_DEMAND[need] for name in terms for need in NEEDS[name])


def checked(name: str, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return a term's parameters, each as its type hint wants it, or else its default's type.

    Raises:
        InputError: no such term, or a parameter is unknown, missing or of another type.
    """
    if name not in REWARDS:
        raise InputError(f"rewards.{name}: unknown; allowed: {', '.join(sorted(REWARDS))}")
    term = REWARDS[name]
    of_the_batch = 2 if isinstance(term, type) else 1
    known = dict(list(inspect.signature(term, eval_str=True).parameters.items())[of_the_batch:])
    if unknown := set(given) - set(known):
        allowed = ", ".join(sorted(known)) or "none"
        raise InputError(f"rewards.{name}.params.{min(unknown)}: unknown; allowed: {allowed}")
    for key, parameter in known.items():
        if key not in given and parameter.default is parameter.empty:
            raise InputError(f"rewards.{name}.params.{key}: is missing")
    return {
        key: _as_hinted(f"rewards.{name}.params.{key}", v, known[key]) for key, v in given.items()
    }


def _as_hinted(key: str, value: Any, parameter: inspect.Parameter) -> Any:
    hint = parameter.annotation
    if hint is parameter.empty:
        of_default = type(parameter.default)
        # Who writes 1 does not mean that 0.5 is wrong.
        hint = {int: float, type(None): Any, type: Any}.get(of_default, of_default)
    try:
        # As JSON, lists may be given for tuples, while True is no number and "1" neither.
        plain = json.dumps(value, allow_nan=False)
        return TypeAdapter[Any](hint).validate_json(plain, strict=True)
    except ValidationError as error:
        why = error.errors(include_url=False)[0]["msg"]
    except (TypeError, ValueError):
        why = "must be numbers that are finite, booleans, strings, or lists of these"
    raise InputError(f"{key} = {value!r}: {why[:1].lower()}{why[1:]}")


class RewardTable:
    """The terms of a task, ready to pay a batch."""

    def __init__(self, rows: Mapping[str, Any], num_envs: int, arrays: Arrays) -> None:
        """Make the terms of ``rows``: their weights and parameters by name.

        Raises:
            InputError: see ``checked``.
        """
        self._terms: list[tuple[Any, float]] = []
        self._stateful: dict[str, StatefulTerm] = {}
        for name, row in rows.items():
            parameters = checked(name, row.params)
            term = REWARDS[name]
            if isinstance(term, type):
                term = self._stateful[name] = term(num_envs, arrays, **parameters)
            else:
                term = partial(term, **parameters)
            # Attributes of pydantic models are slow to read.
            self._terms.append((term, row.weight))

    def pay(self, step: Step, paid: Any) -> None:
        """Write each term's weighted share of the reward into ``paid`` (num_terms, num_envs)."""
        for row, (term, weight) in enumerate(self._terms):
            paid[row] = weight * term(step)

    def reset(self, env_ids: Any) -> None:
        """Let episodes begin; ``env_ids`` are numbers of environments, or a mask."""
        for term in self._stateful.values():
            term.reset(env_ids)

    def keep(self, robots: Any) -> None:
        """Go on with these of the robots only."""
        for term in self._stateful.values():
            term.keep(robots)

    def arrays(self) -> dict[str, Any]:
        """Return the arrays that make up the state of all terms by name, not copied."""
        return {
            f"reward.{name}.{key}": array
            for name, term in self._stateful.items()
            for key, array in term.arrays().items()
        }


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
def proximity(step: Step, distance: Positive = 0.2) -> Any:
    """How deep the nearest obstacle intrudes into a margin around the footprint, 0 to 1."""
    return _intrusion(step, step.clearance, distance)


@reward_term
def personal_space(step: Step, distance: Positive = 0.5) -> Any:
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
