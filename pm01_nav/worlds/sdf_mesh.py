# SPDX-License-Identifier: Apache-2.0
"""The ``<mesh>`` of an SDF geometry: its file, scale and submesh, and its floor plan."""

from __future__ import annotations

import math
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from pm01_nav.errors import InputError
from pm01_nav.geometry import polygon_edges
from pm01_nav.meshes import Part, load_parts
from pm01_nav.worlds.mesh_plan import Plan, floor_plan
from pm01_nav.worlds.polygon import is_simple
from pm01_nav.worlds.sdf_include import ModelFolders
from pm01_nav.worlds.sdf_pose import Transform, from_euler, is_true, numbers
from pm01_nav.worlds.sdf_shapes import Band, Cover, UnsupportedError

FloatArray = NDArray[np.float64]


class MeshReader:
    """Reads meshes; each file once, and its plan once for each height that it stands at."""

    def __init__(self, folders: ModelFolders, band: Band) -> None:
        """Look for files in ``folders``; keep what lies in ``band``."""
        self._folders = folders
        self._band = band
        self._parts: dict[Path, list[Part] | InputError] = {}
        self._plans: dict[tuple[object, ...], Plan] = {}

    def cover(self, geometry: Element, pose: Transform, file: Path, where: str) -> Cover:
        """Return what a ``<mesh>`` covers of the floor; ``file`` is where it stands.

        Raises:
            UnsupportedError: its file is missing or cannot be read, or has no such submesh.
            InputError: a number is wrong.
        """
        scale_element = geometry.find("scale")
        scale = np.ones(3)
        if scale_element is not None:
            scale = np.array(numbers(scale_element, 3, f"{where}: mesh: scale"))
        if not scale.all():
            raise UnsupportedError("mesh scaled to nothing")
        path = self._find(geometry, file, where)
        name = (geometry.findtext("submesh/name") or "").strip()
        center = is_true(geometry.findtext("submesh/center"))
        yaw = math.atan2(pose.rotation[1, 0], pose.rotation[0, 0]) if pose.is_upright else 0.0
        turned = from_euler(0.0, 0.0, yaw)
        # What stands upright looks the same from above wherever it stands and however it is turned.
        own = Transform(turned.T @ pose.rotation, np.array([0.0, 0.0, pose.translation[2]]))
        key = (path, name, center, *scale, *own.rotation.round(9).flat, own.translation[2])
        if key not in self._plans:
            triangles = self._triangles(path, name, center) * scale
            if scale.prod() < 0.0:
                triangles = triangles[:, ::-1]  # Mirrored, its inside would be outside.
            self._plans[key] = floor_plan(own.points(triangles), self._band)
        return _placed(self._plans[key], turned[:2, :2], pose.translation[:2])

    def _find(self, geometry: Element, file: Path, where: str) -> Path:
        uri = " ".join((geometry.findtext("uri") or "").split())
        try:
            path = self._folders.find_file(uri, file, where)
        except InputError:
            raise UnsupportedError(f"mesh {uri[:120]!r} outside of the model folders") from None
        if path is None:
            raise UnsupportedError(f"mesh {uri[:120]!r} not found")
        return path

    def _triangles(self, path: Path, name: str, center: bool) -> FloatArray:
        if path not in self._parts:
            try:
                self._parts[path] = load_parts(path)
            except InputError as error:
                self._parts[path] = error
        parts = self._parts[path]
        if isinstance(parts, InputError):
            raise UnsupportedError(f"mesh {parts}")
        chosen = [part.triangles for part in parts if name in ("", "__default__", part.name)]
        if not chosen:
            raise UnsupportedError(f"mesh {path.name}: has no submesh {name[:60]!r}")
        triangles = np.concatenate(chosen)
        if center and name:
            corners = triangles.reshape(-1, 3)
            triangles = triangles - (corners.min(axis=0) + corners.max(axis=0)) / 2.0
        return triangles


def _placed(plan: Plan, rotation: FloatArray, place: FloatArray) -> Cover:
    ends = (plan.segments.reshape(-1, 2) @ rotation.T + place).reshape(-1, 4)
    cover = Cover(segments=[ends] if len(ends) else [], is_floor=plan.has_floor)
    for polygon in plan.polygons:
        turned = polygon @ rotation.T + place
        # Where corners are micrometres apart turning them can make edges cross.
        if is_simple(turned):
            cover.polygons.append(turned)
        else:
            cover.segments.append(polygon_edges(turned))
    return cover
