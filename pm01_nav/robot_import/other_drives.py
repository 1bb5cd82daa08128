# SPDX-License-Identifier: Apache-2.0
"""Recognise robots that are driven otherwise than by the difference of two sides."""

from __future__ import annotations

from collections.abc import Sequence

from pm01_nav.errors import InputError
from pm01_nav.robot_import.drive import Drive
from pm01_nav.robot_import.urdf import Joint, Urdf

CASTER_WORDS = ("caster", "castor", "swivel")
ROLLER_WORDS = ("mecanum", "omni_wheel", "omniwheel", "omni-wheel", "swedish")
HOW = "only differential and skid steering can be imported; --wheels LEFT RIGHT takes it for one"
BY_HAND = f"{HOW}, or write its YAML by hand, with drive: omnidirectional"


def refuse_other_drives(urdf: Urdf, drive: Drive, wheels: Sequence[Joint]) -> None:
    """Refuse mecanum and omni wheels, steered wheels, and plugins that drive such robots.

    Raises:
        InputError: it is such a robot; it says by what one sees that.
    """
    if drive.kind == "holonomic":
        what = "an omnidirectional robot (mecanum or omni wheels)"
        raise InputError(f"{drive.where}: {what}: {BY_HAND}")
    if drive.kind == "steered":
        raise InputError(f"{drive.where}: a car-like robot (Ackermann steering): {HOW}")
    # A plugin of a differential drive knows better than a shape.
    if drive.kind == "differential":
        return
    for joint in wheels:
        word = _roller(urdf, joint)
        if word:
            raise InputError(
                f"{urdf.path}: joint {joint.name[:60]!r}: an omnidirectional robot ({word} "
                f"wheels): {BY_HAND}"
            )
    steering = [joint for joint in urdf.joints.values() if _steers(urdf, joint)]
    if len(steering) > 1:
        raise InputError(
            f"{urdf.path}: a car-like robot (Ackermann steering): joint {steering[0].name[:60]!r} "
            f"steers: {HOW}"
        )


def _roller(urdf: Urdf, joint: Joint) -> str:
    """Return the word by which a wheel with rollers is known."""
    if joint.kind != "fixed" and not joint.turns:
        return ""
    links = urdf.lump(joint.child)
    names = [joint.name, joint.child]
    names += [s.mesh for s in (*urdf.collisions, *urdf.visuals) if s.link in links]
    for word in ROLLER_WORDS:
        if any(word in name.lower() for name in names):
            return word.split("wheel")[0].rstrip("_-")
    return ""


def has_oblique_friction(urdf: Urdf, wheels: Sequence[str]) -> bool:
    """Tell whether Gazebo lets wheels roll askew, as mecanum wheels do; some only skid so."""
    links = {link for name in wheels for link in urdf.lump(urdf.joints[name].child)}
    return any(
        _oblique((element.text or "").split())
        for gazebo in urdf.root.findall("gazebo")
        if gazebo.get("reference") in links
        for element in gazebo.iter("fdir1")
    )


def _oblique(words: list[str]) -> bool:
    try:
        sizes = sorted(abs(float(word)) for word in words)
    except ValueError:
        return False
    return len(sizes) == 3 and sizes[0] < 0.1 * sizes[2] and sizes[1] > 0.5 * sizes[2] > 0.0


def _steers(urdf: Urdf, joint: Joint) -> bool:
    """Tell whether a joint is called so, or is a hinge with a limit that turns a wheel."""
    if joint.kind == "fixed" or any(word in joint.name.lower() for word in CASTER_WORDS):
        return False
    if "steer" in joint.name.lower():
        return True
    if not urdf.is_hinge(joint):
        return False
    carried = urdf.lump(joint.child)
    carries_wheel = any(
        inner.turns and not urdf.is_hinge(inner) and "wheel" in inner.name.lower()
        for inner in urdf.joints.values()
        if inner.parent in carried
    )
    return not joint.turns and (carries_wheel or "wheel" in joint.name.lower())
