# SPDX-License-Identifier: Apache-2.0
"""The Gymnasium spaces of a task, and the task an environment was asked for."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces

from pm01_nav.config import merge, validate
from pm01_nav.durations import in_seconds
from pm01_nav.errors import InputError
from pm01_nav.task.config import TaskConfig, task_in_seconds
from pm01_nav.task.observation import ObservationLayout
from pm01_nav.task.privileged import Privileged
from pm01_nav.task.tasks import task_config


def observation_space(layout: ObservationLayout) -> spaces.Space[Any]:
    """Return the box of observations, shape (layout.size,), float32, or one for each part."""
    low, high = (np.array(bound, dtype=np.float32) for bound in layout.bounds)
    if layout.space == "flat":
        return spaces.Box(low, high)
    lows, highs = layout.split(low), layout.split(high)
    boxes: list[tuple[str, spaces.Space[Any]]] = [
        (name, spaces.Box(lows[name], highs[name])) for name in lows
    ]
    return spaces.Dict(boxes, sort_keys=False)


def widened(space: spaces.Space[Any], privileged: Privileged | None) -> spaces.Space[Any]:
    """Return the box of observations that privileged numbers follow; those have no bounds."""
    if privileged is None:
        return space
    assert isinstance(space, spaces.Box)
    bound = np.full(privileged.size, np.inf, dtype=np.float32)
    return spaces.Box(np.concatenate([space.low, -bound]), np.concatenate([space.high, bound]))


def action_space(layout: ObservationLayout) -> spaces.Box:
    """Return the box of actions: for each axis of the drive from -1 (least) to 1 (greatest)."""
    return spaces.Box(-1.0, 1.0, shape=(layout.drive.size,), dtype=np.float32)


def resolve_task(task: str | TaskConfig, changes: dict[str, object]) -> TaskConfig:
    """Return a task by name, or as it is given, with keyword changes laid over it.

    ``max_episode_steps`` is Gymnasium's way to say ``time_limit_s``; None and -1 change nothing.

    Raises:
        InputError: the task or a changed key is unknown, or a value is not allowed.
    """
    config = task_config(task) if isinstance(task, str) else task
    changes = _by_our_names(changes, config)
    if not changes:
        return config
    return validate(TaskConfig, merge(config.model_dump(), changes), f"task {config.name}")


def _by_our_names(changes: dict[str, object], config: TaskConfig) -> dict[str, object]:
    source, control_dt = f"task {config.name}: ", config.control_dt
    ours = {name: value for name, value in changes.items() if name != "max_episode_steps"}
    ours = task_in_seconds(ours, control_dt, source)
    steps = changes.get("max_episode_steps")
    if steps in (None, -1):
        return ours
    names = {"max_episode_steps": "time_limit_s"}
    control_dt = ours.get("control_dt", control_dt)
    theirs = in_seconds({"max_episode_steps": steps}, names, control_dt, source)
    given = {"time_limit_s": ours["time_limit_s"]} if "time_limit_s" in ours else theirs
    if given != theirs:
        raise InputError(
            f"max_episode_steps = {steps}, time_limit_s = {ours['time_limit_s']}: "
            "two names of one thing; give one"
        )
    return ours | theirs


def described(metadata: dict[str, Any], config: TaskConfig, **more: Any) -> dict[str, Any]:
    """Return a class's metadata as they are for one environment of a task."""
    return metadata | {"render_fps": max(1, round(1.0 / config.control_dt))} | more
