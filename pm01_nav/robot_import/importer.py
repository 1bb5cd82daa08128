# SPDX-License-Identifier: Apache-2.0
"""Fill a ``RobotSpec`` from a URDF, and say where each figure came from."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pm01_nav.config import validate
from pm01_nav.robot import RobotSpec, full_circle
from pm01_nav.robot_import.gazebo import Drive, find_lidar
from pm01_nav.robot_import.outline import find_outline
from pm01_nav.robot_import.urdf import Urdf, number, read_urdf
from pm01_nav.robot_import.wheels import Axle, find_axle

LIMITS: dict[str, float] = {
    "linear_max": 0.5,
    "angular_max": 1.5,
    "linear_acceleration": 1.0,
    "angular_acceleration": 3.0,
}
"""What a base of this size usually can do, where the file says nothing."""
LIDAR: dict[str, float | int | str] = {
    **full_circle(360),
    "range_min": 0.12,
    "range_max": 3.5,
    "zero_means": "invalid",
}
"""A lidar of the LDS-01 class, where the file says nothing."""
DEFAULT = "default: not in the URDF; check it"
DISAGREEMENT = 0.01
"""Part by which the plugin of the drive may differ from the shapes without a warning."""
DIGITS = 9
"""Figures are written to a nanometre: 1.57 for pi / 2 leaves longer ones."""
SHIFTED = 1e-3
"""An axle whose middle lies farther than this from base_link is worth a word [m]."""


@dataclass(frozen=True)
class ImportedRobot:
    """A robot, and what there is to say about it."""

    spec: RobotSpec
    notes: dict[str, str]
    """Where a figure came from, by its key such as ``wheels.radius``."""
    warnings: tuple[str, ...]


def import_urdf(
    path: str | Path,
    *,
    wheels: tuple[str, str] | None = None,
    wheel_radius: float | None = None,
    footprint_radius: float | None = None,
) -> ImportedRobot:
    """Read a differential-drive robot from a URDF, macros expanded.

    ``wheels`` names the joints of the driven wheels. The frame of the result lies in the middle
    of the axle, about which such a robot turns.

    Raises:
        InputError: the file is no URDF of such a robot, or does not say enough.
    """
    urdf = read_urdf(path)
    drive = Drive(urdf)
    axle = find_axle(urdf, drive, wheels, wheel_radius)
    footprint, outline, warnings = find_outline(urdf, (axle.x, axle.y), footprint_radius)
    limits, notes = _limits(drive, axle)
    lidar, lidar_notes, lidar_warnings = _lidar(urdf, axle)
    notes |= lidar_notes | {
        "footprint": outline,
        "wheels.radius": axle.source,
        "wheels.separation": f"between {' and '.join(axle.joints)}",
    }
    body, body_notes = _body(urdf)
    notes |= body_notes
    data = {
        "name": robot_name(urdf.name or urdf.path.stem),
        "description": f"imported from {printable(urdf.path.name)}",
        "footprint": footprint,
        "wheels": {"radius": _round(axle.radius), "separation": _round(axle.separation)},
        "limits": limits,
        "lidar": lidar,
        "body": body,
    }
    spec = validate(RobotSpec, data, str(path))
    warnings = [*warnings, *lidar_warnings, *_doubts(drive, axle)]
    return ImportedRobot(
        spec,
        {key: printable(note) for key, note in notes.items()},
        tuple(printable(warning) for warning in warnings),
    )


def robot_name(text: str) -> str:
    """Make a name that a ``RobotSpec`` may have."""
    name = re.sub(r"[^a-z0-9]+", "_", text.lower()[:60]).strip("_")
    return name if re.match("[a-z]", name) else f"robot_{name}".strip("_")


def printable(text: str) -> str:
    """Return one line of ASCII."""
    return "".join(c if " " <= c <= "~" else "?" for c in " ".join(text.split()))


def _round(value: float) -> float:
    # Adding zero turns -0.0 into 0.0.
    return round(value, DIGITS) + 0.0


def _limits(drive: Drive, axle: Axle) -> tuple[dict[str, float], dict[str, str]]:
    limits, notes = {}, {}
    for key, default in LIMITS.items():
        note = "plugin of the drive"
        if key in drive.figures:
            value = drive.figures[key]
        elif axle.velocity is not None and key in ("linear_max", "angular_max"):
            value = axle.velocity * axle.radius
            note = f"limit of the wheels, {axle.velocity:g} rad/s"
            if key == "angular_max":
                value *= 2.0 / axle.separation
                note += ", turning on the spot"
        else:
            value, note = default, DEFAULT
        limits[key], notes[f"limits.{key}"] = _round(value), note
    if "linear_min" in drive.figures:
        limits["linear_min"] = _round(drive.figures["linear_min"])
        notes["limits.linear_min"] = "plugin of the drive"
    else:
        limits["linear_min"] = -limits["linear_max"]
        notes["limits.linear_min"] = "default: as fast as forwards"
    return limits, notes


def _lidar(urdf: Urdf, axle: Axle) -> tuple[dict[str, Any], dict[str, str], list[str]]:
    found, source, warnings = find_lidar(urdf)
    figures: dict[str, Any] = {**LIDAR, "x": 0.0, "y": 0.0, "yaw": 0.0, "noise_std": 0.0, **found}
    # Beams and their directions belong together.
    if "num_beams" in found:
        figures |= {key: found[key] for key in ("angle_min", "angle_max") if key in found}
    notes = {f"lidar.{key}": source if key in found else DEFAULT for key in figures}
    if "x" in found:
        figures["x"] -= axle.x
        figures["y"] -= axle.y
    else:
        warnings = [*warnings, "no lidar found: its place and figures are defaults"]
    rounded = {k: _round(v) if isinstance(v, float) else v for k, v in figures.items()}
    return rounded, notes, warnings


def _body(urdf: Urdf) -> tuple[dict[str, float | None], dict[str, str]]:
    """Return the body for physics engines; its heights are left to who knows the robot."""
    masses = urdf.root.findall("link/inertial/mass")
    total = sum(number(mass, "value", f"{urdf.path}: mass") for mass in masses)
    notes = {key: f"for physics engines; {DEFAULT}" for key in ("body.height", "body.lidar_height")}
    notes["body.mass"] = "all links together" if total > 0.0 else DEFAULT
    return {"mass": _round(total) if total > 0.0 else None}, notes


def _doubts(drive: Drive, axle: Axle) -> list[str]:
    doubts = []
    if max(abs(axle.x), abs(axle.y)) > SHIFTED:
        doubts.append(
            f"the middle of the axle lies at ({axle.x:g}, {axle.y:g}) m in base_link: "
            "all figures are seen from it"
        )
    if len(axle.joints) > 2:
        doubts.append(f"{len(axle.joints)} wheels: taken for one axle in the middle of them")
    for key, value in (("radius", axle.radius), ("separation", axle.separation)):
        other = drive.figures.get(key, value)
        if abs(other - value) > DISAGREEMENT * value:
            doubts.append(f"wheels.{key}: {value:g} m by the shapes, {other:g} m by the plugin")
    return doubts
