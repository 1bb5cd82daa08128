# SPDX-License-Identifier: Apache-2.0
"""The floor plan of a mesh: what it covers of the floor between two heights."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pm01_nav.errors import InputError
from pm01_nav.geometry import polygon_edges
from pm01_nav.meshes import MISSING
from pm01_nav.worlds.polygon import is_simple
from pm01_nav.worlds.sdf_shapes import FLOOR_WIDTH, Band

FloatArray = NDArray[np.float64]

GRID = 1e-6
"""Corners nearer to each other than this are one [m]."""
THIN = 5e-4
"""What is thinner than this from above [m] is a line: the side of a wall."""
GAP = 1e-4
"""Half of a gap that is closed [m]."""
TOLERANCE = 5e-4
"""Outlines are simplified by at most this [m]."""
LEAST_HOLE = 0.01
"""Smaller holes in a solid are filled [m^2]: no robot is in one, and none sees into one."""
PIECE_CORNERS = 2000
"""A polygon with more corners is cut in two; where many obstacles are, that is quicker to use."""


@dataclass(frozen=True)
class Plan:
    """What a mesh covers of the floor."""

    polygons: list[FloatArray]
    """Simple ones, each of shape (n, 2) [m]."""
    segments: FloatArray
    """Surfaces seen from the side, shape (n, 4) [m]."""
    has_floor: bool
    """A part that robots stand on was left out."""


@dataclass(frozen=True)
class _Surfaces:
    """A mesh, by what is inside of it; each of its parts is a mesh of trimesh."""

    closed: Any
    """All of the closed surfaces."""
    other: Any
    """Open surfaces, and closed ones that are turned inside out."""
    bodies: list[Any]
    """The closed surfaces one by one; of an inside-out one the volume is negative."""


def floor_plan(triangles: FloatArray, band: Band) -> Plan:
    """Return what triangles (n, 3, 3) [m] cover between the heights of ``band``.

    Solid is what lies inside of closed surfaces, and what is below or above a surface in the
    band; a surface that stands upright, of a mesh that is not closed, is a thin wall. What lies
    below the lidar's plane and is wide is floor.

    Raises:
        InputError: the libraries for meshes are missing.
    """
    try:
        import shapely
        import trimesh
    except ImportError as error:
        raise InputError(MISSING) from error
    mesh = trimesh.Trimesh(
        vertices=triangles.reshape(-1, 3), faces=np.arange(3 * len(triangles)).reshape(-1, 3)
    )
    surfaces = _sorted_surfaces(mesh)
    solid, sides = _shadow(surfaces, band.lidar, band.high)
    low_solid, low_sides = _shadow(surfaces, band.sill, band.lidar)
    low_parts = shapely.get_parts(low_solid)
    free = shapely.difference(low_parts, solid, grid_size=GRID)
    is_floor = ~shapely.is_empty(_narrowed(free, FLOOR_WIDTH / 2.0))
    solid = _joined([solid, *low_parts[~is_floor]])
    solid, sides = _without_clutter(solid, _joined([sides, low_sides]))
    polygons, thin = _simple_polygons(solid)
    segments = np.concatenate([np.zeros((0, 4)), *_segments(sides), *thin])
    is_low = band.low < mesh.bounds[1, 2] <= band.sill
    return Plan(polygons, segments, bool(is_low or is_floor.any()))


def _sorted_surfaces(mesh: Any) -> _Surfaces:
    """Tell closed surfaces from others: each of their edges belongs to two triangles."""
    from trimesh.graph import connected_component_labels

    labels = connected_component_labels(mesh.face_adjacency, node_count=len(mesh.faces))
    edges = mesh.edges_unique_inverse
    is_paired = (np.bincount(edges)[edges] == 2).reshape(-1, 3).all(axis=1)
    count = int(labels.max()) + 1
    is_closed = np.bincount(labels[~is_paired], minlength=count) == 0
    corners = mesh.triangles - mesh.bounds[0]
    cross = np.cross(corners[:, 1], corners[:, 2])
    volumes = np.bincount(labels, weights=(corners[:, 0] * cross).sum(axis=1), minlength=count)
    is_solid = (is_closed & (volumes > 0.0))[labels]
    bodies = [_faces(mesh, labels == label) for label in np.nonzero(is_closed)[0]]
    return _Surfaces(_faces(mesh, is_solid), _faces(mesh, ~is_solid), bodies)


def _faces(mesh: Any, chosen: NDArray[np.bool_]) -> Any:
    import trimesh

    return trimesh.Trimesh(mesh.vertices, mesh.faces[chosen], process=False)


def _shadow(surfaces: _Surfaces, low: float, high: float) -> tuple[Any, Any]:
    """Return the area and the lines that a mesh covers between two heights, seen from above."""
    import shapely

    areas, _ = _projected(surfaces.closed, low, high)
    more, lines = _projected(surfaces.other, low, high)
    inside = _inside(surfaces.bodies, low) if low < high else shapely.MultiPolygon()
    return _joined([*areas, *more, inside]), _joined(lines)


def _joined(shapes: Sequence[Any]) -> Any:
    """Return the union; on a grid, without which thin slivers lead the library astray."""
    import shapely

    return shapely.union_all(shapes, grid_size=GRID)


def _projected(mesh: Any, low: float, high: float) -> tuple[list[Any], list[Any]]:
    """Return the triangles between two heights as polygons, and as lines those seen edge-on."""
    import shapely

    if high <= low or not len(mesh.faces):
        return [], []
    part = mesh.slice_plane([[0, 0, low], [0, 0, high]], [[0, 0, 1], [0, 0, -1]])
    corners = np.round(part.triangles[:, :, :2] / GRID) * GRID
    edges = np.roll(corners, -1, axis=1) - corners
    lengths = np.linalg.norm(edges, axis=2)
    double_areas = np.abs(edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0])
    is_thin = double_areas <= THIN * lengths.max(axis=1)
    # Of a triangle seen from the side the longest edge is what is seen.
    rows, longest = np.nonzero(is_thin)[0], lengths[is_thin].argmax(axis=1)
    ends = np.stack([corners[rows, longest], corners[rows, (longest + 1) % 3]], axis=1)
    ends = ends[(ends[:, 0] != ends[:, 1]).any(axis=1)]
    polygons, lines = shapely.polygons(corners[~is_thin]), shapely.linestrings(ends)
    return [*shapely.get_parts(polygons)], [*shapely.get_parts(lines)]


def _inside(bodies: list[Any], height: float) -> Any:
    """Return what lies inside of closed surfaces at a height.

    A surface that is turned inside out takes away: it is that of a room in a block.
    """
    import shapely

    cuts = [_cut(body, height) for body in bodies]
    lines = np.concatenate([np.zeros((0, 2, 2)), *cuts])
    owners = np.repeat(np.arange(len(bodies)), [len(cut) for cut in cuts])
    signs = np.array([1 if body.volume > 0.0 else -1 for body in bodies])
    edges = _joined([*shapely.get_parts(shapely.linestrings(lines))]) if len(lines) else None
    faces = [] if edges is None else shapely.get_parts(shapely.polygonize([edges]))
    solid = []
    for face in faces:
        crossed = owners[_crosses(face.representative_point(), lines)]
        is_in = np.bincount(crossed, minlength=len(bodies)) % 2 == 1
        if signs[is_in].sum() > 0:
            solid.append(face)
    return _joined(solid)


def _cut(body: Any, height: float) -> FloatArray:
    """Return the lines (n, 2, 2) in which a plane cuts a surface."""
    from trimesh.intersections import mesh_plane

    low, high = body.triangles[:, :, 2].min(), body.triangles[:, :, 2].max()
    if not low < height < high:
        return np.zeros((0, 2, 2))
    # A hair higher: a plane through corners would cut them twice.
    lines: Any = mesh_plane(body, [0.0, 0.0, 1.0], [0.0, 0.0, height + 0.7 * GRID])
    lines = np.round(lines[:, :, :2] / GRID) * GRID
    return lines[(lines[:, 0] != lines[:, 1]).any(axis=1)]


def _crosses(point: Any, lines: FloatArray) -> NDArray[np.bool_]:
    """Tell which lines (n, 2, 2) a ray from a point to the right crosses, shape (n,)."""
    (x1, y1), (x2, y2) = lines[:, 0].T, lines[:, 1].T
    spans = (y1 > point.y) != (y2 > point.y)
    rise = np.where(spans, y2 - y1, 1.0)
    return spans & (x1 + (point.y - y1) / rise * (x2 - x1) > point.x)


def _narrowed(areas: Any, width: float) -> Any:
    """Return what is further than ``width`` inside of each area."""
    import shapely

    return shapely.buffer(areas, -width, quad_segs=4)


def _without_clutter(solid: Any, sides: Any) -> tuple[Any, Any]:
    """Fill what lines enclose that is too small to be in; return the area and the lines left."""
    import shapely

    edges = _joined([sides, solid.boundary])
    faces = shapely.get_parts(shapely.polygonize([edges]))
    # What has next to no width stays lines.
    small = faces[(shapely.area(faces) < LEAST_HOLE) & ~shapely.is_empty(_narrowed(faces, THIN))]
    solid = _joined([solid, *small])
    return solid, shapely.difference(sides, solid, grid_size=GRID)


def _simple_polygons(solid: Any) -> tuple[list[FloatArray], list[FloatArray]]:
    """Return an area as polygons without holes, and the outlines of what has next to no area."""
    import shapely

    polygons, thin = [], []
    # Gaps that are thinner than a line would let edges cross where corners are rounded.
    closed = shapely.buffer(solid, GAP, join_style="mitre")
    closed = shapely.buffer(closed, -GAP, join_style="mitre")
    for part in shapely.get_parts(shapely.simplify(closed, TOLERANCE)):
        for piece in _pieces(part):
            corners = np.asarray(piece.exterior.coords)[:-1]
            if piece.area > THIN * THIN and is_simple(corners):
                polygons.append(corners)
            else:
                thin.append(polygon_edges(corners))
    return polygons, thin


def _pieces(polygon: Any) -> Iterator[Any]:
    """Cut a polygon until no piece has a hole or too many corners."""
    import shapely

    holes = [hole for hole in polygon.interiors if shapely.Polygon(hole).area >= LEAST_HOLE]
    stack = [shapely.Polygon(polygon.exterior, holes)]
    while stack:
        piece = stack.pop()
        if not piece.interiors and len(piece.exterior.coords) <= PIECE_CORNERS:
            yield piece
            continue
        x_min, y_min, x_max, y_max = piece.bounds
        left, _, right, _ = piece.interiors[0].bounds if piece.interiors else piece.bounds
        x = (left + right) / 2.0
        halves = (shapely.box(x_min, y_min, x, y_max), shapely.box(x, y_min, x_max, y_max))
        for half in halves:
            parts = shapely.get_parts(piece.intersection(half))
            stack.extend(part for part in parts if part.geom_type == "Polygon")


def _segments(lines: Any) -> list[FloatArray]:
    """Return the pieces of lines, each as rows of x1, y1, x2, y2."""
    import shapely

    if lines.is_empty:
        return []
    parts = shapely.get_parts(shapely.line_merge(lines))
    found = []
    for part in parts:
        points = np.asarray(shapely.simplify(part, TOLERANCE).coords)
        found.append(np.hstack([points[:-1], points[1:]]))
    return found
