# SPDX-License-Identifier: Apache-2.0
"""Read SDF worlds of Gazebo classic and gz-sim as discs, polygons, thin walls and moving discs."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from pm01_nav.documents import parse_xml
from pm01_nav.errors import InputError
from pm01_nav.worlds.reading import Reading
from pm01_nav.worlds.sdf_actor import read_actor
from pm01_nav.worlds.sdf_include import ModelFolders
from pm01_nav.worlds.sdf_model import ModelReader, Source, version_of
from pm01_nav.worlds.sdf_pose import numbers
from pm01_nav.worlds.sdf_report import crowded
from pm01_nav.worlds.sdf_scene import Scene, add_world
from pm01_nav.worlds.sdf_shapes import Band, UnsupportedError
from pm01_nav.worlds.sdf_state import read_state
from pm01_nav.worlds.world import World

FloatArray = NDArray[np.float64]

NAMESPACE = "urn:pm01-nav:world"
"""Of our own elements: bounds, start, start_area and goal_area, which SDF has no place for."""
BAND = (0.0, 0.5)
"""Heights that the robot or its lidar can meet [m]."""
MARGIN = 1.0
"""Bounds reach this far around the obstacles where the file does not give them [m]."""


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

    The robot stands at ``z_min``. Collisions count; a model without any counts with its visuals.
    Poses are those of ``<state>`` where the world has one. Included models and meshes are sought
    in ``model_folders``, then where Gazebo looks; nothing is downloaded. Of what is tilted, and of
    meshes, the part between the heights counts. Left out are floors, which are lower than 3 cm or,
    where they are 1.5 m wide, 15 cm, and robots: models with a drive or with a lidar on wheels.

    Args:
        path: the file.
        model_folders: folders with models.
        z_min: the ground [m].
        z_max: the robot's height above the same zero [m].
        partial: take the rest of a world whose models are missing or whose shapes are lost.
        strict: refuse a world of which anything is lost.

    Raises:
        InputError: the file is no SDF world; one of its numbers is wrong; a model is missing or
            above half of the shapes are lost, unless ``partial``; or nothing stands in it.
    """
    path = Path(path)
    if not (math.isfinite(z_min) and math.isfinite(z_max) and z_min < z_max):
        raise InputError(f"z_min = {z_min}, z_max = {z_max}: must be finite and z_min below z_max")
    root = parse_xml(path)
    if root.tag not in ("sdf", "gazebo"):
        raise InputError(f"{path}: must be <sdf>, not <{root.tag[:80]}>")
    world = root.find("world")
    content = root if world is None else world
    folders = ModelFolders(model_folders, path.parent)
    scene = Scene(folders, Band(z_min, z_max))
    source = Source(str(path), path, version_of(root), 0)
    _read_models(content, scene, source, folders)
    for actor in content.findall("actor"):
        _keep_mover(actor, scene, str(path))
    scene.report.check(path, str(folders), partial=partial, strict=strict)
    try:
        world_read = _world(content, scene, path)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    notes = (*scene.report.notes(), *crowded(world_read))
    return Reading(world_read, notes, f"{path.name}: {scene.report.share}")


def _read_models(content: Element, scene: Scene, source: Source, folders: ModelFolders) -> None:
    reader = ModelReader(folders, scene.report)
    state = read_state(content, source.where)
    trees = [reader.read(content, "", source, home="world")]
    trees += [reader.read(extra, "", source, home="world") for extra in state.insertions]
    for tree in trees:
        add_world(scene, tree, state)


def _world(content: Element, scene: Scene, path: Path) -> World:
    discs = np.array(scene.discs, dtype=np.float64).reshape(-1, 3)
    segments = np.concatenate([np.zeros((0, 4)), *scene.segments])
    bounds = _own_element(content, "bounds", 4)
    if bounds is None:
        bounds = _bounds_around(discs, segments, scene)
    start = _own_element(content, "start", 3)
    return World(
        content.get("name") or path.stem,
        (bounds[0], bounds[1], bounds[2], bounds[3]),
        discs=discs,
        polygons=tuple(scene.polygons),
        segments=segments,
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


def _bounds_around(discs: FloatArray, segments: FloatArray, scene: Scene) -> list[float]:
    points = [*scene.polygons, segments.reshape(-1, 2), *(m.points for m in scene.movers)]
    low = np.concatenate([discs[:, :2] - discs[:, 2:], *points])
    high = np.concatenate([discs[:, :2] + discs[:, 2:], *points])
    if not len(low):
        heights = f"{scene.band.low} and {scene.band.high} m"
        about = "; ".join([scene.report.share, *scene.report.notes()])
        raise InputError(f"holds no obstacle between the heights {heights} ({about})")
    return [*(low.min(axis=0) - MARGIN).tolist(), *(high.max(axis=0) + MARGIN).tolist()]


def _keep_mover(actor: Element, scene: Scene, where: str) -> None:
    try:
        scene.movers.append(read_actor(actor, where))
    except UnsupportedError as reason:
        scene.report.unread.append(f"actor {actor.get('name')!r}: {reason}")
