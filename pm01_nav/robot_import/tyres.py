# SPDX-License-Identifier: Apache-2.0
"""How large a wheel is, and where it touches the floor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pm01_nav.errors import InputError
from pm01_nav.robot_import.drive import Drive
from pm01_nav.robot_import.elements import Solid
from pm01_nav.robot_import.solids import Solids
from pm01_nav.robot_import.urdf import Joint, Urdf, tilt

TILT = 0.05
"""An axle turned by more than this away from y [rad] does not drive along x; 1.57 is no pi / 2."""
CONTACT = 0.98
"""What reaches out this part of a wheel's radius touches the floor."""


@dataclass(frozen=True)
class Tyre:
    """A wheel's size."""

    radius: float
    y: float
    """The middle of its contact with the floor, in the robot's frame [m]."""
    source: str
    """What the radius was read from."""


def find_tyre(urdf: Urdf, joint: Joint, drive: Drive, solids: Solids, radius: float | None) -> Tyre:
    """Measure a wheel: a cylinder or a ball, else the plugin's figure, else a mesh.

    ``radius`` is a person's own figure.

    Raises:
        InputError: nothing tells the radius.
    """
    links = urdf.lump(joint.child)
    groups = {
        name: [solid for solid in all_of_kind if solid.link in links]
        for name, all_of_kind in (("collision", urdf.collisions), ("visual", urdf.visuals))
    }
    seen = _round(urdf, joint, groups)
    # A mesh is read only where nothing simpler tells the size or the place.
    lost: list[str] = []
    if seen is None:
        seen = _mesh(urdf, joint, groups, solids, lost)
        named = drive.figures.get("radius")
        if named is not None:
            y = seen.y if seen is not None else float(urdf.places[joint.child].translation[1])
            seen = Tyre(named, y, "plugin of the drive")
    if radius is not None:
        y = seen.y if seen is not None else float(urdf.places[joint.child].translation[1])
        return Tyre(radius, y, "--wheel-radius")
    if seen is None:
        shapes = ", ".join(dict.fromkeys(s.kind for own in groups.values() for s in own))
        why = f" ({lost[0]})" if lost else ""
        raise InputError(
            f"{urdf.path}: link {joint.child!r}: its shape is {shapes or 'nothing'}{why}, which "
            "tells no radius; give --wheel-radius" + (" or --packages DIR" if lost else "")
        )
    return seen


def _round(urdf: Urdf, joint: Joint, groups: dict[str, list[Solid]]) -> Tyre | None:
    for name, own in groups.items():
        round_ones = [solid for solid in own if _is_wheel(solid, urdf.axis(joint))]
        if round_ones:
            tyre = max(round_ones, key=lambda solid: solid.size[0])
            source = f"{joint.child}, {tyre.kind} of its {name}"
            return Tyre(tyre.size[0], float(tyre.pose.translation[1]), source)
    return None


def _is_wheel(solid: Solid, axis: np.ndarray) -> bool:
    if solid.kind == "sphere":
        return True
    return solid.kind == "cylinder" and tilt(solid.pose.rotation[:, 2], axis) < TILT


def _mesh(
    urdf: Urdf, joint: Joint, groups: dict[str, list[Solid]], solids: Solids, lost: list[str]
) -> Tyre | None:
    """Measure how far a mesh reaches out from the wheel's axis, and where it does."""
    axis, origin = urdf.axis(joint), urdf.places[joint.child].translation
    for name, own in groups.items():
        clouds = []
        for solid in own:
            if solid.kind == "mesh":
                try:
                    clouds.append(solids.points(solid))
                except InputError as error:
                    lost.append(str(error))
        if clouds:
            points = np.concatenate(clouds) - origin
            along = points @ axis
            out = np.linalg.norm(points - np.outer(along, axis), axis=1)
            contact = along[out > CONTACT * out.max()]
            y = origin[1] + 0.5 * (contact.min() + contact.max()) * axis[1]
            return Tyre(float(out.max()), float(y), f"{joint.child}, mesh of its {name}")
    return None
