# SPDX-License-Identifier: Apache-2.0
"""What a benchmark measures on, as a contract: the same hash means the same episodes."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from pm01_nav.benchmark.sweeps import SWEEPS, SweepPoint
from pm01_nav.config import merge, validate
from pm01_nav.errors import InputError
from pm01_nav.robot import RobotSpec
from pm01_nav.task.config import TaskConfig
from pm01_nav.task.randomization import IN_STEPS, load_randomization
from pm01_nav.task.tasks import task_config
from pm01_nav.task.worlds import world_pool
from pm01_nav.worlds.frozen import worlds_hash
from pm01_nav.worlds.suites import world_source_of

HASHED_WORLDS = 16
"""Generated worlds that the hash covers; of worlds from files it covers all."""
RULES = (
    "suite",
    "suite_params",
    "control_dt",
    "goal_radius",
    "goal_distance",
    "collision",
    "collision_distance",
    "pedestrians",
    "pedestrians_avoid_robot",
    "margin",
    "randomization",
)
"""Keys of a task that decide what happens; the others are what a policy learns by."""


@dataclass(frozen=True)
class Suite:
    """A task's held-out episodes, numbered from 0 on."""

    name: str
    task: TaskConfig
    seed: int
    point: SweepPoint | None = None
    """Where on which sweep it lies, if on any."""

    @cached_property
    def robot(self) -> RobotSpec:
        """The robot that drives, with the task's changes."""
        return self.task.robot_spec()

    @cached_property
    def hash(self) -> str:
        """SHA-256 of robot, rules, seed and worlds, in hexadecimal.

        Raises:
            InputError: the worlds cannot be had.
        """
        task = self.task.model_dump(mode="json")
        rules = {key: task[key] for key in RULES}
        # In steps, as of old; limits of as many steps are one.
        rules["time_limit_steps"] = self.task.time_limit_steps
        rules["randomization"] = _hashed(task["randomization"])
        # How the driver counts its beams, and what it says for none, changes nothing here.
        left_out = {"body": True, "lidar": {"upside_down", "zero_means"}}
        robot = self.robot.model_dump(mode="json", exclude=left_out)
        contract = rules | {"robot": robot, "seed": self.seed}
        if self.task.backend != "planar":
            # The plane knows no bodies, so that theirs do not matter there.
            contract |= {"backend": self.task.backend, "body": self.robot.body.model_dump()}
        worlds = world_pool(self.task, "held_out", HASHED_WORLDS, self.seed).worlds
        text = json.dumps(contract, sort_keys=True) + worlds_hash(worlds)
        return hashlib.sha256(text.encode()).hexdigest()

    @property
    def from_files(self) -> bool:
        """Whether its worlds are a given number, visited in turn."""
        return not world_source_of(self.task.suite).held_out

    def describe(self) -> dict[str, Any]:
        """Return what a reader should know of it, as plain data."""
        return {
            "task": self.task.name,
            "robot": self.robot.name,
            "backend": self.task.backend,
            "seed": self.seed,
            "hash": self.hash,
            "control_dt": self.task.control_dt,
            "time_limit_s": self.task.time_limit_s,
            "sweep": self.point and self.point._asdict(),
        }


def read_suite(
    text: str,
    seed: int,
    robot: str | None = None,
    randomization: str | None = None,
    backend: str | None = None,
) -> Suite:
    """Return the suite that ``NAME`` or, with worlds from files, ``NAME=PATH`` stands for.

    ``robot`` drives instead of the task's own; ``randomization`` is a choice of
    ``load_randomization``. Its name becomes part of the suite's, and so does ``backend``'s.

    Raises:
        InputError: an unknown task, files that are missing, or an unusable robot.
    """
    name, separator, path = text.partition("=")
    task = task_config(name)
    key = world_source_of(task.suite).path
    if separator != "" and key is None:
        raise InputError(f"suite = {text!r}: the worlds of {name} are generated, not read")
    if key is not None and not path:
        raise InputError(f"suite = {text!r}: its worlds are files; write {name}=PATH")
    changes: dict[str, Any] = {} if key is None else {key: path}
    how, added = _variation(task, robot, randomization, backend)
    return Suite(name + added, _changed(task, changes | how), seed)


def sweep_suites(
    name: str,
    seed: int,
    robot: str | None = None,
    randomization: str | None = None,
    backend: str | None = None,
) -> list[Suite]:
    """Return a suite for each point of a sweep; options as for ``read_suite``.

    What the sweep varies goes over the ``randomization``.

    Raises:
        InputError: no such sweep, an unusable robot, or a backend that cannot have what is varied.
    """
    if name not in SWEEPS:
        raise InputError(f"sweep = {name!r}: unknown; allowed: {', '.join(SWEEPS)}")
    sweep = SWEEPS[name]
    start = task_config(sweep.suite)
    how, added = _variation(start, robot, randomization, backend)
    suites = []
    for value in sweep.values:
        task = _changed(start, merge(how, sweep.changes(value)))
        # Of another name, so that a report draws it as a curve of its own.
        point = SweepPoint(name + added, sweep.label, sweep.suite + added, value)
        suites.append(Suite(f"{point.suite}@{name}={value:g}", task, seed, point))
    return suites


def _variation(
    task: TaskConfig, robot: str | None, randomization: str | None, backend: str | None
) -> tuple[dict[str, Any], str]:
    """Return changes of a task, and what they add to the suite's name."""
    changes: dict[str, Any] = {}
    added = ""
    if robot is not None:
        changes["robot"] = robot
    chosen = load_randomization(randomization or "off", task.control_dt)
    if randomization is not None and chosen is not None:
        changes["randomization"] = chosen.model_dump()
        added += f"+{_stem(randomization)}"
    if backend is not None and backend != task.backend:
        changes["backend"] = backend
        added += f"+{backend}"
    return changes, added


def _changed(task: TaskConfig, changes: dict[str, Any]) -> TaskConfig:
    return validate(TaskConfig, merge(task.model_dump(), changes), f"suite {task.name}")


def _hashed(randomization: dict[str, Any] | None) -> dict[str, Any] | None:
    """Return ranges as they were hashed when delays were counted in steps, where there are none.

    The episodes are still the same, and so is their hash.
    """
    if randomization is None or any(max(randomization[f"{name}_s"]) > 0.0 for name in IN_STEPS):
        return randomization
    kept = {k: v for k, v in randomization.items() if k.removesuffix("_s") not in IN_STEPS}
    return kept | {"command_delay": [0, 0], "scan_delay": [0, 0], "scan_sweep": [0.0, 0.0]}


def _stem(path: str) -> str:
    """Return a file's name without folder and ending."""
    return path.replace("\\", "/").rsplit("/", 1)[-1].rsplit(".", 1)[0]
