# SPDX-License-Identifier: Apache-2.0
"""A URDF as links in one frame: what is read, and what is refused."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pm01_nav.documents import parse_xml
from pm01_nav.errors import InputError
from pm01_nav.robot_import.elements import Solid, number, numbers, origin_of, read_solids
from pm01_nav.robot_import.expansion import expand, has_macros
from pm01_nav.robot_import.packages import Packages
from pm01_nav.worlds.sdf_pose import IDENTITY, Transform

FloatArray = NDArray[np.float64]

MOST = {"link": 2000, "joint": 2000, "link/collision": 5000, "link/visual": 5000}
"""More are refused: what is a robot has a tenth of them, and some steps take their square."""
JOINT_TYPES = ("fixed", "continuous", "revolute", "prismatic", "floating", "planar")
BASE = "base_link"
MOMENTS = ("ixx", "iyy", "izz")
TURN = 6.2
"""A revolute joint that may turn by more than this [rad] is as good as a continuous one."""
VERTICAL = 0.7
"""An axis whose z is more than this is rather a hinge than an axle."""


@dataclass(frozen=True)
class Joint:
    """A joint at zero; one that mimics another at its offset."""

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
    span: float
    """From its lower to its upper limit [rad or m]; infinite for a continuous joint."""

    @property
    def turns(self) -> bool:
        """Tell whether it turns without end, as a wheel must: some write limits far away."""
        return self.kind == "continuous" or (self.kind == "revolute" and self.span > TURN)


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
    massless: tuple[str, ...]
    """Links that move and have no mass or moment of inertia."""

    def axis(self, joint: Joint) -> FloatArray:
        """Return a joint's axis in the robot's frame, shape (3,)."""
        return self.places[joint.child].rotation @ joint.axis

    def is_hinge(self, joint: Joint) -> bool:
        """Tell whether a joint turns about a vertical axis."""
        turning = joint.kind in ("continuous", "revolute")
        return turning and abs(float(self.axis(joint)[2])) > VERTICAL

    def above(self, link: str) -> list[Joint]:
        """Return the joints that carry a link, from itself up to the root."""
        moved = {joint.child: joint for joint in self.joints.values()}
        chain = []
        while link in moved:
            chain.append(moved[link])
            link = moved[link].parent
        return chain

    def below(self, link: str) -> set[str]:
        """Name a link and all that it carries."""
        children: dict[str, list[str]] = {}
        for joint in self.joints.values():
            children.setdefault(joint.parent, []).append(joint.child)
        found, fresh = {link}, [link]
        while fresh:
            inside = children.get(fresh.pop(), [])
            found.update(inside)
            fresh.extend(inside)
        return found

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


def read_urdf(path: Path, packages: Packages, arguments: Mapping[str, str]) -> Urdf:
    """Read a URDF, or a xacro file with its ``arguments``.

    Raises:
        InputError: it is no whole XML, has macros that cannot be expanded, links that do not hang
            together, or numbers that cannot be.
    """
    root = parse_xml(path)
    if root.tag == "robot" and has_macros(root):
        root = expand(path, packages, arguments)
    if root.tag != "robot":
        raise InputError(f"{path}: its outermost element is <{root.tag[:60]}>; a URDF has <robot>")
    _refuse_too_many(root, path)
    links = _named(root, "link", path)
    if not links:
        raise InputError(f"{path}: has no links")
    joints = {
        name: _read_joint(element, path) for name, element in _named(root, "joint", path).items()
    }
    places = _place_links(set(links), joints, path)
    solids = {
        kind: tuple(
            solid
            for name, link in links.items()
            for solid in read_solids(link, kind, places[name], path)
        )
        for kind in ("collision", "visual")
    }
    return Urdf(
        path=path,
        name=root.get("name", ""),
        root=root,
        joints=joints,
        places=places,
        collisions=solids["collision"],
        visuals=solids["visual"],
        massless=_massless(links, joints, path),
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
    axis = axis / max(length, 1e-6)
    pose = origin_of(element, where).apply(_motion(kind, axis, _offset(element, where)))
    span = _span(limit, kind, where)
    return Joint(name, kind, ends[0], ends[1], pose, axis, velocity or None, span)


def _offset(element: Element, where: str) -> float:
    mimic = element.find("mimic")
    return 0.0 if mimic is None else number(mimic, "offset", f"{where}: mimic", 0.0)


def _motion(kind: str, axis: FloatArray, by: float) -> Transform:
    """Return what a joint at ``by`` [rad or m] adds to its origin."""
    if by == 0.0 or kind not in ("continuous", "revolute", "prismatic"):
        return IDENTITY
    if kind == "prismatic":
        return Transform(np.eye(3), by * axis)
    return Transform(Rotation.from_rotvec(by * axis).as_matrix(), np.zeros(3))


def _span(limit: Element | None, kind: str, where: str) -> float:
    """Return how far a joint may move; files that mean no limit write 1e16."""
    if kind == "continuous":
        return math.inf
    if limit is None:
        return 0.0
    try:
        span = float(limit.get("upper", "0")) - float(limit.get("lower", "0"))
    except ValueError:
        span = math.nan
    if math.isnan(span):
        raise InputError(f"{where}: limit: lower and upper must be numbers")
    return span


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


def _massless(links: dict[str, Element], joints: dict[str, Joint], path: Path) -> tuple[str, ...]:
    """Name moving links that neither have mass and inertia nor a link fixed to them that has."""
    heavy = {name for name, link in links.items() if _has_inertia(link, f"{path}: link {name!r}")}
    carriers = set(heavy)
    for _ in range(len(joints)):
        more = {j.parent for j in joints.values() if j.kind == "fixed" and j.child in carriers}
        if more <= carriers:
            break
        carriers |= more
    return tuple(
        joint.child
        for joint in joints.values()
        if joint.kind != "fixed" and joint.child not in carriers
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


def tilt(direction: FloatArray, axis: FloatArray) -> float:
    """Return the angle between two unit vectors, either way round [rad]."""
    return math.acos(min(abs(float(direction @ axis)), 1.0))
