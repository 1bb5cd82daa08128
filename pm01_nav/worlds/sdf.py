# SPDX-License-Identifier: Apache-2.0
"""Read SDF worlds of Gazebo classic and gz-sim as discs, polygons and moving discs."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from pm01_nav.documents import parse_xml
from pm01_nav.errors import InputError
from pm01_nav.worlds.mover import Mover
from pm01_nav.worlds.reading import Reading, tell
from pm01_nav.worlds.sdf_actor import read_actor
from pm01_nav.worlds.sdf_include import ModelFolders
from pm01_nav.worlds.sdf_shapes import (
    IDENTITY,
    Shape,
    Transform,
    UnsupportedError,
    cover,
    numbers,
    read_pose,
)
from pm01_nav.worlds.world import MAX_OBSTACLES, World

FloatArray = NDArray[np.float64]

NAMESPACE = "urn:pm01-nav:world"
"""Of our own elements: bounds, start, start_area and goal_area, which SDF has no place for."""
BAND = (0.0, 0.5)
"""Heights that the robot or its lidar can meet [m]."""
MARGIN = 1.0
"""Bounds reach this far around the obstacles where the file does not give them [m]."""
MAX_INCLUDE_DEPTH = 8


class Place(NamedTuple):
    """Where an element stands, for poses and for messages."""

    pose: Transform
    where: str
    file: Path
    depth: int
    """Files that include each other, up to here."""


@dataclass
class _Scene:
    """What has been read so far."""

    folders: ModelFolders
    band: tuple[float, float]
    discs: list[tuple[float, float, float]] = field(default_factory=list)
    polygons: list[FloatArray] = field(default_factory=list)
    movers: list[Mover] = field(default_factory=list)
    skipped: list[str] = field(default_factory=list)


def read_sdf_world(path: str | Path, **options: Any) -> World:
    """Read an SDF world like ``read_sdf``, and log what was left out.

    Raises:
        InputError: as ``read_sdf``.
    """
    return tell(read_sdf(path, **options))


def read_sdf(
    path: str | Path,
    *,
    model_folders: Iterable[str | Path] = (),
    z_min: float = BAND[0],
    z_max: float = BAND[1],
    partial: bool = False,
    strict: bool = False,
) -> Reading:
    """Read what stands between the heights ``z_min`` and ``z_max`` [m] of an SDF world.

    Collisions count; a model without any counts with its visuals. Included models are sought in
    ``model_folders`` and beside the file, nowhere else. What is tilted covers the hull of its
    projection. What cannot be read (meshes, heightmaps) is skipped with a warning, or refused if
    ``strict``. Models that ``<state>`` moves are read where they stood before.

    Raises:
        InputError: the file is no SDF world, one of its numbers or models is wrong or missing, or
            nothing stands in it.
    """
    path = Path(path)
    if not (math.isfinite(z_min) and math.isfinite(z_max) and z_min < z_max):
        raise InputError(f"z_min = {z_min}, z_max = {z_max}: must be finite and z_min below z_max")
    root = parse_xml(path)
    if root.tag not in ("sdf", "gazebo"):
        raise InputError(f"{path}: must be <sdf>, not <{root.tag[:80]}>")
    world = root.find("world")
    content = root if world is None else world
    scene = _Scene(ModelFolders(model_folders, path.parent), (z_min, z_max))
    _read_models(content, scene, Place(IDENTITY, str(path), path, 0), "world")
    for actor in content.findall("actor"):
        _keep_mover(actor, scene, str(path))
    notes = _report(scene, path, strict)
    try:
        return Reading(_world(content, scene, path), notes)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _report(scene: _Scene, path: Path, strict: bool) -> tuple[str, ...]:
    if not scene.skipped:
        return ()
    named = ", ".join(scene.skipped[:5]) + (", ..." if len(scene.skipped) > 5 else "")
    if strict:
        raise InputError(f"{path}: not supported: {named}")
    return (f"{path}: skipped {len(scene.skipped)} that are not supported: {named}",)


def _world(content: Element, scene: _Scene, path: Path) -> World:
    discs = np.array(scene.discs, dtype=np.float64).reshape(-1, 3)
    bounds = _own_element(content, "bounds", 4)
    if bounds is None:
        bounds = _bounds_around(discs, scene)
    start = _own_element(content, "start", 3)
    return World(
        content.get("name") or path.stem,
        (bounds[0], bounds[1], bounds[2], bounds[3]),
        discs=discs,
        polygons=tuple(scene.polygons),
        movers=tuple(scene.movers),
        start=None if start is None else (start[0], start[1], start[2]),
        start_area=_area(content, "start_area"),
        goal_area=_area(content, "goal_area"),
    )


def _area(content: Element, name: str) -> tuple[float, float, float, float] | None:
    area = _own_element(content, name, 4)
    return None if area is None else (area[0], area[1], area[2], area[3])


def _own_element(content: Element, name: str, count: int) -> list[float] | None:
    element = content.find(f"{{{NAMESPACE}}}{name}")
    return None if element is None else numbers(element, count, name)


def _bounds_around(discs: FloatArray, scene: _Scene) -> list[float]:
    low = [discs[:, :2] - discs[:, 2:], *scene.polygons, *(m.points for m in scene.movers)]
    high = [discs[:, :2] + discs[:, 2:], *scene.polygons, *(m.points for m in scene.movers)]
    if not sum(map(len, low)):
        heights = f"{scene.band[0]} and {scene.band[1]} m"
        raise InputError(f"holds no obstacle between the heights {heights}")
    corner = np.concatenate(low).min(axis=0) - MARGIN
    return [*corner.tolist(), *(np.concatenate(high).max(axis=0) + MARGIN).tolist()]


def _read_models(content: Element, scene: _Scene, place: Place, home: str) -> None:
    """Read the models in a world, a model or a file, and those that it includes."""
    for model in content.findall("model"):
        where = f"{place.where}: model {model.get('name')!r}"
        _refuse_placement(model, where)
        pose = place.pose.apply(read_pose(model, where, home))
        _read_model(model, scene, place._replace(pose=pose, where=where))
    for include in content.findall("include"):
        _read_include(include, scene, place, home)
    for population in content.findall("population"):
        scene.skipped.append(f"population {population.get('name')!r}")


def _read_include(include: Element, scene: _Scene, place: Place, home: str) -> None:
    uri = " ".join((include.findtext("uri") or "").split())
    where = f"{place.where}: include {uri[:200]!r}"
    if place.depth >= MAX_INCLUDE_DEPTH:
        raise InputError(f"{where}: more than {MAX_INCLUDE_DEPTH} files include each other")
    _refuse_placement(include, where)
    found = scene.folders.find(uri, place.file, where)
    if found is None:
        return
    try:
        model_file = scene.folders.parsed(found)
    except InputError as error:
        raise InputError(f"{where}: {error}") from error
    model = model_file.find("model")
    if model is None:
        if model_file.find("light") is None:
            scene.skipped.append(f"include {uri[:200]!r} (no model in it)")
        return
    # As in SDF, the pose of the include replaces that of the model.
    own = include if include.find("pose") is not None else model
    pose = place.pose.apply(read_pose(own, where, home))
    _read_model(model, scene, Place(pose, where, found, place.depth + 1))


def _refuse_placement(element: Element, where: str) -> None:
    if element.get("placement_frame") or element.find("placement_frame") is not None:
        raise InputError(f"{where}: placement_frame is not supported")


def _read_model(model: Element, scene: _Scene, place: Place) -> None:
    links = model.findall("link")
    # A solid that nobody can touch is still seen by a lidar.
    touched = any(link.find("collision/geometry/*") is not None for link in links)
    for link in links:
        where = f"{place.where}: link {link.get('name')!r}"
        pose = place.pose.apply(read_pose(link, where, "__model__"))
        for part in link.findall("collision" if touched else "visual"):
            part_pose = pose.apply(read_pose(part, where, str(link.get("name"))))
            _read_geometries(part, scene, part_pose, where)
    _read_models(model, scene, place, "__model__")


def _read_geometries(part: Element, scene: _Scene, pose: Transform, where: str) -> None:
    for geometry in part.iterfind("geometry/*"):
        if geometry.tag == "empty":
            continue
        try:
            shapes = cover(geometry, pose, scene.band, where)
        except UnsupportedError as kind:
            scene.skipped.append(f"{kind} ({where.split(': ', 1)[-1][:200]})")
            continue
        _keep(shapes, scene, where)


def _keep(shapes: Iterable[Shape], scene: _Scene, where: str) -> None:
    for shape in shapes:
        if shape.disc is not None:
            scene.discs.append(shape.disc)
        if shape.polygon is not None:
            scene.polygons.append(shape.polygon)
    if len(scene.discs) + 3 * len(scene.polygons) > MAX_OBSTACLES:
        raise InputError(f"{where}: at most {MAX_OBSTACLES} obstacles are allowed")


def _keep_mover(actor: Element, scene: _Scene, where: str) -> None:
    try:
        scene.movers.append(read_actor(actor, where))
    except UnsupportedError as reason:
        scene.skipped.append(f"actor {actor.get('name')!r}: {reason}")
