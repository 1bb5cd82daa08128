# SPDX-License-Identifier: Apache-2.0
"""What a robot is: its footprint, drive, limits and lidar. A new robot is one YAML file."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import (
    AfterValidator,
    Field,
    PlainValidator,
    SerializeAsAny,
    SerializerFunctionWrapHandler,
    ValidationInfo,
    model_serializer,
    model_validator,
)

from pm01_nav.config import FrozenModel, merge, validate
from pm01_nav.documents import load_yaml
from pm01_nav.drives import DRIVES, Drive
from pm01_nav.drives.limits import LIMITS, Limits
from pm01_nav.errors import InputError
from pm01_nav.geometry import is_convex_counter_clockwise
from pm01_nav.readings import ZeroMeans

Positive = Annotated[float, Field(gt=0.0)]
NonNegative = Annotated[float, Field(ge=0.0)]
MAX_BEAMS = 16384
FULL_CIRCLE = 2.0 * math.pi
NEARLY = 1e-3
"""By so much [rad] a lidar may exceed a full circle, as 3.1416 for pi does; it is then clipped."""
Angle = Annotated[float, Field(ge=-FULL_CIRCLE - NEARLY, le=FULL_CIRCLE + NEARLY)]


class Footprint(FrozenModel):
    """The robot's outline on the floor, in ``base_link`` [m]: a circle or a convex polygon."""

    shape: Literal["circle", "polygon"]
    radius: Annotated[float, Field(ge=0.0)] = 0.0
    """Radius of the circle [m]; not used for a polygon."""
    vertices: tuple[tuple[float, float], ...] = ()
    """Corners of the polygon (x, y) [m], convex, counter-clockwise, around the origin."""

    @model_validator(mode="after")
    def _has_an_area(self) -> Footprint:
        if self.shape == "circle":
            if self.radius <= 0.0 or self.vertices:
                raise ValueError("a circle needs radius > 0 and no vertices")
        elif not is_convex_counter_clockwise(np.array(self.vertices, dtype=float)):
            raise ValueError(
                "a polygon needs at least 3 vertices, convex, counter-clockwise, "
                "with the origin inside"
            )
        return self

    @property
    def circumscribed_radius(self) -> float:
        """Distance from ``base_link`` to the farthest point of the outline [m]."""
        if self.shape == "circle":
            return self.radius
        return float(np.linalg.norm(np.array(self.vertices), axis=1).max())

    @property
    def inscribed_radius(self) -> float:
        """Distance from ``base_link`` to the nearest point of the outline [m]."""
        if self.shape == "circle":
            return self.radius
        corners = np.array(self.vertices)
        edges = np.roll(corners, -1, axis=0) - corners
        cross = corners[:, 0] * edges[:, 1] - corners[:, 1] * edges[:, 0]
        return float((cross / np.linalg.norm(edges, axis=1)).min())


class Wheels(FrozenModel):
    """The driven wheels."""

    radius: Positive
    """[m]"""
    separation: Positive
    """Between the two wheels' contact points [m]."""


class Actuator(FrozenModel):
    """How the base answers a command."""

    lag_s: NonNegative = 0.0
    """Time constant of the first-order answer [s]; 0 answers at once, within the limits."""


class Lidar(FrozenModel):
    """A planar laser scanner, described as in ``sensor_msgs/LaserScan``."""

    num_beams: Annotated[int, Field(ge=1, le=MAX_BEAMS)]
    angle_min: Angle
    """Direction of beam 0 in the lidar frame [rad], counter-clockwise from x."""
    angle_max: Angle
    """Direction of the last beam [rad]; a full circle does not repeat beam 0."""
    range_min: NonNegative
    """Returns nearer than this read -inf (REP-117) [m]."""
    range_max: Positive
    """Beyond this there is no return and the beam reads +inf [m]."""
    zero_means: ZeroMeans = "invalid"
    """What a range of 0 from the driver stands for; REP-117 has none."""
    x: float = 0.0
    """Mounting position in ``base_link`` [m]."""
    y: float = 0.0
    yaw: Angle = 0.0
    """Mounting direction in ``base_link`` [rad]."""
    noise_std: NonNegative = 0.0
    """Standard deviation of a Gaussian error added to each return [m]."""
    upside_down: bool = False
    """Whether the sensor hangs upside down: its driver's scan runs clockwise seen from above. All
    else here is as seen from above; scans of such a robot are mirrored before they are used."""

    @model_validator(mode="before")
    @classmethod
    def _clip_to_a_full_circle(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        low, high = data.get("angle_min"), data.get("angle_max")
        if not (isinstance(low, int | float) and isinstance(high, int | float)):
            return data
        if not FULL_CIRCLE < high - low <= FULL_CIRCLE + NEARLY:
            return data
        # From -3.1416 to 3.1416 is from -pi to pi, and from 0 to 6.2832 is from 0 to 2 pi.
        low = -math.pi if abs(low + math.pi) < NEARLY else low
        return data | {"angle_min": low, "angle_max": low + FULL_CIRCLE}

    @model_validator(mode="after")
    def _is_ordered(self) -> Lidar:
        if self.range_min >= self.range_max:
            raise ValueError(f"range_min must be below range_max ({self.range_max})")
        if self.num_beams > 1 and self.angle_max <= self.angle_min:
            raise ValueError(f"angle_max must be above angle_min ({self.angle_min})")
        if self.angle_max - self.angle_min > FULL_CIRCLE + 1e-6:
            raise ValueError("angle_max - angle_min must not exceed a full circle")
        return self

    @property
    def angle_increment(self) -> float:
        """Angle from one beam to the next [rad]."""
        return (self.angle_max - self.angle_min) / max(self.num_beams - 1, 1)

    @property
    def angles(self) -> np.ndarray:
        """Directions of the beams in the lidar frame [rad], shape (num_beams,)."""
        return self.angle_min + self.angle_increment * np.arange(self.num_beams)


class Body(FrozenModel):
    """What physics engines need to know beyond the plane; the planar simulator does not read it."""

    mass: Positive | None = None
    """[kg]; None takes ``MASS_PER_AREA`` of the footprint."""
    height: Positive = 0.15
    """Top of the hull, which has the footprint's outline, above the floor [m]."""
    lidar_height: Positive = 0.2
    """The lidar's plane above the floor [m]."""


def _known_drive(name: str) -> str:
    if name not in DRIVES:
        raise ValueError(f"unknown; allowed: {', '.join(sorted(DRIVES))}")
    return name


def _limits_of_drive(given: Any, info: ValidationInfo) -> Limits:
    """Check limits by the drive; one that is not known has been refused already."""
    model = LIMITS.get(info.data.get("drive", ""), Limits)
    return given if isinstance(given, model) else model.model_validate(given)


class RobotSpec(FrozenModel):
    """A robot with one 2D lidar; each number's source stands in its file."""

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]
    description: str = ""
    footprint: Footprint
    drive: Annotated[str, AfterValidator(_known_drive)] = "differential"
    """What its commands mean; a name of the table ``DRIVES``, whose limits it has."""
    wheels: Wheels | None = None
    """None where the drive has no pair of them."""
    limits: Annotated[SerializeAsAny[Limits], PlainValidator(_limits_of_drive)]
    actuator: Actuator = Actuator()
    lidar: Lidar
    body: Body = Body()

    @model_validator(mode="after")
    def _has_wheels(self) -> RobotSpec:
        if DRIVES[self.drive].has_wheels and self.wheels is None:
            raise ValueError(f"wheels: missing; the drive {self.drive} needs them")
        return self

    @model_serializer(mode="wrap")
    def _as_before(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave the usual drive away: hashes of recorded results are of descriptions without."""
        data = dump(self)
        if data.get("drive") == "differential":
            del data["drive"]
        return data

    @property
    def base(self) -> Drive:
        """What commands mean to it."""
        return DRIVES[self.drive].of(self.limits)

    @property
    def driven_wheels(self) -> Wheels:
        """Its pair of driven wheels.

        Raises:
            InputError: it has none.
        """
        if self.wheels is None:
            raise InputError(f"robot {self.name}: the drive {self.drive} has no pair of wheels")
        return self.wheels


def full_circle(num_beams: int) -> dict[str, float | int]:
    """Return lidar settings for beams spread evenly over 360 degrees, the first one behind."""
    increment = 2.0 * np.pi / num_beams
    return {
        "num_beams": num_beams,
        "angle_min": -float(np.pi),
        "angle_max": float(np.pi - increment),
    }


def robot_names() -> list[str]:
    """Name the robots that come with the package."""
    folder = resources.files("pm01_nav") / "robots"
    files = [f.name for f in folder.iterdir() if f.name.endswith(".yaml")]
    return sorted(name.removesuffix(".yaml") for name in files)


@contextmanager
def robot_path(name_or_path: str | Path) -> Iterator[Path]:
    """Provide the file of a robot that comes with the package, by name, or one's own path."""
    text = str(name_or_path)
    if text in robot_names():
        with resources.as_file(resources.files("pm01_nav") / "robots" / f"{text}.yaml") as path:
            yield path
    else:
        yield Path(text)


def load_robot(name_or_path: str | Path) -> RobotSpec:
    """Load a robot that comes with the package, by name, or one's own, by the path of its YAML.

    Raises:
        InputError: no such robot, or the file does not describe one.
    """
    text = str(name_or_path)
    if text in robot_names():
        with robot_path(text) as path:
            return validate(RobotSpec, load_yaml(path), path.name)
    if text.endswith((".yaml", ".yml")):
        return validate(RobotSpec, load_yaml(text), text)
    names = ", ".join(robot_names())
    raise InputError(f"robot = {text!r}: unknown; allowed: {names}, or the path of a .yaml file")


def changed_robot(robot: RobotSpec, changes: Mapping[str, Any]) -> RobotSpec:
    """Return ``robot`` with ``changes`` laid over, such as ``{"limits": {"linear_min": -0.5}}``.

    Raises:
        InputError: the changes make it impossible.
    """
    if not changes:
        return robot
    changed = merge(robot.model_dump(), changes)
    return validate(RobotSpec, changed, f"robot {robot.name} with robot_changes")
