# SPDX-License-Identifier: Apache-2.0
"""What the tags for Gazebo in a URDF say about the drive and the lidar."""

from __future__ import annotations

import math
from xml.etree.ElementTree import Element

from pm01_nav.errors import InputError
from pm01_nav.robot_import.urdf import LARGEST, Urdf
from pm01_nav.worlds.sdf_pose import Transform, read_pose

LIDAR_TYPES = ("gpu_lidar", "lidar", "gpu_ray", "ray")
LIDAR_WORDS = ("laser", "lidar", "scan")
LEVEL = 0.05
"""A lidar tilted by more than this [rad] scans no plane."""

# What plugins of several Gazebo generations call the same thing.
_TAGS = {
    "left_joint": ("left_joint", "leftJoint"),
    "right_joint": ("right_joint", "rightJoint"),
    "radius": ("wheel_radius",),
    "diameter": ("wheel_diameter", "wheelDiameter"),
    "separation": ("wheel_separation", "wheelSeparation"),
    "linear_min": ("min_linear_velocity", "min_velocity"),
    "linear_max": ("max_linear_velocity", "max_velocity"),
    "angular_max": ("max_angular_velocity",),
    "linear_acceleration": ("max_linear_acceleration", "max_acceleration"),
    "angular_acceleration": ("max_angular_acceleration",),
}
_JOINTS = ("left_joint", "right_joint")


class Drive:
    """The figures of a differential-drive plugin; empty without one."""

    def __init__(self, urdf: Urdf) -> None:
        """Find the plugin."""
        self.where = ""
        self.joints: tuple[list[str], list[str]] = ([], [])
        self.figures: dict[str, float] = {}
        for plugin in urdf.root.findall("gazebo/plugin"):
            names = f"{plugin.get('filename', '')} {plugin.get('name', '')}".lower()
            if "diff" in names and "drive" in names:
                self.where = f"{urdf.path}: plugin {plugin.get('name', '')[:60]!r}"
                self._read(plugin)
                return

    def _read(self, plugin: Element) -> None:
        for key, tags in _TAGS.items():
            elements = [element for tag in tags for element in plugin.findall(tag)]
            if key in _JOINTS:
                self.joints[_JOINTS.index(key)].extend((e.text or "").strip() for e in elements)
            elif elements:
                self.figures[key] = _number(elements[0], self.where)
        if "diameter" in self.figures:
            self.figures.setdefault("radius", self.figures.pop("diameter") / 2.0)


def find_lidar(urdf: Urdf) -> tuple[dict[str, float | int], str, list[str]]:
    """Return figures of a ``Lidar``, what they were read from, and warnings.

    Without a sensor's tag a link that is named like a lidar gives its place alone; without such a
    link nothing is known.

    Raises:
        InputError: the sensor's numbers cannot be, or it does not lie level.
    """
    sensors = [
        (str(gazebo.get("reference")), sensor)
        for gazebo in urdf.root.findall("gazebo")
        for sensor in gazebo.findall("sensor")
        if sensor.get("type") in LIDAR_TYPES and gazebo.get("reference") in urdf.places
    ]
    if not sensors:
        return _place_by_name(urdf)
    link, sensor = sensors[0]
    name = sensor.get("name", "")[:60]
    others = [other.get("name", "")[:60] for _, other in sensors[1:]]
    warnings = [f"lidar {other!r}: left out; a robot has one" for other in others]
    where = f"{urdf.path}: sensor {name!r}"
    place = urdf.places[link].apply(read_pose(sensor, where, ""))
    figures = _place(place, where) | _scan(sensor, where)
    return figures, f"sensor {name}", warnings


def _place_by_name(urdf: Urdf) -> tuple[dict[str, float | int], str, list[str]]:
    for name, place in urdf.places.items():
        if any(word in name.lower() for word in LIDAR_WORDS):
            return _place(place, f"{urdf.path}: link {name!r}"), f"link {name}", []
    return {}, "", []


def _place(place: Transform, where: str) -> dict[str, float | int]:
    up = float(place.rotation[2, 2])
    if up < math.cos(LEVEL):
        raise InputError(f"{where}: the lidar must lie level, with z up")
    x, y, _ = place.translation.tolist()
    yaw = math.atan2(place.rotation[1, 0], place.rotation[0, 0])
    return {"x": x, "y": y, "yaw": yaw}


def _scan(sensor: Element, where: str) -> dict[str, float | int]:
    """Read beams, ranges and noise; what is not there stays out."""
    found: dict[str, float | int] = {}
    device = next((d for tag in ("lidar", "ray") for d in sensor.findall(tag)), None)
    if device is None:
        return found
    for key, tag in (
        ("num_beams", "scan/horizontal/samples"),
        ("angle_min", "scan/horizontal/min_angle"),
        ("angle_max", "scan/horizontal/max_angle"),
        ("range_min", "range/min"),
        ("range_max", "range/max"),
        ("noise_std", "noise/stddev"),
    ):
        element = device.find(tag)
        if element is not None:
            found[key] = _number(element, where)
    if "num_beams" in found:
        found["num_beams"] = round(found["num_beams"])
    return found


def _number(element: Element, where: str) -> float:
    text = " ".join((element.text or "").split())
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not abs(value) <= LARGEST:
        raise InputError(
            f"{where}: {element.tag} = {text[:60]!r}: must be a number "
            f"from -{LARGEST:g} to {LARGEST:g}"
        )
    return value
