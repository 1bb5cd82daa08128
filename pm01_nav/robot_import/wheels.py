# SPDX-License-Identifier: Apache-2.0
"""Find the driven wheels of a URDF: where the axle lies, how wide it is, how large the wheels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pm01_nav.errors import InputError
from pm01_nav.robot_import.gazebo import Drive
from pm01_nav.robot_import.urdf import Joint, Solid, Urdf, refuse_missing_file, tilt

TILT = 0.05
"""An axle turned by more than this away from y [rad] does not drive along x; 1.57 is no pi / 2."""
SAME_AXLE = 0.005
"""Two wheels on one axle lie at the same x and z within this [m]."""
ALIKE = 0.01
"""Several axles count as one, between them, if their figures differ by less than this part."""


@dataclass(frozen=True)
class Wheel:
    """A driven wheel in the robot's frame."""

    joint: Joint
    x: float
    y: float
    """Of its contact with the floor [m]."""
    z: float
    radius: float
    source: str
    """What the radius was read from."""


@dataclass(frozen=True)
class Axle:
    """The driven wheels together."""

    x: float
    """Its middle in the robot's frame [m]."""
    y: float
    radius: float
    separation: float
    velocity: float | None
    """Fastest turn of the wheels [rad/s], None where the file says nothing."""
    source: str
    joints: tuple[str, ...]


def find_axle(
    urdf: Urdf, drive: Drive, names: tuple[str, str] | None, radius: float | None
) -> Axle:
    """Find the wheels by name, by the plugin that drives them, or by their joints.

    Raises:
        InputError: there are none, several that differ, or their radius is not to be seen.
    """
    if names is not None:
        pairs = [(_by_name(urdf, names[0], "--wheels"), _by_name(urdf, names[1], "--wheels"))]
    elif drive.joints[0] and len(drive.joints[0]) == len(drive.joints[1]):
        named = zip(*drive.joints, strict=True)
        pairs = [(_by_name(urdf, a, drive.where), _by_name(urdf, b, drive.where)) for a, b in named]
    else:
        pairs = _pairs(urdf)
    wheels = [
        (_wheel(urdf, left, drive, radius), _wheel(urdf, right, drive, radius))
        for left, right in pairs
    ]
    return _axle(urdf, wheels)


def _by_name(urdf: Urdf, name: str, where: str) -> Joint:
    joint = urdf.joints.get(name)
    if joint is None:
        raise InputError(f"{where}: {name[:60]!r}: no such joint; there are: {_list(urdf)}")
    if joint.kind not in ("continuous", "revolute"):
        raise InputError(f"{where}: {name[:60]!r}: is {joint.kind}; a wheel's joint is continuous")
    return joint


def _list(urdf: Urdf) -> str:
    turning = [repr(j.name[:60]) for j in urdf.joints.values() if j.kind == "continuous"]
    return ", ".join(turning[:8]) or "no continuous joints"


def _pairs(urdf: Urdf) -> list[tuple[Joint, Joint]]:
    """Return left and right of each two continuous joints on a common axis along y."""
    moved = {j.child: j for j in urdf.joints.values()}
    turning = [
        joint
        for joint in urdf.joints.values()
        if joint.kind == "continuous" and _is_across(urdf, joint) and not _hangs(joint, moved)
    ]
    places = {joint.name: urdf.places[joint.child].translation for joint in turning}
    pairs = []
    for left in turning:
        for right in turning:
            across = places[left.name] - places[right.name]
            if across[1] > SAME_AXLE and max(abs(across[0]), abs(across[2])) < SAME_AXLE:
                pairs.append((left, right))
    if not pairs:
        raise InputError(
            f"{urdf.path}: has no two driven wheels: continuous joints on a common axis along y; "
            f"there are: {_list(urdf)}; name them with --wheels LEFT RIGHT"
        )
    return pairs


def _is_across(urdf: Urdf, joint: Joint) -> bool:
    axis = urdf.places[joint.child].rotation @ joint.axis
    return tilt(axis, np.array([0.0, 1.0, 0.0])) < TILT


def _hangs(joint: Joint, moved: dict[str, Joint]) -> bool:
    """Tell whether a wheel hangs under another moving joint, as a caster's does."""
    above = moved.get(joint.parent)
    while above is not None:
        if above.kind != "fixed":
            return True
        above = moved.get(above.parent)
    return False


def _wheel(urdf: Urdf, joint: Joint, drive: Drive, radius: float | None) -> Wheel:
    place = urdf.places[joint.child].translation
    x, y, z = place.tolist()
    if radius is not None:
        return Wheel(joint, x, y, z, radius, "--wheel-radius")
    links = urdf.lump(joint.child)
    seen: list[str] = []
    for name, solids in (("collision", urdf.collisions), ("visual", urdf.visuals)):
        own = [solid for solid in solids if solid.link in links]
        seen.extend(solid.kind for solid in own)
        round_ones = [solid for solid in own if _is_wheel(solid)]
        if round_ones:
            tyre = max(round_ones, key=lambda solid: solid.size[0])
            source = f"{joint.child}, {tyre.kind} of its {name}"
            return Wheel(joint, x, float(tyre.pose.translation[1]), z, tyre.size[0], source)
    if "radius" in drive.figures:
        return Wheel(joint, x, y, z, drive.figures["radius"], "plugin of the drive")
    for solid in (*urdf.collisions, *urdf.visuals):
        if solid.link in links:
            refuse_missing_file(solid, urdf.path)
    shapes = ", ".join(dict.fromkeys(seen)) or "nothing"
    raise InputError(
        f"{urdf.path}: link {joint.child!r}: its shape is {shapes}, which tells no radius; "
        "give --wheel-radius"
    )


def _is_wheel(solid: Solid) -> bool:
    if solid.kind == "sphere":
        return True
    return solid.kind == "cylinder" and tilt(solid.pose.rotation[:, 2], np.array([0, 1, 0])) < TILT


def _axle(urdf: Urdf, wheels: list[tuple[Wheel, Wheel]]) -> Axle:
    sides = [(a, b) if a.y > b.y else (b, a) for a, b in wheels]
    separations = [left.y - right.y for left, right in sides]
    radii = [wheel.radius for pair in sides for wheel in pair]
    joints = tuple(wheel.joint.name for pair in sides for wheel in pair)
    if min(separations) <= 0.0:
        raise InputError(f"{urdf.path}: joints {joints[0]!r} and {joints[1]!r}: lie at the same y")
    for values, what in ((separations, "distance"), (radii, "radius")):
        if max(values) - min(values) > ALIKE * abs(max(values)):
            listed = ", ".join(repr(name[:60]) for name in joints[:8])
            raise InputError(
                f"{urdf.path}: the wheels differ in their {what} ({listed}); "
                "name the driven ones with --wheels LEFT RIGHT"
            )
    everyone = [wheel for pair in sides for wheel in pair]
    speeds = [w.joint.velocity for w in everyone if w.joint.velocity is not None]
    return Axle(
        x=float(np.mean([wheel.x for wheel in everyone])),
        y=float(np.mean([wheel.y for wheel in everyone])),
        radius=float(np.mean(radii)),
        separation=float(np.mean(separations)),
        velocity=min(speeds) if speeds else None,
        source=everyone[0].source,
        joints=joints,
    )
