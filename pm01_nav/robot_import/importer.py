# SPDX-License-Identifier: Apache-2.0
"""Fill a ``RobotSpec`` from a URDF, and say where each figure came from."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pm01_nav.config import validate
from pm01_nav.errors import InputError
from pm01_nav.robot import RobotSpec, full_circle
from pm01_nav.robot_import.drive import Drive
from pm01_nav.robot_import.elements import number
from pm01_nav.robot_import.lidar import FoundLidar, find_lidar
from pm01_nav.robot_import.other_drives import has_oblique_friction
from pm01_nav.robot_import.outline import Outline, find_outline
from pm01_nav.robot_import.packages import Packages
from pm01_nav.robot_import.solids import Solids
from pm01_nav.robot_import.urdf import Urdf, read_urdf
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
    without: Sequence[str] = (),
    lidar: str | None = None,
    packages: Sequence[str | Path] = (),
    arguments: Mapping[str, str] | None = None,
) -> ImportedRobot:
    """Read a differential-drive robot from a URDF or a xacro file with its ``arguments``.

    ``wheels`` names the joints of the driven wheels, ``lidar`` a sensor or a link, ``without``
    links that the footprint leaves out with all that they carry, ``packages`` folders in which
    ROS packages lie. The frame of the result lies in the middle of the axle, about which such a
    robot turns.

    Raises:
        InputError: the file is no URDF of such a robot, or does not say enough.
    """
    path = Path(path)
    if wheel_radius is not None and not 0.0 < wheel_radius < math.inf:
        raise InputError(f"wheels.radius = {wheel_radius}: must be above 0 m")
    folders = Packages(path, packages)
    urdf, solids = read_urdf(path, folders, arguments or {}), Solids(folders)
    drive = Drive(urdf)
    axle = find_axle(urdf, drive, solids, wheels, wheel_radius)
    outline = find_outline(urdf, solids, axle, footprint_radius, tuple(without))
    found = find_lidar(urdf, lidar)
    data, notes = _described(urdf, drive, axle, outline, found)
    spec = validate(RobotSpec, data, str(path))
    warnings = [*outline.warnings, *found.warnings, *_doubts(urdf, drive, axle)]
    return ImportedRobot(
        spec,
        {key: printable(note) for key, note in notes.items()},
        tuple(printable(warning) for warning in warnings),
    )


def _described(
    urdf: Urdf, drive: Drive, axle: Axle, outline: Outline, found: FoundLidar
) -> tuple[dict[str, Any], dict[str, str]]:
    """Return the figures of a ``RobotSpec``, and where they came from by their keys."""
    limits, notes = _limits(drive, axle)
    separation, separation_note = _separation(drive, axle)
    lidar, lidar_notes = _lidar(found, axle)
    body, body_notes = _body(urdf, outline, found, axle)
    notes |= lidar_notes | body_notes
    notes |= {
        "footprint": outline.source,
        "wheels.radius": axle.source,
        "wheels.separation": separation_note,
    }
    data = {
        "name": robot_name(urdf.name or urdf.path.stem),
        "description": f"imported from {printable(urdf.path.name)}",
        "footprint": outline.footprint,
        "wheels": {"radius": _round(axle.radius), "separation": _round(separation)},
        "limits": limits,
        "lidar": lidar,
        "body": body,
    }
    return data, notes


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


def _separation(drive: Drive, axle: Axle) -> tuple[float, str]:
    """Return how far apart the wheels are, or count for where they skid."""
    if axle.skids and drive.figures.get("separation", 0.0) > 0.0:
        return drive.figures["separation"], "plugin of the drive, which is to allow for skidding"
    return axle.separation, f"between {' and '.join(axle.joints)}"


def _lidar(found: FoundLidar, axle: Axle) -> tuple[dict[str, Any], dict[str, str]]:
    figures: dict[str, Any] = {**LIDAR, "x": 0.0, "y": 0.0, "yaw": 0.0, "noise_std": 0.0}
    figures |= {"upside_down": False} | found.figures
    notes = {f"lidar.{key}": found.source if key in found.figures else DEFAULT for key in figures}
    if "x" in found.figures:
        figures["x"] -= axle.x
        figures["y"] -= axle.y
    if figures["upside_down"]:
        # Seen from above its beams run the other way round.
        figures["angle_min"], figures["angle_max"] = -figures["angle_max"], -figures["angle_min"]
    for key, note in (("x", found.source), ("upside_down", found.source)):
        notes[f"lidar.{key}"] = note or DEFAULT
    if not figures["upside_down"]:
        notes.pop("lidar.upside_down")
    rounded = {k: _round(v) if isinstance(v, float) else v for k, v in figures.items()}
    return rounded, notes


def _body(
    urdf: Urdf, outline: Outline, found: FoundLidar, axle: Axle
) -> tuple[dict[str, float | None], dict[str, str]]:
    """Return the body for physics engines."""
    masses = urdf.root.findall("link/inertial/mass")
    total = sum(number(mass, "value", f"{urdf.path}: mass") for mass in masses)
    body: dict[str, float | None] = {"mass": _round(total) if total > 0.0 else None}
    notes = {"body.mass": "all links together" if total > 0.0 else DEFAULT}
    lidar_height = None if found.height is None else found.height - axle.floor
    for key, value, source in (
        ("height", outline.height, "highest point of the shapes above the floor"),
        ("lidar_height", lidar_height, f"{found.source}, above the floor"),
    ):
        if value is not None and value > 0.0:
            body[key], notes[f"body.{key}"] = _round(value), source
        else:
            notes[f"body.{key}"] = f"for physics engines; {DEFAULT}"
    return body, notes


def _doubts(urdf: Urdf, drive: Drive, axle: Axle) -> list[str]:
    doubts = []
    if max(abs(axle.x), abs(axle.y)) > SHIFTED:
        doubts.append(
            f"the middle of the axle lies at ({axle.x:g}, {axle.y:g}) m in base_link: "
            "all figures are seen from it"
        )
    if axle.skids:
        doubts.append(
            f"{len(axle.joints)} wheels: taken for one axle in the middle of them; they skid in "
            f"turns, so {axle.separation:g} m between them counts for more: pm01 identify measures "
            "how much"
        )
    if has_oblique_friction(urdf, axle.joints):
        doubts.append(
            "fdir1 lets the wheels roll askew, as mecanum wheels do: taken for plain ones that skid"
        )
    for key, value in (("radius", axle.radius), ("separation", axle.separation)):
        other = drive.figures.get(key, value)
        if abs(other - value) > DISAGREEMENT * value:
            doubts.append(f"wheels.{key}: {value:g} m by the shapes, {other:g} m by the plugin")
    if urdf.massless:
        listed = ", ".join(repr(link[:60]) for link in urdf.massless[:8])
        doubts.append(f"links that move without mass, which Gazebo drops: {listed}")
    return doubts
