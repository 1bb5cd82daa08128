# SPDX-License-Identifier: Apache-2.0
"""The table of planners. A planner enters it under ``@planner``, where it is defined."""

from __future__ import annotations

from collections.abc import Callable
from importlib import resources
from typing import NamedTuple, TypeVar

from pm01_nav.config import FrozenModel, validate
from pm01_nav.documents import load_yaml
from pm01_nav.policy.protocol import Policy
from pm01_nav.robot import RobotSpec


class Planner(NamedTuple):
    """How a planner is made."""

    build: Callable[..., Policy]
    """From the robot, the control period [s] and the parameters."""
    params: type[FrozenModel]


PLANNERS: dict[str, Planner] = {}
Build = TypeVar("Build", bound=Callable[..., Policy])


def planner(name: str, params: type[FrozenModel]) -> Callable[[Build], Build]:
    """Enter a class in the table; ``parameters/NAME.yaml`` goes over the defaults of ``params``."""

    def enter(build: Build) -> Build:
        PLANNERS[name] = Planner(build, params)
        return build

    return enter


def planner_params(name: str) -> FrozenModel:
    """Return a planner's parameters: those of its YAML file in ``parameters/``, if it has one."""
    file = resources.files("pm01_nav") / "planners" / "parameters" / f"{name}.yaml"
    if not file.is_file():
        return PLANNERS[name].params()
    with resources.as_file(file) as path:
        return validate(PLANNERS[name].params, load_yaml(path) or {}, path.name)


def make_planner(name: str, robot: RobotSpec, control_dt: float) -> Policy:
    """Return a planner for a robot that is commanded every ``control_dt`` [s]."""
    return PLANNERS[name].build(robot, control_dt, planner_params(name))
