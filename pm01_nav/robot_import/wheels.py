# SPDX-License-Identifier: Apache-2.0
"""Find the driven wheels of a URDF: where the axle lies, how wide it is, how large the wheels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pm01_nav.errors import InputError
from pm01_nav.robot_import.drive import Drive
from pm01_nav.robot_import.other_drives import CASTER_WORDS, refuse_other_drives
from pm01_nav.robot_import.solids import Solids
from pm01_nav.robot_import.tyres import TILT, Tyre, find_tyre
from pm01_nav.robot_import.urdf import Joint, Urdf, tilt

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
    tyre: Tyre


@dataclass(frozen=True)
class Axle:
    """The driven wheels together."""

    x: float
    """Its middle in the robot's frame [m]."""
    y: float
    floor: float
    """Height of the floor in the robot's frame [m]."""
    radius: float
    separation: float
    """Between the wheels' contacts, by their places [m]."""
    velocity: float | None
    """Fastest turn of the wheels [rad/s], None where the file says nothing."""
    source: str
    joints: tuple[str, ...]

    @property
    def skids(self) -> bool:
        """Tell whether its wheels slide sideways in a turn."""
        return len(self.joints) > 2


def find_axle(
    urdf: Urdf,
    drive: Drive,
    solids: Solids,
    names: tuple[str, str] | None = None,
    radius: float | None = None,
) -> Axle:
    """Find the wheels by name, by the plugin that drives them, or by their joints.

    Raises:
        InputError: it is no differential drive, there are no wheels, several that differ, or their
            radius is not to be seen.
    """
    if names is not None:
        joints = [_by_name(urdf, name, "--wheels") for name in names]
    elif all(drive.joints):
        joints = [_by_name(urdf, name, drive.where) for side in drive.joints for name in side]
    else:
        joints = _by_geometry(urdf, drive)
    if names is None:
        refuse_other_drives(urdf, drive, joints)
    wheels = []
    for joint in joints:
        x, _, z = urdf.places[joint.child].translation.tolist()
        tyre = find_tyre(urdf, joint, drive, solids, radius)
        wheels.append(Wheel(joint, x, tyre.y, z, tyre))
    return _axle(urdf, wheels)


def _by_name(urdf: Urdf, name: str, where: str) -> Joint:
    joint = urdf.joints.get(name)
    if joint is None:
        raise InputError(f"{where}: {name[:60]!r}: no such joint; there are: {_list(urdf)}")
    if joint.kind not in ("continuous", "revolute"):
        raise InputError(f"{where}: {name[:60]!r}: is {joint.kind}; a wheel's joint is continuous")
    return joint


def _list(urdf: Urdf) -> str:
    turning = [repr(j.name[:60]) for j in urdf.joints.values() if j.turns]
    return ", ".join(turning[:8]) or "no continuous joints"


def _by_geometry(urdf: Urdf, drive: Drive) -> list[Joint]:
    """Return left and right of each two joints that turn about a common axis along y.

    Where controllers are named, only what they turn counts.
    """
    turning = [joint for joint in urdf.joints.values() if _is_wheel(urdf, joint)]
    pairs = _pairs(urdf, turning)
    driven = [pair for pair in pairs if all(joint.name in drive.driven for joint in pair)]
    if not pairs:
        refuse_other_drives(urdf, drive, list(urdf.joints.values()))
        raise InputError(
            f"{urdf.path}: has no two driven wheels: continuous joints on a common axis along y; "
            f"there are: {_list(urdf)}; name them with --wheels LEFT RIGHT"
        )
    names = dict.fromkeys(joint.name for pair in driven or pairs for joint in pair)
    return [urdf.joints[name] for name in names]


def _is_wheel(urdf: Urdf, joint: Joint) -> bool:
    """Tell whether a joint turns about y and is no caster's, which hangs under a hinge."""
    if not joint.turns or tilt(urdf.axis(joint), np.array([0.0, 1.0, 0.0])) > TILT:
        return False
    if any(word in joint.name.lower() for word in CASTER_WORDS):
        return False
    return not any(urdf.is_hinge(above) for above in urdf.above(joint.parent))


def _pairs(urdf: Urdf, turning: Sequence[Joint]) -> list[tuple[Joint, Joint]]:
    """Return the leftmost and the rightmost joint on each axis."""
    places = {joint.name: urdf.places[joint.child].translation for joint in turning}
    pairs: dict[tuple[str, str], tuple[Joint, Joint]] = {}
    for joint in turning:
        off = {other.name: places[other.name] - places[joint.name] for other in turning}
        along = [o for o in turning if max(abs(off[o.name][[0, 2]])) < SAME_AXLE]
        left = max(along, key=lambda o: places[o.name][1])
        right = min(along, key=lambda o: places[o.name][1])
        if places[left.name][1] - places[right.name][1] > SAME_AXLE:
            pairs[left.name, right.name] = (left, right)
    return list(pairs.values())


def _axle(urdf: Urdf, wheels: list[Wheel]) -> Axle:
    joints = tuple(wheel.joint.name for wheel in wheels)
    middle = 0.5 * (min(w.y for w in wheels) + max(w.y for w in wheels))
    left = [wheel for wheel in wheels if wheel.y > middle]
    right = [wheel for wheel in wheels if wheel.y < middle]
    if not left or not right or len(left) + len(right) < len(wheels):
        raise InputError(f"{urdf.path}: joints {joints[0]!r} and {joints[1]!r}: lie at the same y")
    radii = [wheel.tyre.radius for wheel in wheels]
    sides = [[wheel.y - middle for wheel in left], [middle - wheel.y for wheel in right]]
    for values, what in ((sides[0], "distance"), (sides[1], "distance"), (radii, "radius")):
        if max(values) - min(values) > ALIKE * abs(max(values)):
            listed = ", ".join(repr(name[:60]) for name in joints[:8])
            raise InputError(
                f"{urdf.path}: the wheels differ in their {what} ({listed}); "
                "name the driven ones with --wheels LEFT RIGHT"
            )
    speeds = [w.joint.velocity for w in wheels if w.joint.velocity is not None]
    ys = [float(np.mean([wheel.y for wheel in side])) for side in (left, right)]
    return Axle(
        x=float(np.mean([wheel.x for wheel in wheels])),
        y=float(np.mean(ys)),
        floor=float(np.mean([wheel.z - wheel.tyre.radius for wheel in wheels])),
        radius=float(np.mean(radii)),
        separation=ys[0] - ys[1],
        velocity=min(speeds) if speeds else None,
        source=wheels[0].tyre.source,
        joints=joints,
    )
