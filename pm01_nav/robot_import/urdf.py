# SPDX-License-Identifier: Apache-2.0
"""A URDF as links in one frame: what is read, and what is refused."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from pm01_nav.documents import parse_xml
from pm01_nav.errors import InputError
from pm01_nav.worlds.sdf_pose import IDENTITY, Transform, from_euler

FloatArray = NDArray[np.float64]

LARGEST = 1e4
"""Larger numbers are refused: no robot is ten kilometres long."""
MOST = {"link": 2000, "joint": 2000, "link/collision": 5000, "link/visual": 5000}
"""More are refused: what is a robot has a tenth of them, and some steps take their square."""
JOINT_TYPES = ("fixed", "continuous", "revolute", "prismatic", "floating", "planar")
BASE = "base_link"
MOMENTS = ("ixx", "iyy", "izz")


@dataclass(frozen=True)
class Solid:
    """A box, cylinder, sphere or mesh of a link."""

    link: str
    kind: str
    size: tuple[float, ...]
    """Sides of a box, radius and length of a cylinder, radius of a sphere [m]; () for a mesh."""
    pose: Transform
    """In the robot's frame, all joints at zero."""
    mesh: str = ""
    """File name of a mesh."""


@dataclass(frozen=True)
class Joint:
    """A joint, all others at zero."""

    name: str
    kind: str
    parent: str
    child: str
    pose: Transform
    """In its parent; the child's frame."""
    axis: FloatArray
    """In its own frame, unit length, shape (3,)."""
    velocity: float | None
    """Fastest motion [rad/s], None where the file says nothing."""


@dataclass(frozen=True)
class Urdf:
    """A robot's links, placed in the frame of ``base_link``, or of the root without such a link."""

    path: Path
    name: str
    root: Element
    joints: dict[str, Joint]
    places: dict[str, Transform]
    """Of each link in the robot's frame."""
    collisions: tuple[Solid, ...]
    visuals: tuple[Solid, ...]

    def lump(self, link: str) -> set[str]:
        """Name the links that are fixed to ``link``, it among them, without those above it."""
        lump, fresh = {link}, [link]
        while fresh:
            parent = fresh.pop()
            for joint in self.joints.values():
                if joint.kind == "fixed" and joint.parent == parent:
                    lump.add(joint.child)
                    fresh.append(joint.child)
        return lump


def read_urdf(path: str | Path) -> Urdf:
    """Read a URDF.

    Raises:
        InputError: it is no whole XML, has unexpanded macros, links that do not hang together,
            or numbers that cannot be.
    """
    path = Path(path)
    root = parse_xml(path)
    _refuse_other_files(root, path)
    _refuse_too_many(root, path)
    links = _named(root, "link", path)
    if not links:
        raise InputError(f"{path}: has no links")
    joints = {
        name: _read_joint(element, path) for name, element in _named(root, "joint", path).items()
    }
    places = _place_links(set(links), joints, path)
    _check_masses(links, joints, path)
    solids = {
        kind: tuple(
            solid
            for name, link in links.items()
            for solid in _solids(link, kind, places[name], path)
        )
        for kind in ("collision", "visual")
    }
    return Urdf(
        path, root.get("name", ""), root, joints, places, solids["collision"], solids["visual"]
    )


def number(element: Element, key: str, where: str, default: float | None = None) -> float:
    """Read a number from an attribute.

    Raises:
        InputError: it is missing without a default, no number, not finite, or too large.
    """
    (value,) = numbers(element, key, 1, where, None if default is None else (default,))
    return value


def numbers(
    element: Element | None, key: str, count: int, where: str, default: tuple[float, ...] | None
) -> tuple[float, ...]:
    """Read ``count`` numbers from an attribute, or take the default where there is none.

    Raises:
        InputError: there are more or fewer, or one is not finite or too large.
    """
    text = None if element is None else element.get(key)
    if text is None and default is not None:
        return default
    try:
        values = tuple(float(word) for word in (text or "").split())
    except ValueError:
        values = ()
    # NaN and infinity fail the comparison, too.
    if len(values) != count or not all(abs(value) <= LARGEST for value in values):
        shown = "" if text is None else " ".join(text.split())[:60]
        limit = f"-{LARGEST:g} to {LARGEST:g}"
        raise InputError(f"{where}: {key} = {shown!r}: must be {count} number(s) from {limit}")
    return values


def origin_of(element: Element, where: str) -> Transform:
    """Read the ``<origin>`` of an element; the identity where there is none."""
    origin = element.find("origin")
    x, y, z = numbers(origin, "xyz", 3, f"{where}: origin", (0.0, 0.0, 0.0))
    roll, pitch, yaw = numbers(origin, "rpy", 3, f"{where}: origin", (0.0, 0.0, 0.0))
    return Transform(from_euler(roll, pitch, yaw), np.array([x, y, z]))


def _refuse_other_files(root: Element, path: Path) -> None:
    if root.tag != "robot":
        raise InputError(f"{path}: its outermost element is <{root.tag[:60]}>; a URDF has <robot>")
    unexpanded = any(
        "/xacro}" in str(element.tag) or any("$" in value for value in element.attrib.values())
        for element in root.iter()
    )
    if unexpanded:
        raise InputError(
            f"{path}: holds xacro macros; expand it first: xacro {path.name} > robot.urdf"
        )


def _refuse_too_many(root: Element, path: Path) -> None:
    for tag, most in MOST.items():
        count = len(root.findall(tag))
        if count > most:
            raise InputError(
                f"{path}: has {count} {tag.split('/')[-1]}s; at most {most} are allowed"
            )


def _named(root: Element, tag: str, path: Path) -> dict[str, Element]:
    found: dict[str, Element] = {}
    for element in root.findall(tag):
        name = element.get("name", "")
        if not name:
            raise InputError(f"{path}: a {tag} has no name")
        if name in found:
            raise InputError(f"{path}: {tag} {name!r}: stands twice")
        found[name] = element
    return found


def _read_joint(element: Element, path: Path) -> Joint:
    name, kind = element.get("name", ""), element.get("type", "")
    where = f"{path}: joint {name!r}"
    if kind not in JOINT_TYPES:
        raise InputError(f"{where}: type = {kind!r}: allowed: {', '.join(JOINT_TYPES)}")
    ends = [end.get("link", "") for tag in ("parent", "child") for end in element.findall(tag)]
    if len(ends) != 2:
        raise InputError(f"{where}: must have one parent and one child")
    axis = np.array(numbers(element.find("axis"), "xyz", 3, f"{where}: axis", (1.0, 0.0, 0.0)))
    length = float(np.linalg.norm(axis))
    if kind != "fixed" and length < 1e-6:
        raise InputError(f"{where}: axis: must not be zero")
    limit = element.find("limit")
    velocity = None if limit is None else number(limit, "velocity", f"{where}: limit", 0.0)
    pose = origin_of(element, where)
    return Joint(name, kind, ends[0], ends[1], pose, axis / max(length, 1e-6), velocity or None)


def _place_links(links: set[str], joints: dict[str, Joint], path: Path) -> dict[str, Transform]:
    """Return where each link lies in ``base_link``, or in the root without such a link."""
    parents: dict[str, Joint] = {}
    for joint in joints.values():
        for end, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in links:
                raise InputError(f"{path}: joint {joint.name!r}: {end} {link!r}: no such link")
        if joint.child in parents:
            raise InputError(f"{path}: link {joint.child!r}: is the child of two joints")
        parents[joint.child] = joint
    roots = sorted(links - set(parents))
    if len(roots) != 1:
        listed = ", ".join(repr(name[:60]) for name in roots[:5]) or "none"
        raise InputError(
            f"{path}: must have one link without a parent, not {len(roots)} ({listed})"
        )
    children: dict[str, list[Joint]] = {}
    for joint in joints.values():
        children.setdefault(joint.parent, []).append(joint)
    places, fresh = {roots[0]: IDENTITY}, [roots[0]]
    while fresh:
        parent = fresh.pop()
        for joint in children.get(parent, []):
            places[joint.child] = places[parent].apply(joint.pose)
            fresh.append(joint.child)
    lost = sorted(links - set(places))
    if lost:
        raise InputError(f"{path}: link {lost[0]!r}: its joints run in a circle")
    # A namespace may stand before it, as in robot1/base_link.
    spaced = (place for name, place in places.items() if name.endswith(f"/{BASE}"))
    base = places.get(BASE, next(spaced, IDENTITY))
    # The inverse of a rotation is its transpose.
    back = Transform(base.rotation.T, -base.rotation.T @ base.translation)
    return {name: back.apply(place) for name, place in places.items()}


def _check_masses(links: dict[str, Element], joints: dict[str, Joint], path: Path) -> None:
    """Refuse a moving link that neither has mass and inertia nor a link fixed to it that has."""
    heavy = {name for name, link in links.items() if _has_inertia(link, f"{path}: link {name!r}")}
    carriers = set(heavy)
    for _ in range(len(joints)):
        more = {j.parent for j in joints.values() if j.kind == "fixed" and j.child in carriers}
        if more <= carriers:
            break
        carriers |= more
    for joint in joints.values():
        if joint.kind != "fixed" and joint.child not in carriers:
            raise InputError(
                f"{path}: link {joint.child!r}: moves (joint {joint.name!r}), so its mass, ixx, "
                "iyy and izz must be above 0"
            )


def _has_inertia(link: Element, where: str) -> bool:
    inertial = link.find("inertial")
    if inertial is None:
        return False
    mass, inertia = inertial.find("mass"), inertial.find("inertia")
    values = [0.0 if mass is None else number(mass, "value", f"{where}: mass")]
    moments = [] if inertia is None else [inertia]
    values += [number(m, key, f"{where}: inertia") for m in moments for key in MOMENTS] or [0.0]
    if min(values) < 0.0:
        raise InputError(f"{where}: mass and moments of inertia must not be negative")
    return min(values) > 0.0


def _solids(link: Element, tag: str, place: Transform, path: Path) -> list[Solid]:
    name, solids = link.get("name", ""), []
    for element in link.findall(tag):
        where = f"{path}: link {name!r}: {tag}"
        shapes = [shape for geometry in element.findall("geometry") for shape in geometry]
        if len(shapes) != 1:
            raise InputError(f"{where}: must have one shape, not {len(shapes)}")
        read = _SHAPES.get(shapes[0].tag)
        if read is None:
            raise InputError(f"{where}: <{str(shapes[0].tag)[:40]}>: allowed: {', '.join(_SHAPES)}")
        pose = place.apply(origin_of(element, where))
        size, mesh = read(shapes[0], where)
        solids.append(Solid(name, str(shapes[0].tag), size, pose, mesh))
    return solids


def _box(shape: Element, where: str) -> tuple[tuple[float, ...], str]:
    return _sizes(numbers(shape, "size", 3, f"{where}: box", None), f"{where}: box: size"), ""


def _cylinder(shape: Element, where: str) -> tuple[tuple[float, ...], str]:
    sizes = [number(shape, key, f"{where}: {shape.tag}") for key in ("radius", "length")]
    return _sizes(tuple(sizes), f"{where}: {shape.tag}: radius, length"), ""


def _sphere(shape: Element, where: str) -> tuple[tuple[float, ...], str]:
    radius = number(shape, "radius", f"{where}: sphere")
    return _sizes((radius,), f"{where}: sphere: radius"), ""


def _mesh(shape: Element, where: str) -> tuple[tuple[float, ...], str]:
    name = shape.get("filename", "").strip()
    if not name:
        raise InputError(f"{where}: mesh: has no filename")
    return (), name


def _sizes(values: tuple[float, ...], where: str) -> tuple[float, ...]:
    if min(values) <= 0.0:
        shown = ", ".join(f"{value:g}" for value in values)
        raise InputError(f"{where} = {shown}: must be above 0")
    return values


_SHAPES: dict[str, Callable[[Element, str], tuple[tuple[float, ...], str]]] = {
    "box": _box,
    "cylinder": _cylinder,
    "sphere": _sphere,
    "mesh": _mesh,
}


def refuse_missing_file(solid: Solid, path: Path) -> None:
    """Refuse a mesh whose file is not there; only ROS knows where ``package://`` leads.

    Raises:
        InputError: a mesh by file name, of which there is no file.
    """
    name = solid.mesh.removeprefix("file://")
    if not name or "://" in name:
        return
    try:
        found = (path.parent / name).is_file()
    except (OSError, ValueError):
        found = False
    if not found:
        raise InputError(f"{path}: link {solid.link!r}: mesh {solid.mesh[:120]!r}: no such file")


def tilt(direction: FloatArray, axis: FloatArray) -> float:
    """Return the angle between two unit vectors, either way round [rad]."""
    return math.acos(min(abs(float(direction @ axis)), 1.0))
