# SPDX-License-Identifier: Apache-2.0
"""Everything that defines a task, as one typed, immutable configuration."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from pm01_nav.backends import DEFAULT_GAZEBO, BackendName, GazeboConfig
from pm01_nav.config import FrozenModel
from pm01_nav.durations import CONTROL_DT, in_seconds, whole_steps
from pm01_nav.robot import NonNegative, Positive, RobotSpec, changed_robot, load_robot
from pm01_nav.sim.settings import SWITCHES, PedestrianModel
from pm01_nav.task.frames import FramesLayout
from pm01_nav.task.observation import (
    GoalKind,
    ObservationLayout,
    SpaceKind,
    UsualParts,
    memories_in_seconds,
)
from pm01_nav.task.parts import make_part
from pm01_nav.task.parts.base import check_part
from pm01_nav.task.randomization import RandomizationConfig, delays_in_seconds
from pm01_nav.task.rewards import checked, needed
from pm01_nav.task.scans import scan_geometry
from pm01_nav.task.trail import TrailLayout

EARLY = {"time_limit_steps": "time_limit_s"}
"""Keys by which early tasks counted control steps, and the present ones."""


class ObservationConfig(FrozenModel):
    """How observations are built; see ``UsualParts`` and ``task/parts/``."""

    sectors: Annotated[int, Field(ge=0)] = 36
    nearness_distance: NonNegative = 0.3
    goal: GoalKind = "polar_sin_cos"
    previous_action: bool = True
    trail: TrailLayout | None = None
    """How the places where the robot has been are shown; None does not show them."""
    frames: FramesLayout | None = None
    """Which earlier scans are shown; None shows the present one alone."""
    goal_distance_max: Positive = 10.0
    range_max: Positive | None = None
    """Show ranges up to this only [m]; None shows the lidar's whole range."""
    parts: dict[str, dict[str, Any]] = Field(default_factory=dict)
    """Further parts by name, with their parameters; they follow the others."""
    normalize: bool = True
    space: SpaceKind = "flat"
    """What environments give: one ``Box``, or a ``Dict`` with one for each part."""


class RewardTerm(FrozenModel):
    """One row of the reward table."""

    weight: float
    params: dict[str, Any] = Field(default_factory=dict)
    """Of any plain type; the term says which."""


class TaskConfig(FrozenModel):
    """A robot, the worlds it drives in, what it sees, what it is paid for and when it ends."""

    name: str
    suite: str
    """Where the worlds come from: a name of the table ``worlds.suites.SOURCES``."""
    suite_params: dict[str, float] = Field(default_factory=dict)
    """Parameters of the generator to fix, e.g. ``{pedestrians: 20}`` for ``crowd``."""
    map: str | None = None
    """The world to drive in, for the suite ``map``: a ROS map's .yaml, our YAML, or SDF."""
    models: tuple[str, ...] = ()
    """Folders with the models that an SDF world includes, searched before the usual ones."""
    partial: bool = False
    """Drive in what could be read of an SDF world, even if most of it could not."""
    region: tuple[float, float, float, float] | None = None
    """Where in the world of ``map`` to drive: x_min, y_min, x_max, y_max [m]; None is anywhere."""
    worlds: str | None = None
    """The folder of the BARN dataset, or the file of the DynaBARN worlds, for those suites."""
    num_worlds: Annotated[int, Field(ge=1, le=65536)] = 1024
    """Worlds to generate for training."""
    robot: str = "pm01"
    """A robot's name or the path of its YAML file."""
    robot_changes: dict[str, Any] = Field(default_factory=dict)
    """Laid over the robot's own description, e.g. ``{lidar: {num_beams: 20}}``."""
    backend: BackendName = "planar"
    """What moves the robots: the planar simulator or a physics engine."""
    gazebo: GazeboConfig = DEFAULT_GAZEBO
    """For the backends ``gazebo`` and ``gazebo_transport``."""
    control_dt: Annotated[float, Field(ge=0.001, le=1.0)] = CONTROL_DT
    """Time between two actions [s]."""
    time_limit_s: Annotated[float, Field(gt=0.0, le=1e9)] = 50.0
    """After so long the episode is truncated [s]; rounded to control periods."""
    goal_radius: Positive = 0.3
    """[m]"""
    goal_distance: tuple[NonNegative, NonNegative | None] = (2.0, None)
    """Least and greatest straight distance from start to goal [m]; None is no limit.

    Where a world offers nothing of the kind, the nearest to it is taken.
    """
    collision: Literal["contact", "scan"] = "contact"
    """A collision is a touch of the footprint, or a return nearer than collision_distance."""
    collision_distance: Positive = 0.2
    """[m], for ``collision: scan``."""
    pedestrians: PedestrianModel = "orca"
    """How pedestrians avoid each other."""
    pedestrians_avoid_robot: bool = True
    """Whether they avoid the robot, too."""
    margin: NonNegative = 0.1
    """Starts, goals and a way between them keep at least this free beside the footprint [m]."""
    observation: ObservationConfig = ObservationConfig()
    rewards: dict[str, RewardTerm]
    randomization: RandomizationConfig | None = None
    """How far robots and sensors may be from their description; None: not at all."""

    @model_validator(mode="before")
    @classmethod
    def _in_seconds(cls, given: Any) -> Any:
        return task_in_seconds(given, CONTROL_DT, "task.") if isinstance(given, Mapping) else given

    @model_validator(mode="after")
    def _is_consistent(self) -> TaskConfig:
        low, high = self.goal_distance
        if high is not None and high <= low:
            raise ValueError("goal_distance: the greatest must exceed the least")
        if self.randomization and self.randomization.footprint_padding[1] > self.margin:
            raise ValueError(
                f"randomization.footprint_padding: must not exceed margin ({self.margin:g}), or "
                "episodes start in contact"
            )
        if self.randomization and self.backend != "planar":
            raise ValueError(
                f"randomization: only the backend planar has it, not {self.backend}; leave one away"
            )
        return self

    @model_validator(mode="after")
    def _has_known_parts_and_rewards(self) -> TaskConfig:
        seen = self.observation
        for name, parameters in seen.parts.items():
            check_part(name, parameters)
        for name, term in self.rewards.items():
            checked(name, term.params)
            for feature in needed([name]) - SWITCHES:
                if getattr(seen, feature, None) is None and feature not in seen.parts:
                    raise ValueError(f"rewards.{name}: needs observation.{feature}")
        return self

    @property
    def time_limit_steps(self) -> int:
        """The time limit in control steps."""
        return whole_steps(self.time_limit_s, self.control_dt)

    def robot_spec(self) -> RobotSpec:
        """Return the robot with this task's changes.

        Raises:
            InputError: no such robot, or the changes make it impossible.
        """
        return changed_robot(load_robot(self.robot), self.robot_changes)

    def goal_distance_limits(self) -> tuple[float, float]:
        """Return the least and the greatest distance from start to goal [m]."""
        low, high = self.goal_distance
        return low, math.inf if high is None else high


def task_in_seconds(given: Mapping[str, Any], control_dt: float, source: str) -> dict[str, Any]:
    """Return keys of a task, with seconds for what early ones counted in control steps.

    Convert changes before they go over a task, which has all of it in seconds. The steps are
    those of their own control period, or else of ``control_dt`` [s].

    Raises:
        InputError: a duration stands there in both ways, or is no number of steps.
    """
    control_dt = given.get("control_dt", control_dt)
    task = in_seconds(given, EARLY, control_dt, source)
    if isinstance(task.get("randomization"), Mapping):
        ranges = delays_in_seconds(task["randomization"], control_dt, f"{source}randomization")
        task["randomization"] = ranges
    if isinstance(task.get("observation"), Mapping):
        seen = memories_in_seconds(task["observation"], control_dt, f"{source}observation.")
        task["observation"] = seen
    return task


def observation_layout(config: TaskConfig, robot: RobotSpec) -> ObservationLayout:
    """Return the contract between this task's environments and the policies trained in them."""
    seen = config.observation
    lidar, drive = robot.lidar, robot.base
    geometry = scan_geometry(lidar, min(lidar.range_max, seen.range_max or lidar.range_max))
    usual = UsualParts(
        # A lidar of few beams is seen beam by beam.
        sectors=seen.sectors if seen.sectors <= lidar.num_beams else 0,
        nearness_distance=seen.nearness_distance,
        goal=seen.goal,
        previous_action=seen.previous_action,
        goal_distance_max=seen.goal_distance_max,
        trail=seen.trail,
        frames=seen.frames,
    )
    more = [make_part(name, given, geometry, drive) for name, given in seen.parts.items()]
    parts = (*usual.made(geometry, drive), *more)
    return ObservationLayout(geometry, drive, parts, seen.normalize, seen.space)
