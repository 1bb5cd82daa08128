# SPDX-License-Identifier: Apache-2.0
"""When an episode ends: at the goal, in a collision, or (truncated) when its time is up."""

from __future__ import annotations

from typing import Any

from pm01_nav.arrays import array_namespace
from pm01_nav.task.config import TaskConfig
from pm01_nav.task.step import Step


def judge(step: Step, config: TaskConfig) -> tuple[Any, Any]:
    """Tell where the goal was reached and where the robot collided, each (num_envs,).

    Both in one step count once: a touch of the footprint spoils the arrival, whereas the article,
    whose collision is only a return nearer than a limit, asks for the goal first.
    """
    at_goal = step.goal_distance < config.goal_radius
    if config.collision == "contact":
        # A copy: the next reset clears the simulator's own.
        touched = array_namespace(step.contact).asarray(step.contact, copy=True)
        return at_goal & ~touched, touched
    return at_goal, (step.nearest_return < config.collision_distance) & ~at_goal


def out_of_time(step: Step, config: TaskConfig) -> Any:
    """Tell where the time limit is reached; this truncates and never terminates."""
    return step.count >= config.time_limit_steps
