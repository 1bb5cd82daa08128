# SPDX-License-Identifier: Apache-2.0
"""Meshes that strangers wrote: their triangles in metres, and what is refused."""

from __future__ import annotations

import struct
import sys
from pathlib import Path

import numpy as np
import pytest

from pm01_nav.errors import InputError
from pm01_nav.meshes import load_mesh, load_parts

pytest.importorskip("trimesh", reason="needs trimesh (extra meshes)")
pytest.importorskip("collada", reason="needs pycollada (extra meshes)")

CORNERS = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 1.0, 0.5]]
ASCII = """solid a
facet normal 0 0 1
outer loop
vertex 0 0 0
vertex 2 0 0
vertex 0 1 0.5
endloop
endfacet
endsolid a
"""
QUAD = """mtllib /dev/zero
usemtl a
v 0 0 0
v 2 0 0
v 2 1 0
v 0 1 0
f 1 2 3 4
"""
DAE = """<?xml version="1.0" encoding="utf-8"?>{head}
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><created>yesterday</created>{unit}<up_axis>Y_UP</up_axis></asset>
<library_images><image id="i"><init_from>file:///dev/zero</init_from></image></library_images>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="pa" count="12">0 0 0 2 0 0 2 1 0 0 1 0</float_array>
<technique_common><accessor source="#pa" count="4" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<polylist count="1" material="m"><input semantic="VERTEX" source="#v" offset="0"/>
<vcount>4</vcount><p>0 1 2 3</p></polylist></mesh></geometry></library_geometries>
{nodes}
<library_visual_scenes><visual_scene id="s"><node id="n" name="plate">
<matrix>0 -1 0 10  1 0 0 20  0 0 1 30  0 0 0 1</matrix>
<instance_geometry url="#g"><bind_material><technique_common>
<instance_material symbol="m" target="#none"/></technique_common></bind_material>
</instance_geometry></node>{more}</visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


def dae(head: str = "", unit: str = "", nodes: str = "", more: str = "") -> str:
    return DAE.format(head=head, unit=unit, nodes=nodes, more=more)


def binary(count: int = 1, behind: bytes = b"") -> bytes:
    # Programs begin even binary files with the word that marks a text.
    return (
        b"solid".ljust(80) + struct.pack("<I12fH", count, 0, 0, 1, *np.ravel(CORNERS), 0) + behind
    )


@pytest.mark.parametrize(
    "content", [ASCII.encode(), ASCII.replace("\n", "\r\n").encode(), binary(), binary(1, b"end")]
)
def test_stl(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.STL"
    path.write_bytes(content)
    assert load_mesh(path).tolist() == [CORNERS]


def test_obj_opens_no_other_file(tmp_path: Path) -> None:
    path = tmp_path / "a.obj"
    path.write_text(QUAD)
    triangles = load_mesh(path)
    assert triangles.shape == (2, 3, 3)
    # Two triangles of half of 2 m x 1 m each.
    edges = np.diff(triangles, axis=1)
    assert np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / 2 == pytest.approx([1, 1])
    assert triangles.reshape(-1, 3).max(axis=0).tolist() == [2, 1, 0]


@pytest.mark.parametrize(("unit", "scale"), [("", 1.0), ('<unit meter="0.01" name="cm"/>', 0.01)])
def test_dae_applies_unit_and_nodes_but_no_up_axis(tmp_path: Path, unit: str, scale: float) -> None:
    path = tmp_path / "a.dae"
    path.write_text(dae(unit=unit))
    (part,) = load_parts(path)
    assert part.name == "plate"
    # The matrix maps (x, y, z) to (10 - y, 20 + x, 30 + z): x 9 to 10, y 20 to 22, z 30.
    corners = part.triangles.reshape(-1, 3)
    assert corners.min(axis=0) == pytest.approx(scale * np.array([9.0, 20.0, 30.0]))
    assert corners.max(axis=0) == pytest.approx(scale * np.array([10.0, 22.0, 30.0]))
    assert load_mesh(path).shape == (2, 3, 3)


def doubling(levels: int) -> str:
    """Nodes that hold the one before twice: 2**levels in all."""
    inner = '<node id="n0"><instance_geometry url="#g"/></node>'
    for level in range(levels):
        inner += f'<node id="n{level + 1}">' + f'<instance_node url="#n{level}"/>' * 2 + "</node>"
    return f"<library_nodes>{inner}</library_nodes>"


def test_dae_with_instances(tmp_path: Path) -> None:
    path = tmp_path / "a.dae"
    path.write_text(dae(nodes=doubling(3), more='<node name="x"><instance_node url="#n3"/></node>'))
    assert [part.name for part in load_parts(path)] == ["plate", *["x"] * 8]
    path.write_text(dae(nodes=doubling(40), more='<node><instance_node url="#n40"/></node>'))
    with pytest.raises(InputError, match=r"a\.dae: its scene has more than 20000 nodes"):
        load_mesh(path)


ENTITY = '<!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/hostname">]>'


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.dae", dae(head=ENTITY).encode(), "must not hold a DOCTYPE"),
        ("a.dae", b"<COLLADA/>", "has no scene"),
        (
            "a.dae",
            dae(unit='<unit meter="nan"/>').encode(),
            "unit: meter = 'nan': must be a number",
        ),
        ("a.dae", dae().replace("1 2 3<", "1 2 9<").encode(), "is no whole mesh: "),
        ("a.dae", dae().replace("polylist", "lines").encode(), "holds no triangles|no whole mesh"),
        ("a.dae", dae().replace("0 0 0 2", "0 1e9 0 2").encode(), "must lie within 1e\\+06 m"),
        ("a.stl", b"", "holds no triangles|no whole mesh"),
        ("a.stl", b"version https://git-lfs.github.com/spec/v1", "holds no triangles|no whole"),
        ("a.stl", binary(2), "holds no triangles|no whole mesh"),
        ("a.obj", b"v 0 0 0\n", "holds no triangles"),
        ("a.obj", b"v 0 0 0\nf 1 2 3\n", "is no whole mesh: "),
        ("a.obj", b"\nf 1 2 3" * 2_000_001, "has more than 2000000 triangles"),
        ("a.fbx", b"", "allowed meshes: .stl, .obj, .dae"),
        ("none/a.stl", None, "cannot be read: No such file or directory"),
    ],
)
def test_what_is_refused(tmp_path: Path, name: str, content: bytes | None, message: str) -> None:
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=message) as error:
        load_mesh(path)
    assert str(error.value).startswith(str(path))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(("library", "name"), [("trimesh", "a.stl"), ("collada", "a.dae")])
def test_without_the_libraries(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, library: str, name: str
) -> None:
    (tmp_path / name).write_bytes(dae().encode())
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(InputError, match=r"meshes need trimesh and pycollada: pip install 'pm01"):
        load_mesh(tmp_path / name)
