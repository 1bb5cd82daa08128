# SPDX-License-Identifier: Apache-2.0
"""Meshes in SDF worlds: their floor plan between two heights, their scale, submesh and file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pm01_nav.worlds.mesh_plan import Plan, floor_plan
from pm01_nav.worlds.reading import Reading
from pm01_nav.worlds.sdf_shapes import Band
from tests.worlds.sdf_text import model, read, sdf, solid

trimesh = pytest.importorskip("trimesh", reason="needs trimesh (extra meshes)")
collada = pytest.importorskip("collada", reason="needs pycollada (extra meshes)")
shapely = pytest.importorskip("shapely", reason="needs shapely (extra meshes)")

BAND = Band(0.0, 0.5)


def block(x: float, y: float, size: tuple[float, float, float], z: float = 0.0) -> Any:
    """A closed box that stands at height z on its middle."""
    mesh = trimesh.creation.box(size)
    mesh.apply_translation((x, y, z + size[2] / 2.0))
    return mesh


def plan_of(*meshes: Any) -> Plan:
    return floor_plan(np.concatenate([np.asarray(m.triangles) for m in meshes]), BAND)


def area(plan: Plan) -> Any:
    return shapely.union_all([shapely.Polygon(p) for p in plan.polygons])


def test_closed_box_is_a_polygon() -> None:
    plan = plan_of(block(3.0, 4.0, (2.0, 1.0, 1.0)))
    assert area(plan).symmetric_difference(shapely.box(2.0, 3.5, 4.0, 4.5)).area < 1e-6
    assert (len(plan.segments), plan.has_floor) == (0, False)


def test_only_what_is_in_the_band_counts() -> None:
    # Four legs of 10 cm under a top that begins at 0.6 m: from the top nothing is met.
    legs = [block(x, y, (0.1, 0.1, 0.6)) for x in (0.0, 1.0) for y in (0.0, 1.0)]
    high = block(0.5, 0.5, (1.2, 1.2, 0.05), z=0.6)
    assert area(plan_of(*legs, high)).area == pytest.approx(4 * 0.01, abs=1e-5)
    # Of a lower top all of it is.
    low = block(0.5, 0.5, (1.2, 1.2, 0.05), z=0.4)
    assert area(plan_of(*legs, low)).area == pytest.approx(1.44, abs=1e-5)


def test_room_in_a_closed_mesh_is_free() -> None:
    # Walls of 20 cm around 4 m x 3 m, 1 m high, as one body: 4.4 * 3.4 - 4 * 3 = 2.96.
    ring = shapely.box(-2.2, -1.7, 2.2, 1.7).difference(shapely.box(-2.0, -1.5, 2.0, 1.5))
    plan = plan_of(_extruded(ring))
    assert area(plan).area == pytest.approx(2.96, abs=1e-5)
    assert not area(plan).contains(shapely.Point(0.0, 0.0))
    # The same as a block with a room cut out: two surfaces, the inner one turned inside out.
    inner = block(0.0, 0.0, (4.0, 3.0, 0.8), z=0.1)
    inner.invert()
    # A table in the room is solid again, and so is what two blocks share.
    table, block_beside = block(1.0, 0.0, (0.5, 0.5, 0.9), z=0.05), block(2.2, 0.0, (0.4, 1.0, 1.0))
    cut = plan_of(block(0.0, 0.0, (4.4, 3.4, 1.0)), inner, table, block_beside)
    # The second block reaches 0.2 m out of the first and not into the room: 2.96 + 0.25 + 0.2.
    assert area(cut).area == pytest.approx(3.41, abs=1e-4)
    assert len(cut.segments) == 0


def _extruded(ring: Any) -> Any:
    """Return an upright ring of quads, 1 m high: outer and inner sides, top and bottom."""
    outer = np.array(ring.exterior.coords)[:-1]
    inner = np.array(ring.interiors[0].coords)[:-1]
    # Begin both at the corner of the least x and y, counter-clockwise.
    loops = []
    for loop in (outer, inner):
        middle = loop.mean(axis=0)
        angles = np.arctan2(*(loop - middle).T[::-1])
        loops.append(loop[np.argsort(angles)])
    corners = np.array([(*p, z) for loop in loops for z in (0.0, 1.0) for p in loop])
    # Rows of four: outer low, outer high, inner low, inner high.
    quads = []
    for k in range(4):
        n = (k + 1) % 4
        quads += [(k, n, 4 + n, 4 + k), (8 + n, 8 + k, 12 + k, 12 + n)]
        quads += [(4 + k, 4 + n, 12 + n, 12 + k), (n, k, 8 + k, 8 + n)]
    faces = [f for a, b, c, d in quads for f in ((a, b, c), (a, c, d))]
    mesh = trimesh.Trimesh(corners, faces)
    assert mesh.is_volume
    return mesh


def test_sheets_are_thin_walls_and_enclose_nothing() -> None:
    # Four upright sheets around 4 m x 3 m, each of two triangles: nothing is filled.
    corners = np.array([[-2.0, -1.5], [2.0, -1.5], [2.0, 1.5], [-2.0, 1.5]])
    triangles = []
    for first, second in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        a, b = (*first, 0.0), (*second, 0.0)
        c, d = (*second, 1.0), (*first, 1.0)
        triangles += [(a, b, c), (a, c, d)]
    plan = floor_plan(np.array(triangles), BAND)
    assert plan.polygons == []
    lengths = np.linalg.norm(plan.segments[:, 2:] - plan.segments[:, :2], axis=1)
    assert lengths.sum() == pytest.approx(14.0, abs=1e-6)


def test_floor_of_a_building_is_left_out() -> None:
    # A slab of 6 m x 5 m, 10 cm thick, and a wall on it; the step of 40 cm beside it stays.
    slab, wall = block(0.0, 0.0, (6.0, 5.0, 0.1)), block(2.0, 0.0, (0.2, 5.0, 1.0))
    plan = plan_of(slab, wall, block(9.0, 0.0, (0.4, 5.0, 0.1)))
    assert plan.has_floor
    assert area(plan).area == pytest.approx(0.2 * 5.0 + 0.4 * 5.0, abs=1e-4)


def test_carpet_is_floor() -> None:
    carpet, deeper = block(0.0, 0.0, (0.5, 0.5, 0.02)), block(0.0, 0.0, (3.0, 3.0, 0.1), z=-0.1)
    assert plan_of(carpet).has_floor
    assert not plan_of(deeper).has_floor
    assert plan_of(carpet).polygons == []


def test_round_hull_at_its_widest() -> None:
    # A ball of radius 0.5 m around (0, 0, 0.6): widest in the band at 0.5 m, where its radius is
    # sqrt(0.25 - 0.01) = 0.4899; the mesh lies up to 1 mm inside of it.
    ball = trimesh.creation.icosphere(4, 0.5)
    ball.apply_translation((0.0, 0.0, 0.6))
    outline = area(plan_of(ball))
    assert outline.area == pytest.approx(np.pi * 0.24, rel=0.01)


def mesh_world(folder: Path, uri: str, content: str = "", pose: str = "0 0 0 0 0 0") -> Reading:
    mesh = f"<mesh><uri>{uri}</uri>{content}</mesh>"
    post = model(solid(), "50 50 0.5 0 0 0", "post")
    return read(folder, sdf(model(solid(mesh), pose, "thing"), post))


def extent(reading: Reading) -> list[float]:
    """x_min, y_min, x_max, y_max of all but the post."""
    points = np.concatenate([p for p in reading.world.polygons if p.max() < 40.0])
    return [*points.min(axis=0), *points.max(axis=0)]


@pytest.mark.parametrize("kind", ["stl", "obj", "dae"])
def test_kinds_of_files_scale_and_pose(tmp_path: Path, kind: str) -> None:
    (tmp_path / "thing" / "meshes").mkdir(parents=True)
    block(0.5, 0.0, (1.0, 0.4, 1.0)).export(tmp_path / f"thing/meshes/a.{kind}")
    uri = f"model://thing/meshes/a.{kind}"
    # 0..1 times 2 and -0.2..0.2 times 3, turned by 90 degrees: y 0..2, x -0.6..0.6.
    reading = mesh_world(tmp_path, uri, "<scale>2 3 1</scale>", "5 6 0 0 0 1.5707963267948966")
    assert extent(reading) == pytest.approx([4.4, 6.0, 5.6, 8.0], abs=1e-6)
    assert (reading.notes, reading.summary) == ((), "hall.sdf: read 2 of 2 shapes")
    # Mirrored it is solid, too.
    reading = mesh_world(tmp_path, uri, "<scale>-1 1 1</scale>")
    assert extent(reading) == pytest.approx([-1.0, -0.2, 0.0, 0.2], abs=1e-6)
    assert len(reading.world.segments) == 0
    # Lying on its side it reaches from 0 to 1 m along y.
    reading = mesh_world(tmp_path, uri, pose="0 0 0.2 1.5707963267948966 0 0")
    assert extent(reading) == pytest.approx([0.0, -1.0, 1.0, 0.0], abs=1e-6)


def two_nodes(path: Path) -> None:
    """Write a DAE with the nodes ``left`` and ``right``, boxes around x = -2 and x = 3."""
    document = collada.Collada()
    nodes = []
    for name, x in (("left", -2.0), ("right", 3.0)):
        mesh = block(x, 0.0, (1.0, 1.0, 1.0))
        values = np.asarray(mesh.vertices).ravel()
        source = collada.source.FloatSource(f"{name}-v", values, ("X", "Y", "Z"))
        geometry = collada.geometry.Geometry(document, f"{name}-g", name, [source])
        inputs = collada.source.InputList()
        inputs.addInput(0, "VERTEX", f"#{name}-v")
        triangles = geometry.createTriangleSet(np.asarray(mesh.faces).ravel(), inputs, "m")
        geometry.primitives.append(triangles)
        document.geometries.append(geometry)
        child = collada.scene.GeometryNode(geometry, [])
        nodes.append(collada.scene.Node(name, children=[child]))
        nodes[-1].xmlnode.set("name", name)
    scene = collada.scene.Scene("s", nodes)
    document.scenes.append(scene)
    document.scene = scene
    document.write(str(path))


def test_submesh_and_its_centre(tmp_path: Path) -> None:
    two_nodes(tmp_path / "two.dae")
    submesh = "<submesh><name>right</name>{}</submesh>"
    assert extent(mesh_world(tmp_path, "two.dae")) == pytest.approx([-2.5, -0.5, 3.5, 0.5])
    alone = mesh_world(tmp_path, "two.dae", submesh.format(""))
    assert extent(alone) == pytest.approx([2.5, -0.5, 3.5, 0.5])
    centred = mesh_world(tmp_path, "two.dae", submesh.format("<center>true</center>"))
    assert extent(centred) == pytest.approx([-0.5, -0.5, 0.5, 0.5])
    (note,) = mesh_world(tmp_path, "two.dae", submesh.format("").replace("right", "up")).notes
    assert "mesh two.dae: has no submesh 'up' (model 'thing': link 'link')" in note


@pytest.mark.parametrize(
    ("uri", "content", "words"),
    [
        ("nowhere.stl", "", "mesh 'nowhere.stl' not found"),
        ("../hall.stl", "", "mesh '../hall.stl' outside of the model folders"),
        ("https://fuel.example/1.0/me/models/a/1/files/a.dae", "", "not found"),
        ("broken.stl", "", "broken.stl: "),
        ("shape.step", "", "shape.step: allowed meshes: .stl, .obj, .dae"),
        ("flat.stl", "<scale>1 0 1</scale>", "mesh scaled to nothing"),
    ],
)
def test_unread_meshes_are_named(tmp_path: Path, uri: str, content: str, words: str) -> None:
    for name in ("broken.stl", "shape.step", "flat.stl"):
        (tmp_path / name).write_text("solid nothing")
    reading = mesh_world(tmp_path, uri, content)
    assert reading.summary == "hall.sdf: read 1 of 2 shapes"
    assert words in reading.notes[0]
    assert reading.notes[0].startswith("lost: ")
