# SPDX-License-Identifier: Apache-2.0
"""Numbers, poses and solids in the elements of a URDF."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from pm01_nav.errors import InputError
from pm01_nav.worlds.sdf_pose import Transform, from_euler

LARGEST = 1e4
"""Larger numbers are refused: no robot is ten kilometres long."""


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
    scale: tuple[float, ...] = (1.0, 1.0, 1.0)
    """What a mesh is multiplied by."""


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


def read_solids(link: Element, tag: str, place: Transform, path: Path) -> list[Solid]:
    """Read the collisions or the visuals of a link that stands at ``place``.

    Raises:
        InputError: one has no shape, or one that cannot be.
    """
    name, solids = link.get("name", ""), []
    for element in link.findall(tag):
        where = f"{path}: link {name!r}: {tag}"
        shapes = [shape for geometry in element.findall("geometry") for shape in geometry]
        if len(shapes) != 1:
            raise InputError(f"{where}: must have one shape, not {len(shapes)}")
        kind, pose = str(shapes[0].tag), place.apply(origin_of(element, where))
        if kind == "mesh":
            solids.append(Solid(name, kind, (), pose, *_mesh(shapes[0], where)))
        elif kind in _SIZES:
            solids.append(Solid(name, kind, _SIZES[kind](shapes[0], where), pose))
        else:
            allowed = ", ".join((*_SIZES, "mesh"))
            raise InputError(f"{where}: <{kind[:40]}>: allowed: {allowed}")
    return solids


def _box(shape: Element, where: str) -> tuple[float, ...]:
    return _sizes(numbers(shape, "size", 3, f"{where}: box", None), f"{where}: box: size")


def _cylinder(shape: Element, where: str) -> tuple[float, ...]:
    sizes = [number(shape, key, f"{where}: {shape.tag}") for key in ("radius", "length")]
    return _sizes(tuple(sizes), f"{where}: {shape.tag}: radius, length")


def _sphere(shape: Element, where: str) -> tuple[float, ...]:
    radius = number(shape, "radius", f"{where}: sphere")
    return _sizes((radius,), f"{where}: sphere: radius")


def _mesh(shape: Element, where: str) -> tuple[str, tuple[float, ...]]:
    name = shape.get("filename", "").strip()
    if not name:
        raise InputError(f"{where}: mesh: has no filename")
    scale = numbers(shape, "scale", 3, f"{where}: mesh", (1.0, 1.0, 1.0))
    if 0.0 in scale:
        raise InputError(f"{where}: mesh: scale must not be 0")
    return name, scale


def _sizes(values: tuple[float, ...], where: str) -> tuple[float, ...]:
    if min(values) <= 0.0:
        shown = ", ".join(f"{value:g}" for value in values)
        raise InputError(f"{where} = {shown}: must be above 0")
    return values


_SIZES: dict[str, Callable[[Element, str], tuple[float, ...]]] = {
    "box": _box,
    "cylinder": _cylinder,
    "sphere": _sphere,
}
