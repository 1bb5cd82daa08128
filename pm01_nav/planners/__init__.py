# SPDX-License-Identifier: Apache-2.0
"""Classical planners, under the same protocol as a learned policy."""

from __future__ import annotations

from collections.abc import Callable
from importlib import resources
from typing import NamedTuple

from pydantic import BaseModel

from pm01_nav.config import FrozenModel, validate
from pm01_nav.documents import load_yaml
from pm01_nav.planners.dwa import DWA, DWAParams
from pm01_nav.planners.gap_following import GapFollowing, GapFollowingParams
from pm01_nav.planners.goal_seeking import GoalSeeking, GoalSeekingParams
from pm01_nav.planners.mppi import MPPI, MPPIParams
from pm01_nav.planners.pure_pursuit import PurePursuit, PurePursuitParams
from pm01_nav.planners.regulated_pure_pursuit import (
    RegulatedPurePursuit,
    RegulatedPurePursuitParams,
)
from pm01_nav.planners.vfh import VFH, VFHParams
from pm01_nav.policy.protocol import Policy
from pm01_nav.robot import RobotSpec


class Planner(NamedTuple):
    """How a planner is made."""

    build: Callable[..., Policy]
    """From the robot, the control period [s] and the parameters."""
    params: type[FrozenModel]


PLANNERS: dict[str, Planner] = {
    "goal_seeking": Planner(GoalSeeking, GoalSeekingParams),
    "gap_following": Planner(GapFollowing, GapFollowingParams),
    "vfh": Planner(VFH, VFHParams),
    "pure_pursuit": Planner(PurePursuit, PurePursuitParams),
    "regulated_pure_pursuit": Planner(RegulatedPurePursuit, RegulatedPurePursuitParams),
    "dwa": Planner(DWA, DWAParams),
    "mppi": Planner(MPPI, MPPIParams),
}


def planner_params(name: str) -> BaseModel:
    """Return a planner's parameters from its YAML file in ``parameters/``."""
    file = resources.files("pm01_nav") / "planners" / "parameters" / f"{name}.yaml"
    with resources.as_file(file) as path:
        return validate(PLANNERS[name].params, load_yaml(path) or {}, path.name)


def make_planner(name: str, robot: RobotSpec, control_dt: float) -> Policy:
    """Return a planner for a robot that is commanded every ``control_dt`` [s]."""
    return PLANNERS[name].build(robot, control_dt, planner_params(name))
