# SPDX-License-Identifier: Apache-2.0
"""The footprint of a URDF: the convex hull of its solids, seen from above."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from pm01_nav.errors import InputError
from pm01_nav.geometry import is_convex_counter_clockwise
from pm01_nav.robot_import.elements import Solid, number
from pm01_nav.robot_import.solids import Solids
from pm01_nav.robot_import.urdf import Urdf
from pm01_nav.robot_import.wheels import Axle

FloatArray = NDArray[np.float64]

ROUND = 0.97
"""A hull whose nearest point is so much of its farthest is a circle; a 12-gon is just not."""
DIGITS = 4
"""Corners are rounded to 0.1 mm, and what then lies on an edge is dropped."""
NOTICEABLE = 0.02
"""Moving parts that reach farther than the rest by this [m] are worth a word."""


@dataclass(frozen=True)
class Outline:
    """A robot's footprint around the middle of its axle."""

    footprint: dict[str, Any]
    height: float | None
    """Of its highest point above the floor [m]."""
    source: str
    warnings: tuple[str, ...]


def find_outline(
    urdf: Urdf, solids: Solids, axle: Axle, radius: float | None, without: tuple[str, ...] = ()
) -> Outline:
    """Return the hull of what stands above the floor, but for the links ``without`` and below.

    Raises:
        InputError: there is no shape to take it from, the body's own cannot be read, or the axle
            lies outside of it.
    """
    if radius is not None:
        footprint = {"shape": "circle", "radius": radius}
        return Outline(footprint, None, "--footprint-radius", ())
    shapes, kind = _chosen(urdf, without)
    points, lost = _points(urdf, solids, shapes, axle.floor)
    together = [p for of_link in points.values() for p in of_link]
    if not together:
        raise InputError(
            f"{urdf.path}: has no box, cylinder, sphere or readable mesh to take a footprint "
            f"from{_first(lost)}; give --packages DIR or --footprint-radius"
        )
    _refuse_lost_body(urdf, points, lost)
    cloud = np.concatenate(together) - np.array([axle.x, axle.y, axle.floor])
    warnings = [_share(urdf, shapes, solid, why) for solid, why in lost]
    warnings += _moving(urdf, points, axle)
    read = "shapes and meshes" if any(s.kind == "mesh" for s in shapes) else "shapes"
    return Outline(
        _footprint(cloud[:, :2], urdf),
        float(cloud[:, 2].max()),
        f"hull of the {kind} {read}" + (f", without {', '.join(without)}" if without else ""),
        tuple(warnings),
    )


def _chosen(urdf: Urdf, without: tuple[str, ...]) -> tuple[list[Solid], str]:
    """Return the solids that make the footprint: collisions, or visuals where nothing collides."""
    dropped: set[str] = set()
    for link in without:
        if link not in urdf.places:
            raise InputError(f"{urdf.path}: --without {link[:60]!r}: no such link")
        dropped |= urdf.below(link)
    solids, kind = urdf.collisions or urdf.visuals, "collision" if urdf.collisions else "visual"
    body = _body_links(urdf)
    if not any(solid.link in body for solid in solids):
        # Wheels alone collide: the body is what one sees of it.
        solids = (*solids, *(solid for solid in urdf.visuals if solid.link in body))
        kind = "collision and visual" if urdf.collisions else kind
    return [solid for solid in solids if solid.link not in dropped], kind


def _body_links(urdf: Urdf) -> set[str]:
    """Name the links that are fixed to the root."""
    children = {joint.child for joint in urdf.joints.values()}
    (root,) = (link for link in urdf.places if link not in children)
    return urdf.lump(root)


def _points(
    urdf: Urdf, solids: Solids, shapes: list[Solid], floor: float
) -> tuple[dict[str, list[FloatArray]], list[tuple[Solid, str]]]:
    """Return the points of each link above the floor, and what could not be read and why."""
    points: dict[str, list[FloatArray]] = {}
    lost = []
    for solid in shapes:
        try:
            found = solids.points_above(solid, floor)
        except InputError as error:
            lost.append((solid, str(error)))
            continue
        if len(found):
            points.setdefault(solid.link, []).append(found)
    return points, lost


def _first(lost: list[tuple[Solid, str]]) -> str:
    return f" ({lost[0][1]})" if lost else ""


def _refuse_lost_body(
    urdf: Urdf, points: dict[str, list[FloatArray]], lost: list[tuple[Solid, str]]
) -> None:
    body = _body_links(urdf)
    missing = [(solid, why) for solid, why in lost if solid.link in body]
    if missing and not any(link in body for link in points):
        solid, why = missing[0]
        raise InputError(
            f"{urdf.path}: link {solid.link!r}: {why}, and nothing else shows the body; "
            "give --packages DIR or --footprint-radius"
        )


def _share(urdf: Urdf, shapes: list[Solid], solid: Solid, why: str) -> str:
    """Say what part of the robot a lost solid is."""
    text = f"link {solid.link!r}: {why}: left out of the footprint, 1 of {len(shapes)} shapes"
    masses: dict[str, float] = {}
    for link in urdf.root.findall("link"):
        mass = link.find("inertial/mass")
        if mass is not None:
            masses[link.get("name", "")] = number(mass, "value", f"{urdf.path}: mass")
    total = sum(masses.values())
    if total > 0.0 and solid.link in masses:
        text += f"; its link has {100.0 * masses[solid.link] / total:.0f} % of the mass"
    return text


def _moving(urdf: Urdf, points: dict[str, list[FloatArray]], axle: Axle) -> list[str]:
    """Warn of arms and the like that reach beyond the rest where they stand at zero."""

    def reach(links: set[str]) -> float:
        inside = [p[:, :2] for link in links for p in points.get(link, [])]
        middle = np.array([axle.x, axle.y])
        return max((float(np.linalg.norm(p - middle, axis=1).max()) for p in inside), default=0.0)

    resting = _body_links(urdf) | {
        link for joint in axle.joints for link in urdf.below(urdf.joints[joint].child)
    }
    far = reach(resting)
    arms = [
        joint.child
        for joint in urdf.joints.values()
        if joint.kind != "fixed" and joint.parent in resting and joint.child not in resting
    ]
    return [
        f"link {link!r} moves and reaches {out:.2f} m where it stands at zero, the rest {far:.2f} "
        f"m: --without {link} leaves it out of the footprint"
        for link in arms
        if (out := reach(urdf.below(link))) > far + NOTICEABLE
    ]


def _footprint(points: FloatArray, urdf: Urdf) -> dict[str, Any]:
    # Rounded corners may lie on an edge, which only a second hull finds.
    vertices = _hull(np.round(_hull(points), DIGITS))
    if len(vertices) < 3:
        raise InputError(f"{urdf.path}: its shapes cover no area; give --footprint-radius")
    if not is_convex_counter_clockwise(vertices):
        raise InputError(
            f"{urdf.path}: the middle of the axle lies outside of the footprint that its shapes "
            "make; give --footprint-radius"
        )
    edges = np.roll(vertices, -1, axis=0) - vertices
    cross = vertices[:, 0] * edges[:, 1] - vertices[:, 1] * edges[:, 0]
    nearest = float((cross / np.linalg.norm(edges, axis=1)).min())
    farthest = float(np.linalg.norm(points, axis=1).max())
    if nearest > ROUND * farthest:
        return {"shape": "circle", "radius": round(farthest, DIGITS)}
    return {"shape": "polygon", "vertices": [(float(x), float(y)) for x, y in vertices]}


def _hull(points: FloatArray) -> FloatArray:
    """Return the corners of the hull, counter-clockwise; none if it has no area."""
    try:
        return points[ConvexHull(points).vertices]
    except (QhullError, ValueError):
        return np.zeros((0, 2))
