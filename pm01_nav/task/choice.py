# SPDX-License-Identifier: Apache-2.0
"""The task that a person asks for, on the command line or in Python."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pm01_nav.config import merge, validate
from pm01_nav.errors import InputError
from pm01_nav.task.config import TaskConfig, task_in_seconds
from pm01_nav.task.randomization import load_randomization
from pm01_nav.task.tasks import task_config, task_names


def chosen_task(
    base: TaskConfig | None,
    task: str | None,
    *given: Mapping[str, Any],
    source: str = "configuration",
    randomization: str | None = None,
    defaults: Mapping[str, Any] | None = None,
    **keys: Any,
) -> TaskConfig:
    """Return a task by its name or ``base``, over it each of ``given``, and over that ``keys``.

    ``given`` comes from ``source`` and may name the task, too; what belongs to another task than
    the one that ``task`` says is left out. Of ``keys`` None and () leave one as it is.
    ``randomization`` is ``off``, ``on`` or a YAML file. ``defaults`` go before what the name stands
    for, and behind all else.

    Raises:
        InputError: something is unknown or not allowed, or no task was named.
    """
    named = [layer["name"] for layer in given if "name" in layer]
    name = task or (base.name if base else None) or (named[-1] if named else None)
    if name is None:
        raise InputError(f"task: give --task; one of {', '.join(task_names())}")
    start = base if base is not None and base.name == name else task_config(name)
    if keys.get("map") is not None:
        # A region belongs to the map it was given with.
        start = start.model_copy(update={"region": None})
    data = merge(start.model_dump(), defaults or {})
    for layer in given:
        if not task or layer.get("name", task) == task:
            # Each by itself: over what lies below, steps could not be told from seconds.
            data = merge(data, task_in_seconds(layer, data["control_dt"], f"{source}: task."))
    data |= {key: value for key, value in keys.items() if value not in (None, ())}
    if randomization is not None:
        chosen = load_randomization(randomization, data["control_dt"])
        data["randomization"] = None if chosen is None else chosen.model_dump()
    return validate(TaskConfig, data, source, inside="task")
