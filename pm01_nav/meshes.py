# SPDX-License-Identifier: Apache-2.0
"""Triangles from the mesh files of robots and worlds that strangers wrote: STL, OBJ and DAE."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree.ElementTree import Element, tostring

import numpy as np
from numpy.typing import NDArray

from pm01_nav.documents import parse_xml, read_bytes
from pm01_nav.errors import InputError

FloatArray = NDArray[np.float64]

MAX_TRIANGLES = 2_000_000
"""More are refused; a detailed robot has a tenth of them."""
MAX_NODES = 20_000
"""Of a DAE's scene, instances counted: nodes that hold each other twice would never end."""
LARGEST = 1e6
"""Larger coordinates are refused [m]."""
MISSING = "meshes need trimesh and pycollada: pip install 'pm01-nav[meshes]'"
# What shows a surface but does not shape it. It refers to pictures and to other files.
_UNREAD = frozenset(
    f"{prefix}{name}"
    for prefix in ("library_", "instance_")
    for name in ("animations", "camera", "cameras", "effects", "images", "light", "lights")
) | {"asset", "bind_material", "extra", "library_materials"}


class Part(NamedTuple):
    """A named part of a mesh."""

    name: str
    """Of the nearest node in a DAE that has one; empty elsewhere."""
    triangles: FloatArray
    """Shape (n, 3, 3) [m]."""


def load_mesh(path: str | Path) -> FloatArray:
    """Read a mesh as triangles (n, 3, 3) [m].

    A DAE's unit is applied and its up_axis is not, as Gazebo and RViz do; STL and OBJ are metres.
    Nothing that a file refers to is opened.

    Raises:
        InputError: the file cannot be read, is too large, or holds no triangles; or the libraries
            for meshes are missing.
    """
    return np.concatenate([part.triangles for part in load_parts(path)])


def load_parts(path: str | Path) -> list[Part]:
    """Read a mesh as its parts, at least one, none of them empty.

    Raises:
        InputError: as for ``load_mesh``.
    """
    path = Path(path)
    load = _LOADERS.get(path.suffix.lower())
    if load is None:
        raise InputError(f"{path}: allowed meshes: {', '.join(_LOADERS)}")
    try:
        # What overflows is refused below.
        with np.errstate(all="ignore"):
            parts = [part for part in load(path) if len(part.triangles)]
    except (InputError, ImportError) as error:
        raise error if isinstance(error, InputError) else InputError(MISSING) from error
    # The libraries let through whatever goes wrong inside of them.
    except Exception as error:
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        raise InputError(f"{path}: is no whole mesh: {reason}") from error
    if any(part.triangles.shape[1:] != (3, 3) for part in parts):
        raise InputError(f"{path}: is no whole mesh: its corners are no points in space")
    if not parts:
        raise InputError(f"{path}: holds no triangles")
    # NaN fails the comparison, too.
    if not all(np.abs(part.triangles).max() <= LARGEST for part in parts):
        raise InputError(f"{path}: its coordinates must lie within {LARGEST:g} m")
    return parts


def _load_stl(path: Path) -> Iterator[Part]:
    data = read_bytes(path)
    count = int.from_bytes(data[80:84], "little")
    _refuse_too_many(len(data) // 50, path)
    # Some programs write more behind the triangles. Text there is read as a huge count.
    yield from _load_with_trimesh(data[: 84 + 50 * count] if count else data, "stl")


def _load_obj(path: Path) -> Iterator[Part]:
    data = read_bytes(path)
    _refuse_too_many(data.count(b"\nf"), path)
    yield from _load_with_trimesh(data, "obj")


def _load_with_trimesh(data: bytes, kind: str) -> Iterator[Part]:
    import trimesh

    # Without a resolver nothing else is opened.
    scene = trimesh.load_scene(io.BytesIO(data), file_type=kind, process=False, skip_materials=True)
    for mesh in scene.dump():
        if isinstance(mesh, trimesh.Trimesh):
            yield Part("", np.asarray(mesh.triangles, dtype=float))


def _load_dae(path: Path) -> Iterator[Part]:
    from collada import Collada
    from collada.common import DaeUnsupportedError

    root = parse_xml(path)
    scale = _unit(root, path)
    _strip(root)
    # What is written here has no document type and no reference to another file.
    document = Collada(io.BytesIO(tostring(root)), ignore=[DaeUnsupportedError])
    if document.scene is None:
        raise InputError(f"{path}: has no scene")
    total = 0
    for name, geometry, matrix in _geometries(document.scene, path):
        for triangles in _triangles(geometry):
            total += len(triangles)
            _refuse_too_many(total, path)
            yield Part(name, scale * (triangles @ matrix[:3, :3].T + matrix[:3, 3]))


def _unit(root: Element, path: Path) -> float:
    unit = root.find("{*}asset/{*}unit")
    text = "1" if unit is None else unit.get("meter", "1")
    try:
        scale = float(text)
    except ValueError:
        scale = float("nan")
    if not 0.0 < scale <= LARGEST:
        raise InputError(f"{path}: unit: meter = {text[:40]!r}: must be a number above 0")
    return scale


def _strip(root: Element) -> None:
    for element in list(root.iter()):
        for child in list(element):
            if str(child.tag).rsplit("}", 1)[-1] in _UNREAD:
                element.remove(child)


def _geometries(scene: Any, path: Path) -> Iterator[tuple[str, Any, FloatArray]]:
    """Yield the geometries of a DAE's scene, each with its node's name and matrix (4, 4)."""
    from collada.controller import Skin
    from collada.scene import ControllerNode, GeometryNode, Node

    count = 0
    stack = [("", node, np.eye(4)) for node in reversed(scene.nodes)]
    while stack:
        count += 1
        if count > MAX_NODES:
            raise InputError(f"{path}: its scene has more than {MAX_NODES} nodes")
        name, node, matrix = stack.pop()
        if isinstance(node, Node):
            name = node.xmlnode.get("name") or name
            inner = matrix @ np.asarray(node.matrix, dtype=float)
            stack.extend((name, child, inner) for child in reversed(node.children))
        elif isinstance(node, GeometryNode):
            yield name, node.geometry, matrix
        elif isinstance(node, ControllerNode) and isinstance(node.controller, Skin):
            bound = np.asarray(node.controller.bind_shape_matrix, dtype=float)
            yield name, node.controller.geometry, matrix @ bound.reshape(4, 4)


def _triangles(geometry: Any) -> Iterator[FloatArray]:
    """Yield the triangles (n, 3, 3) of a DAE's geometry, polygons cut into fans."""
    for primitive in geometry.primitives:
        if hasattr(primitive, "triangleset"):
            primitive = primitive.triangleset()
        # Lines have no triangles.
        corners = getattr(primitive, "vertex_index", None)
        if corners is not None and primitive.vertex is not None and corners.shape[1:] == (3,):
            yield np.asarray(primitive.vertex, dtype=float)[corners]


def _refuse_too_many(count: int, path: Path) -> None:
    if count > MAX_TRIANGLES:
        raise InputError(f"{path}: has more than {MAX_TRIANGLES} triangles")


_LOADERS: dict[str, Callable[[Path], Iterator[Part]]] = {
    ".stl": _load_stl,
    ".obj": _load_obj,
    ".dae": _load_dae,
}
