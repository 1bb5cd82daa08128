# SPDX-License-Identifier: Apache-2.0
"""The lidar of a URDF: which of its sensors is one, where it sits and what it sees."""

from __future__ import annotations

import math
from dataclasses import dataclass
from xml.etree.ElementTree import Element

from pm01_nav.errors import InputError
from pm01_nav.robot import MAX_BEAMS
from pm01_nav.robot_import.elements import LARGEST, numbers, origin_of
from pm01_nav.robot_import.urdf import Urdf
from pm01_nav.worlds.sdf_pose import Transform, read_pose

RAY_TYPES = ("gpu_lidar", "lidar", "gpu_ray", "ray")
DEPTH_TYPES = ("depth", "depth_camera", "rgbd", "rgbd_camera", "sonar")
LIDAR_WORDS = ("laser", "lidar", "scan")
LEVEL = 0.05
"""A lidar tilted by more than this [rad] scans no plane."""
LEAST_BEAMS = 16
"""A sensor of fewer rays measures a distance; one names it with --lidar to have it all the same."""
LEAST_VIEW = 0.5
"""Likewise one that looks less far around [rad]."""


@dataclass(frozen=True)
class FoundLidar:
    """What a URDF says about the lidar."""

    figures: dict[str, float | int | bool]
    """Of a ``Lidar``, in the robot's frame; only what the file says."""
    height: float | None
    """Above the origin of the robot's frame [m]."""
    source: str
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class _Sensor:
    """A sensor that sends out rays."""

    name: str
    element: Element
    place: Transform
    where: str
    scan: dict[str, float]
    """samples, min_angle, max_angle and vertical, as far as the file has them."""
    unfit: str
    """Why it is no lidar; empty if it is one."""

    @property
    def beams(self) -> int:
        return int(self.scan.get("samples", 0.0) * self.scan.get("resolution", 1.0))

    @property
    def view(self) -> float:
        return self.scan.get("max_angle", 0.0) - self.scan.get("min_angle", 0.0)


def find_lidar(urdf: Urdf, name: str | None = None) -> FoundLidar:
    """Find the level sensor with many beams and the widest view, or the one called ``name``.

    Without such a sensor a link that is named like a lidar gives its place alone; without such a
    link nothing is known.

    Raises:
        InputError: there is no sensor or link of this name, its numbers cannot be, or it tilts.
    """
    sensors = _sensors(urdf)
    lost = [f"depth sensor {name!r}: left out" for name in _depth_sensors(urdf)]
    if name is not None:
        chosen = next((s for s in sensors if name in (s.name, s.element.get("name"))), None)
        if chosen is None and name in urdf.places:
            return _by_link(urdf, name, lost)
        if chosen is None:
            known = ", ".join(repr(s.name) for s in sensors[:12]) or "no lidars"
            raise InputError(
                f"{urdf.path}: --lidar {name[:60]!r}: no such sensor or link; there are: {known}"
            )
        if chosen.unfit.startswith("tilt"):
            raise InputError(f"{chosen.where}: {chosen.unfit}; a lidar must lie level")
    else:
        fit = [sensor for sensor in sensors if not sensor.unfit]
        lost += _left_out([sensor for sensor in sensors if sensor.unfit])
        if not fit:
            return _by_name(urdf, lost)
        # A plane before many rings; then the widest view, then the most beams, then the first.
        chosen = max(fit, key=lambda s: (s.scan.get("vertical", 1.0) <= 1.0, _step(s), s.beams))
        lost += [
            f"lidar {other.name!r}: left out; a robot has one (--lidar NAME chooses)"
            for other in fit
            if other is not chosen
        ]
    if chosen.scan.get("vertical", 1.0) > 1.0:
        lost.append(f"lidar {chosen.name!r}: has several rings; taken as one level ring")
    figures = _place(chosen.place) | _ranges(chosen)
    height = float(chosen.place.translation[2])
    return FoundLidar(figures, height, f"sensor {chosen.name}", tuple(lost))


def _step(sensor: _Sensor) -> int:
    # Views that differ by less than a degree are alike.
    return round(math.degrees(sensor.view))


def _sensors(urdf: Urdf) -> list[_Sensor]:
    found = []
    for link, element in _elements(urdf):
        if element.get("type") not in RAY_TYPES and element.find("ray") is None:
            continue
        name = element.get("name", "")[:60] or link[:60]
        where = f"{urdf.path}: sensor {name!r}"
        # In Gazebo's tags it has a <pose>, in a URDF's own an <origin>.
        inner = origin_of(element, where) if element.find("origin") is not None else None
        place = urdf.places[link].apply(inner or read_pose(element, where, ""))
        scan = _scan(element, where)
        found.append(_Sensor(name, element, place, where, scan, _unfit(urdf, link, place, scan)))
    return found


def _elements(urdf: Urdf) -> list[tuple[str, Element]]:
    """Return the sensors with the links that they sit on."""
    found = [
        (str(gazebo.get("reference")), sensor)
        for gazebo in urdf.root.findall("gazebo")
        for sensor in gazebo.findall("sensor")
    ]
    for sensor in urdf.root.findall("sensor"):
        parent = sensor.find("parent")
        found.append(("" if parent is None else parent.get("link", ""), sensor))
    return [(link, sensor) for link, sensor in found if link in urdf.places]


def _depth_sensors(urdf: Urdf) -> list[str]:
    return [
        element.get("name", "")[:60]
        for _, element in _elements(urdf)
        if element.get("type") in DEPTH_TYPES
    ]


def _unfit(urdf: Urdf, link: str, place: Transform, scan: dict[str, float]) -> str:
    """Return why a sensor is no lidar, an empty text if it is one."""
    tilted = math.acos(min(abs(float(place.rotation[2, 2])), 1.0))
    if tilted > LEVEL:
        return f"tilted by {math.degrees(tilted):.0f} degrees"
    for joint in urdf.above(link):
        if joint.kind in ("continuous", "revolute") and not urdf.is_hinge(joint):
            return f"tilted by joint {joint.name[:60]!r}"
    beams = int(scan.get("samples", LEAST_BEAMS) * scan.get("resolution", 1.0))
    if beams < LEAST_BEAMS:
        return f"a range sensor of {beams} beam{'s' if beams != 1 else ''}"
    if beams > MAX_BEAMS:
        return f"{beams} beams, more than {MAX_BEAMS}"
    view = scan.get("max_angle", math.pi) - scan.get("min_angle", 0.0)
    if view < LEAST_VIEW:
        return f"a range sensor that looks {math.degrees(view):.0f} degrees around"
    return ""


def _left_out(sensors: list[_Sensor]) -> list[str]:
    """Name those that are no lidars, alike ones in one line."""
    alike: dict[str, list[str]] = {}
    for sensor in sensors:
        alike.setdefault(sensor.unfit, []).append(repr(sensor.name))
    return [
        f"sensor{'s' if len(names) > 1 else ''} {', '.join(names)}: left out; {why}"
        for why, names in alike.items()
    ]


def _by_name(urdf: Urdf, lost: list[str]) -> FoundLidar:
    """Take the place of a link that is named like a lidar: the last such one of a chain."""

    def fits(link: str) -> bool:
        return any(word in link.lower() for word in LIDAR_WORDS)

    named = next((link for link in urdf.places if fits(link)), None)
    while named is not None:
        inner = [j.child for j in urdf.joints.values() if j.parent == named and fits(j.child)]
        if not inner:
            return _by_link(urdf, named, lost)
        named = inner[0]
    lost = [*lost, "no lidar found: its place and figures are defaults"]
    return FoundLidar({}, None, "", tuple(lost))


def _by_link(urdf: Urdf, link: str, lost: list[str]) -> FoundLidar:
    place = urdf.places[link]
    if math.acos(min(abs(float(place.rotation[2, 2])), 1.0)) > LEVEL:
        lost = [
            *lost,
            f"link {link[:60]!r}: is tilted, so it holds no lidar",
            "no lidar found: its place and figures are defaults",
        ]
        return FoundLidar({}, None, "", tuple(lost))
    lost = [*lost, f"no lidar sensor found: figures are defaults, its place is link {link[:60]!r}"]
    return FoundLidar(_place(place), float(place.translation[2]), f"link {link[:60]}", tuple(lost))


def _place(place: Transform) -> dict[str, float | int | bool]:
    x, y, _ = place.translation.tolist()
    yaw = math.atan2(place.rotation[1, 0], place.rotation[0, 0])
    return {"x": x, "y": y, "yaw": yaw, "upside_down": bool(place.rotation[2, 2] < 0.0)}


def _device(element: Element) -> Element:
    return next((d for tag in ("lidar", "ray") for d in element.findall(tag)), element)


def _scan(element: Element, where: str) -> dict[str, float]:
    """Read beams and directions; what is not there stays out."""
    device = _device(element)
    found: dict[str, float] = {}
    for key in ("samples", "resolution", "min_angle", "max_angle"):
        inner = device.find(f"scan/horizontal/{key}")
        own = device.find("horizontal")
        if inner is not None:
            found[key] = _number(inner, where)
        elif own is not None and own.get(key) is not None:
            # A URDF's own sensors have attributes in place of elements.
            (found[key],) = numbers(own, key, 1, where, None)
    vertical = device.find("scan/vertical/samples")
    if vertical is not None:
        found["vertical"] = _number(vertical, where)
    return found


def _ranges(sensor: _Sensor) -> dict[str, float | int | bool]:
    """Return beams, ranges and noise as a ``Lidar`` has them."""
    found: dict[str, float | int | bool] = {}
    scan, device = sensor.scan, _device(sensor.element)
    if "samples" in scan:
        found["num_beams"] = sensor.beams
    for key, name in (("angle_min", "min_angle"), ("angle_max", "max_angle")):
        if name in scan:
            found[key] = scan[name]
    for key, tag in (
        ("range_min", "range/min"),
        ("range_max", "range/max"),
        ("noise_std", "noise/stddev"),
    ):
        element = device.find(tag)
        if element is not None:
            found[key] = _number(element, sensor.where)
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
