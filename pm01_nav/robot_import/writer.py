# SPDX-License-Identifier: Apache-2.0
"""Write a robot's YAML with a comment on each line: one that was imported, or a template."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from pm01_nav.config import write_atomically
from pm01_nav.errors import InputError
from pm01_nav.robot import RobotSpec
from pm01_nav.robot_import.importer import robot_name

COMMENT_COLUMN = 32
TEMPLATE = """\
# A robot for PM01 Navigation. Put in your figures, and write behind each where it comes from.
# Lengths in metres, angles in radians. The frame is base_link: the middle of the axle, x forward,
# y left. `pm01 robots show FILE -o picture.png` draws it.
name: {name}
description: ""                 # a line for people
footprint:                      # the outline on the floor: whatever touches an obstacle first
  shape: polygon                # or circle, with radius in place of vertices
  vertices: [[-0.25, -0.2], [0.25, -0.2], [0.25, 0.2], [-0.25, 0.2]]  # convex, counter-clockwise
wheels:
  radius: 0.08                  # [m] of the driven wheels
  separation: 0.36              # [m] between the points where they touch the floor
limits:                         # what the base does, not what its motors could
  linear_min: -0.3              # [m/s] fastest backwards; 0.0 if it must not
  linear_max: 0.8               # [m/s]
  angular_max: 1.5              # [rad/s] to either side
  linear_acceleration: 1.0      # [m/s^2]
  angular_acceleration: 3.0     # [rad/s^2]
actuator:
  lag_s: 0.1                    # [s] time constant of the answer to a command
lidar:                          # as in sensor_msgs/LaserScan: `ros2 topic echo /scan --once`
  num_beams: 720                # the number of ranges
  angle_min: -2.35619           # [rad] beam 0
  angle_max: 2.35619            # [rad] last beam; a full circle does not repeat beam 0
  range_min: 0.05               # [m]
  range_max: 10.0               # [m]
  zero_means: invalid           # what a range of 0 is: no_return (LDS class), too_close or invalid
  x: 0.2                        # [m] its place in base_link
  y: 0.0
  yaw: 0.0                      # [rad] its direction in base_link
  noise_std: 0.01               # [m] standard deviation of a range
  upside_down: false            # true where its scan runs clockwise seen from above
body:                           # for --backend mujoco and pybullet; the planar simulator has none
  mass: 15.0                    # [kg]
  height: 0.25                  # [m] top of the hull above the floor
  lidar_height: 0.3             # [m] the lidar's plane above the floor
"""


def robot_text(spec: RobotSpec, notes: Mapping[str, str], head: str = "") -> str:
    """Return a robot's YAML; ``notes`` comment a key such as ``wheels.radius``."""
    lines = [f"# {line}" for line in head.splitlines()]
    data = spec.model_dump(mode="json")
    # A footprint's other shape stays out.
    data["footprint"].pop("radius" if spec.footprint.shape == "polygon" else "vertices")
    for key, value in data.items():
        if isinstance(value, dict):
            lines.append(_line(f"{key}:", notes.get(key)))
            lines.extend(
                _line(f"  {inner}: {_scalar(part)}", notes.get(f"{key}.{inner}"))
                for inner, part in value.items()
            )
        else:
            lines.append(_line(f"{key}: {_scalar(value)}", notes.get(key)))
    return "\n".join(lines) + "\n"


def new_robot_text(path: str | Path) -> str:
    """Return a template that loads as it is, named after its file."""
    return TEMPLATE.format(name=robot_name(Path(path).stem))


def write_robot(path: str | Path, text: str, *, force: bool) -> None:
    """Write a robot's YAML.

    Raises:
        InputError: the name is none of a YAML file, its folder does not exist, or there is such a
            file already and ``force`` is not set.
    """
    target = Path(path)
    if target.suffix.lower() not in (".yaml", ".yml"):
        raise InputError(f"{target}: a robot's file must be named *.yaml")
    try:
        if not target.resolve().parent.is_dir():
            raise InputError(f"{target}: its folder does not exist")
        if target.exists() and not force:
            raise InputError(f"{target}: exists already; --force writes over it")
        write_atomically(target, text)
    except OSError as error:
        raise InputError(f"{target}: cannot be written: {error.strerror or error}") from error


def _scalar(value: Any) -> str:
    """Write a value as YAML, a word without quotes where it stays a word."""
    if isinstance(value, str) and value.isidentifier() and yaml.safe_load(value) == value:
        return value
    return json.dumps(value)


def _line(text: str, note: str | None) -> str:
    return f"{text:<{COMMENT_COLUMN - 1}} # {note}" if note else text
