# SPDX-License-Identifier: Apache-2.0
"""Robots and maps that a task names by a path, in a folder that may be handed to somebody else.

A path below the working folder is stored as it is, relative. Any other would tell how this machine
is arranged, and would lead nowhere on another: the file is copied, and its name is stored.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pm01_nav.config import make_folder, to_yaml, write_atomically
from pm01_nav.provenance import shown_path
from pm01_nav.robot import load_robot, robot_names
from pm01_nav.task.config import TaskConfig
from pm01_nav.worlds.files import read_world, write_world

GIVEN = "given"
"""Where the copies are: ``given/robot`` and ``given/map``."""


def stored_task(task: TaskConfig, folder: Path | None = None) -> TaskConfig:
    """Return ``task`` as it may be written into ``folder``: without paths of this machine."""
    changes: dict[str, str] = {}
    if task.robot not in robot_names():
        changes["robot"] = _stored("robot", task.robot, folder)
    if task.map is not None:
        changes["map"] = _stored("map", task.map, folder)
    if task.worlds is not None:
        changes["worlds"] = shown_path(task.worlds)
    return task.model_copy(update=changes)


def copy_given(task: TaskConfig, folder: Path) -> None:
    """Copy into ``folder`` the robot and the map that lie outside the working folder.

    Raises:
        InputError: one cannot be read, or the copy not be written.
    """
    if task.robot not in robot_names() and _copied("robot", task.robot, folder):
        file = _room("robot", task.robot, folder)
        write_atomically(file, to_yaml(load_robot(task.robot).model_dump(mode="json")))
    if task.map is not None and _copied("map", task.map, folder):
        write_world(read_world(task.map), _room("map", task.map, folder), "yaml")


def located(task: Mapping[str, Any], folder: str | Path) -> dict[str, Any]:
    """Return a stored task, plain data that stood in ``folder``, with the paths of its copies."""
    found = dict(task)
    for key in ("robot", "map"):
        name = task.get(key)
        if isinstance(name, str) and Path(name).name == name:
            file = Path(folder) / GIVEN / key / name
            if file.is_file():
                found[key] = str(file)
    return found


def _stored(key: str, path: str, folder: Path | None) -> str:
    if folder is not None and _copied(key, path, folder):
        return _copy(key, path, folder).name
    if folder is not None and _is_in(path, folder / GIVEN / key):
        return Path(path).name
    return shown_path(path)


def _copied(key: str, path: str, folder: Path) -> bool:
    """Tell whether a file lies elsewhere than in the working folder or among the copies."""
    shown = os.path.realpath(shown_path(path)) == os.path.realpath(path)
    return not shown and not _is_in(path, folder / GIVEN / key)


def _is_in(path: str, folder: Path) -> bool:
    return Path(path).resolve().parent == folder.resolve()


def _copy(key: str, path: str, folder: Path) -> Path:
    return folder / GIVEN / key / f"{Path(path).stem}.yaml"


def _room(key: str, path: str, folder: Path) -> Path:
    file = _copy(key, path, folder)
    make_folder(file.parent)
    return file
