# SPDX-License-Identifier: Apache-2.0
"""Read an SDF actor with a looped trajectory as a disc that moves along a spline."""

from __future__ import annotations

from xml.etree.ElementTree import Element

import numpy as np

from pm01_nav.errors import InputError
from pm01_nav.worlds.mover import Mover
from pm01_nav.worlds.sdf_pose import Transform, numbers, positive, read_pose
from pm01_nav.worlds.sdf_shapes import UnsupportedError

PERSON_RADIUS = 0.3
"""Of an actor that has a skin but no cylinder to tell its size [m]."""


def read_actor(actor: Element, where: str) -> Mover:
    """Read the one trajectory of an ``<actor>``.

    Gazebo moves an actor along a Catmull-Rom spline through its waypoints, which is what a
    ``spline`` mover follows. Its size is that of the cylinder in its link, if it has one.

    Raises:
        UnsupportedError: it moves in another way; the text says which.
        InputError: a number is wrong.
    """
    where = f"{where}: actor {actor.get('name')!r}"
    script = actor.find("script")
    trajectories = [] if script is None else script.findall("trajectory")
    if script is None or len(trajectories) != 1:
        raise UnsupportedError(f"{len(trajectories)} trajectories instead of one")
    if (script.findtext("loop") or "true").strip() not in ("true", "1"):
        raise UnsupportedError("does not loop")
    for element, name in ((script.find("delay_start"), "delay_start"), _tension(trajectories[0])):
        if element is not None and numbers(element, 1, f"{where}: {name}")[0] != 0.0:
            raise UnsupportedError(f"{name} is not 0")
    if not _is_identity(read_pose(actor, where, "world")):
        raise UnsupportedError("its own pose is not 0")
    times, points = [], []
    for waypoint in trajectories[0].findall("waypoint"):
        times += numbers(waypoint.find("time"), 1, f"{where}: waypoint: time")
        points.append(read_pose(waypoint, f"{where}: waypoint", "world").translation[:2])
    if len(times) < 2 or times[0] != 0.0 or (np.diff(times) <= 0.0).any():
        raise UnsupportedError("its waypoints are not 2 or more at times that rise from 0")
    try:
        return Mover("spline", _radius(actor, where), np.array(points), times=np.array(times))
    except InputError as error:
        raise InputError(f"{where}: {error}") from error


def _tension(trajectory: Element) -> tuple[Element | None, str]:
    tension = trajectory.get("tension")
    if tension is None:
        return None, "tension"
    element = Element("tension")
    element.text = tension
    return element, "tension"


def _is_identity(pose: Transform) -> bool:
    return bool((pose.translation[:2] == 0.0).all() and (pose.rotation == np.eye(3)).all())


def _radius(actor: Element, where: str) -> float:
    for part in ("collision", "visual"):
        radius = actor.find(f"link/{part}/geometry/cylinder/radius")
        if radius is not None:
            return positive(radius, 1, f"{where}: radius")[0]
    return PERSON_RADIUS
