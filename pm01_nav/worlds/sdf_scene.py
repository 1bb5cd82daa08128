# SPDX-License-Identifier: Apache-2.0
"""Put the shapes of an SDF world's models where Gazebo puts them."""

from __future__ import annotations

from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from pm01_nav.errors import InputError
from pm01_nav.worlds.mover import Mover
from pm01_nav.worlds.sdf_include import ModelFolders
from pm01_nav.worlds.sdf_mesh import MeshReader
from pm01_nav.worlds.sdf_model import Model
from pm01_nav.worlds.sdf_pose import Transform, frame_and_pose
from pm01_nav.worlds.sdf_report import Report
from pm01_nav.worlds.sdf_robot import moving_plugins, robot_reason
from pm01_nav.worlds.sdf_shapes import Band, Cover, UnsupportedError, cover
from pm01_nav.worlds.sdf_state import UNIT, ModelState, WorldState
from pm01_nav.worlds.world import MAX_OBSTACLES

FloatArray = NDArray[np.float64]


class Scene:
    """What has been read so far."""

    def __init__(self, folders: ModelFolders, band: Band) -> None:
        """Begin with nothing."""
        self.band = band
        self.meshes = MeshReader(folders, band)
        self.discs: list[tuple[float, float, float]] = []
        self.polygons: list[FloatArray] = []
        self.segments: list[FloatArray] = []
        self.movers: list[Mover] = []
        self.report = Report()

    def keep(self, found: Cover, where: str) -> None:
        """Add what a shape covers.

        Raises:
            InputError: there is too much by now.
        """
        self.discs += found.discs
        self.polygons += found.polygons
        self.segments += found.segments
        thin = sum(map(len, self.segments))
        if len(self.discs) + 3 * len(self.polygons) + thin > MAX_OBSTACLES:
            raise InputError(f"{where}: at most {MAX_OBSTACLES} obstacles are allowed")


class _Link(NamedTuple):
    """Where the shapes of a link are."""

    place: Transform
    """In the world."""
    own: Transform
    """In its model, before a state moved it."""
    scale: FloatArray
    where: str


def add_world(scene: Scene, world: Model, state: WorldState) -> None:
    """Add the models of a world, moved by its state.

    Raises:
        InputError: a pose or a shape is wrong, or there is too much.
    """
    for model in world.models:
        if model.name in state.deletions:
            scene.report.deleted.append(repr(model.name))
            continue
        reason = robot_reason(model)
        if reason:
            scene.report.robots.append(f"{model.name!r} ({reason})")
            continue
        place = world.scope.place(model.key)
        _add_model(scene, model, place, state.models.get(model.name))
        if not model.is_static:
            for plugin in moving_plugins(model):
                scene.report.moved.append(f"{model.name!r} ({plugin})")
    _note_unknown_frames(scene, world)


def _note_unknown_frames(scene: Scene, world: Model) -> None:
    for model in world.walk():
        names = ", ".join(repr(name[:60]) for name in sorted(model.scope.unknown))
        if names:
            scene.report.frames.append(f"{names} in {model.name or 'the world'!r}")


def _add_model(scene: Scene, model: Model, place: Transform, state: ModelState | None) -> None:
    """Add a model at ``place``, or where its state says; models in it are moved with it."""
    scale = UNIT
    if state is not None:
        place, scale = state.pose, state.scale
    links = model.element.findall("link")
    # A solid that nobody can touch is still seen by a lidar.
    touched = any(link.find("collision/geometry/*") is not None for link in links)
    for element in links:
        name = element.get("name") or ""
        own = model.scope.place(name)
        moved = None if state is None else state.links.get(name)
        where = f"{model.source.where}: link {name!r}"
        link = _Link(place.apply(own) if moved is None else moved, own, scale, where)
        for part in element.findall("collision" if touched else "visual"):
            _add_part(scene, model, part, link)
    for inner in model.models:
        inner_state = None if state is None else state.models.get(inner.name)
        _add_model(scene, inner, place.apply(model.scope.place(inner.key)), inner_state)


def _add_part(scene: Scene, model: Model, part: Element, link: _Link) -> None:
    """Add a collision or a visual."""
    frame, pose = frame_and_pose(part, link.where)
    if frame:
        pose = link.own.inverse().apply(model.scope.place(frame)).apply(pose)
    pose = link.place.apply(pose)
    for geometry in part.iterfind("geometry/*"):
        if geometry.tag == "empty":
            continue
        scene.report.num_shapes += geometry.tag != "plane"
        try:
            if geometry.tag == "mesh":
                found = scene.meshes.cover(geometry, pose, model.source.file, link.where)
            else:
                found = cover(geometry, pose, link.scale, scene.band, link.where)
        except UnsupportedError as kind:
            scene.report.lost.append(f"{kind} ({link.where.split(': ', 1)[-1][:200]})")
            continue
        if found.is_floor:
            scene.report.floors.append(_short(model, part))
        scene.keep(found, link.where)


def _short(model: Model, part: Element) -> str:
    return f"{model.name}/{part.get('name') or part.tag}"[:80]
