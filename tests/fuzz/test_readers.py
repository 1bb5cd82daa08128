# SPDX-License-Identifier: Apache-2.0
"""Whatever a file holds, a reader returns a valid world or raises an ``InputError``.

``PM01_FUZZ_EXAMPLES=20000 pytest tests/fuzz`` runs that many inputs through each reader; the
summary says how many there were and what became of them.
"""

from __future__ import annotations

import io
import json
import os
import re
import warnings
from collections import Counter
from collections.abc import Callable, Iterable
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pm01_nav.errors import InputError
from pm01_nav.worlds.barn import read_barn_world, read_path_length
from pm01_nav.worlds.dynabarn import read_dynabarn
from pm01_nav.worlds.files import read_world
from pm01_nav.worlds.grid import MAX_COORDINATE
from pm01_nav.worlds.pool import find_places
from pm01_nav.worlds.region import drive_within, starts_outside
from pm01_nav.worlds.world import MAX_OBSTACLES, World

EXAMPLES = int(os.environ.get("PM01_FUZZ_EXAMPLES", "60"))
Seen = Counter[tuple[str, str]]

fuzz = settings(
    max_examples=EXAMPLES,
    # A hang, not slowness: an input takes milliseconds.
    deadline=timedelta(seconds=20),
    suppress_health_check=list(HealthCheck),
)

YAML = b"""name: lab
bounds: [0, 0, 6, 5]
start: [1, 1, 0.5]
goal_area: [4, 4, 5, 4.5]
discs:
- [3, 2, 0.4]
boxes:
- {x: 2, y: 3.5, length: 1.0, width: 0.5, yaw: 0.3}
polygons:
- [[4, 1], [5, 1], [5, 2], [4.5, 1.5]]
segments: [[0, 0, 6, 0]]
map: map.yaml
movers:
- {motion: bounce, radius: 0.2, points: [[3, 4]], speed: 0.5, heading: 1.0}
- {motion: spline, radius: 0.2, points: [[3, 4], [4, 4], [3, 4]], times: [0, 1, 2.5]}
"""
MAP = b"""image: map.pgm
resolution: 0.5
origin: [-1.0, -1.0, 0.0]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.25
mode: trinary
"""
PGM = b"P5\n# map\n8 6\n255\n" + bytes(range(0, 240, 5))
SDF = b"""<?xml version="1.0"?><sdf version="1.9"><world name="w"><include><uri>model://table</uri>
<pose>2 2 0 0 0 0.5</pose></include><model name="m"><pose degrees="true">1 1 0.5 0 0 90</pose>
<link name="l"><pose>0 0 0 0.1 0 0</pose><collision name="c"><geometry><box><size>1 2 1</size></box>
</geometry></collision></link><model name="n"><link name="l"><visual name="v"><geometry>
<sphere><radius>0.4</radius></sphere></geometry></visual></link></model></model>
<model name="p"><link name="l"><collision name="c"><pose rotation_format="quat_xyzw">0 0 0 0 0 0 1
</pose><geometry><polyline><point>4 4</point><point>5 4</point><point>5 5</point><height>1</height>
</polyline></geometry></collision><collision name="d"><geometry><mesh><uri>a.stl</uri>
<scale>1 2 1</scale><submesh><name>a</name><center>1</center></submesh></mesh></geometry>
</collision></link></model><frame name="f" attached_to="m"><pose>1 0 0 0 0 1</pose></frame>
<model name="q" placement_frame="j"><pose relative_to="f">2 0 0 0 0 0</pose><link name="l">
<collision name="c"><pose relative_to="k">0 0 0 0 0 0</pose><geometry><ellipsoid><radii>1 2 1
</radii></ellipsoid></geometry></collision></link><link name="k"><pose relative_to="l">0 1 0 0 0 0
</pose></link><joint name="j" type="revolute"><child>k</child></joint><include merge="true">
<uri>model://table</uri><placement_frame>l</placement_frame></include><plugin name="diff_drive"/>
</model><population name="a"/><road name="r"/><state world_name="w"><model name="m">
<pose>0 1 0 0 0 0</pose><scale>1 1 2</scale><link name="l"><pose>0 1 0.5 0 0 0</pose></link>
<model name="n"><pose>3 3 0 0 0 0</pose></model></model>
<insertions><model name="i"><link name="l"/></model></insertions>
<deletions><name>p</name></deletions></state>
<actor name="a"><script><loop>true</loop><trajectory id="0">
<waypoint><time>0</time><pose>1 2 0 0 0 0</pose></waypoint><waypoint><time>2</time>
<pose>3 2 0 0 0 0</pose></waypoint></trajectory></script></actor></world></sdf>"""
TABLE = b"""<sdf version="1.6"><model name="table"><link name="l"><collision name="c"><geometry>
<cylinder><radius>0.3</radius><length>1</length></cylinder></geometry></collision></link></model>
</sdf>"""
STL = b"""solid a
facet normal 0 0 1 outer loop vertex 0 0 0 vertex 2 0 0.2 vertex 0 1 0.6 endloop endfacet
facet normal 0 1 0 outer loop vertex 1 2 0 vertex 3 2 0 vertex 2 2 1 endloop endfacet
endsolid a
"""
CONFIG = b"<model><name>table</name><sdf version='1.6'>model.sdf</sdf></model>"
BARN = b"""<sdf version='1.6'><world name='default'><model name='u'>
<pose frame=''>-1.5 6 0 0 0 0</pose><link name='l'><collision name='c'><geometry>
<cylinder><radius>0.075</radius></cylinder></geometry>
</collision></link></model></world></sdf>"""
DYNABARN = json.dumps(
    {
        "radius": 0.5,
        "walls_cx_cy_sx_sy": [[-10, 0, 0.5, 20], [0, 10, 20, 0.5]],
        "start": [8, 0, 3.14],
        "goal": [-9, 0],
        "worlds": [{"id": 0, "obstacles": ["a", "b"]}, {"id": 1, "obstacles": []}],
        "trajectories": {"a": [[0, 1, 2], [1.5, 2, 3]], "b": [[0, 1, 2], [1, 5, 5], [3, 1, 2]]},
    }
).encode()


def npy(array: Any) -> bytes:
    content = io.BytesIO()
    np.save(content, np.asarray(array))
    return content.getvalue()


GRID = np.zeros((30, 30), dtype=np.int64)
GRID[[0, -1]] = 1
GRID[10:13, 5:8] = 1

NASTY = [
    *(b"", b"0", b"-1", b"nan", b".nan", b"inf", b"1e999", b"-1e300", b"1e-320", b"1e7", b"1e6"),
    *(b"99999999999999999999", b"0x10", b"1_000", b"null", b"true", b"~", b"[]", b"{}", b"''"),
    *(b"[", b"]", b"{", b"}", b"*a", b"&a ", b"<<: ", b"!!python/object:os.system ", b"- ", b": "),
    *(b"<", b">", b"</model>", b"<model>", b"<!DOCTYPE a>", b"&lt;", b"&#0;", b"<![CDATA[", b"--"),
    *(b"<include><uri>model://../x</uri></include>", b"<include><uri>/etc</uri></include>"),
    *(b"<include><uri>model://table</uri></include>", b"relative_to='x'", b"degrees='true'"),
    *(
        b"<!-- -- -->",
        b"&",
        b"&a;",
        b"<x:y/>",
        b"text <?xml version='1.0'?>",
        b"<state>",
        b"</state>",
    ),
    *(b"\x00", b"\xff\xfe", b"\xef\xbb\xbf", b"\r\n", b"\t", b"/dev/zero", b"map.yaml", b"\x85"),
    *(b"[" * 300, b"<a>" * 300, b'{"a":' * 300, b"2001-99-99", b"0o9", b"1:60:99", b"=", b"? "),
]


@st.composite
def mutated(draw: st.DrawFn, content: bytes) -> bytes:
    """A valid file with a few changes, or no valid file at all."""
    kind = draw(st.sampled_from(["numbers", "numbers", "bytes", "bytes", "noise"]))
    if kind == "noise":
        return draw(st.binary(max_size=400))
    for _ in range(draw(st.integers(1, 4))):
        content = draw(renumbered(content) if kind == "numbers" else patched(content))
    return content


@st.composite
def renumbered(draw: st.DrawFn, content: bytes) -> bytes:
    """The same file with another number somewhere."""
    places = [match.span() for match in re.finditer(rb"-?[0-9]+(\.[0-9]+)?", content)]
    if not places:
        return content
    start, end = draw(st.sampled_from(places))
    number = draw(st.floats(-10, 10) | st.integers(-3, 9) | st.floats())
    return content[:start] + repr(number).encode() + content[end:]


@st.composite
def patched(draw: st.DrawFn, content: bytes) -> bytes:
    """The same file with a piece cut out, put in, or repeated."""
    start = draw(st.integers(0, max(len(content) - 1, 0)))
    end = start + draw(st.sampled_from([0, 0, 1, 1, 2, 3, 8, 40]))
    patch = draw(
        st.sampled_from(NASTY)
        | st.binary(max_size=3)
        | st.integers(-5, 5).map(lambda number: str(number).encode())
        | st.just(content[end : end + 60])
    )
    return content[:start] + patch + content[end:]


numbers = st.floats(allow_nan=True, width=64) | st.integers(-10, 10) | st.floats(-20, 20)


def rows(count: int) -> st.SearchStrategy[Any]:
    return st.lists(st.lists(numbers, min_size=count, max_size=count), max_size=6)


anything: st.SearchStrategy[Any] = st.recursive(
    st.none() | st.booleans() | numbers | st.text(max_size=8) | st.dates(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=6), inner),
    max_leaves=8,
)
movers = st.fixed_dictionaries(
    {
        "motion": st.sampled_from(["bounce", "loop", "spline", "pedestrian", "fly"]),
        "radius": st.floats(0.01, 1) | numbers,
        "points": rows(2) | rows(2) | anything,
    },
    optional={"speed": numbers, "heading": numbers, "times": st.lists(numbers) | anything},
)
world_files = st.fixed_dictionaries(
    {"bounds": st.just([-20, -20, 20, 20]) | st.lists(numbers, min_size=4, max_size=4)},
    optional={
        "name": st.text(max_size=6) | anything,
        "discs": rows(3) | st.lists(st.tuples(st.floats(-9, 9), st.floats(-9, 9), st.just(0.3))),
        "polygons": st.lists(rows(2), max_size=4) | anything,
        "segments": rows(4) | anything,
        "boxes": st.lists(
            st.fixed_dictionaries(
                {"x": numbers, "y": numbers, "length": numbers, "width": numbers},
                optional={"yaw": numbers},
            ),
            max_size=3,
        ),
        "movers": st.lists(movers, max_size=3),
        "start": st.lists(numbers, min_size=3, max_size=3) | anything,
        "goal_area": st.lists(numbers, min_size=4, max_size=4) | anything,
        "map": st.sampled_from(["map.yaml", "lab.yaml", "/dev/null", "..", "\x00"]) | anything,
    },
).map(lambda data: yaml.dump(json_like(data)).encode("utf-8", "surrogateescape"))


def json_like(value: Any) -> Any:
    """Tuples become lists, so that YAML needs no tags for them."""
    if isinstance(value, dict):
        return {key: json_like(inner) for key, inner in value.items()}
    return [json_like(inner) for inner in value] if isinstance(value, (list, tuple)) else value


TAGS = (
    *(
        "world",
        "model",
        "link",
        "collision",
        "visual",
        "geometry",
        "include",
        "uri",
        "pose",
        "actor",
    ),
    *(
        "box",
        "size",
        "cylinder",
        "radius",
        "length",
        "sphere",
        "plane",
        "normal",
        "polyline",
        "point",
    ),
    *(
        "height",
        "capsule",
        "ellipsoid",
        "radii",
        "mesh",
        "script",
        "trajectory",
        "waypoint",
        "time",
    ),
    *("cone", "heightmap", "empty", "population", "state", "frame", "loop", "placement_frame"),
    *("joint", "child", "scale", "submesh", "center", "insertions", "deletions", "name", "plugin"),
    *("sensor", "road", "light", "static"),
)
WORDS = (
    *("0", "1", "0.5", "-2", "1e9", "1e-9", "nan", "true", "", "1 1 1", "2 3", "0 0 0 0 0 0"),
    *("1 2 0.2 0 0 1", "0 0 1 1.57 0 0", "model://table", "model://sun", "file://lab.sdf"),
    *("https://x/y", "https://x/1.0/o/models/table", "a.stl", "a::b", "l", "__model__", "world"),
)
words = st.sampled_from(WORDS)


def element(tag: str, inner: list[str], text: str, attributes: str) -> str:
    return f"<{tag} {attributes}>{text}{''.join(inner)}</{tag}>"


elements = st.recursive(
    st.builds(element, st.sampled_from(TAGS), st.just([]), words, st.just("name='a'")),
    lambda inner: st.builds(
        element,
        st.sampled_from(TAGS),
        st.lists(inner, max_size=4),
        words,
        st.sampled_from(
            [
                "",
                "name='b'",
                "relative_to='a'",
                "relative_to='a::b'",
                "attached_to='b'",
                "placement_frame='b'",
                "merge='true'",
                "tension='1'",
                "degrees='true'",
                "x:y='1'",
            ]
        ),
    ),
    max_leaves=20,
)
SHAPES = (
    *(
        "<box><size>{}</size></box>",
        "<sphere><radius>{}</radius></sphere>",
        "<polyline>{}</polyline>",
    ),
    "<cylinder><radius>{}</radius><length>1</length></cylinder>",
    "<capsule><radius>0.2</radius><length>{}</length></capsule>",
    "<ellipsoid><radii>{}</radii></ellipsoid>",
    "<polyline><point>0 0</point><point>1 0</point><point>{}</point><height>1</height></polyline>",
)
triples = st.lists(numbers, min_size=1, max_size=3).map(lambda row: " ".join(map(repr, row)))
poses = st.lists(numbers, min_size=6, max_size=6).map(lambda row: " ".join(map(repr, row))) | words
solids = st.builds(
    lambda shape, size, pose: (
        f"<model name='m'><pose>{pose}</pose><link name='l'><collision name='c'><geometry>"
        f"{shape.format(size)}</geometry></collision></link></model>"
    ),
    st.sampled_from(SHAPES),
    triples | words,
    poses,
)
sdf_files = st.lists(solids | elements, max_size=5).map(
    lambda parts: f"<sdf version='1.7'><world name='w'>{''.join(parts)}</world></sdf>".encode()
)


def check(world: World) -> None:
    """Fail unless a simulator can use the world."""
    arrays = [world.discs, world.all_segments, *(m.points for m in world.movers)]
    for array in arrays:
        assert np.isfinite(array).all()
        assert (np.abs(array) <= MAX_COORDINATE).all()
        assert len(array) <= MAX_OBSTACLES
    assert (world.discs[:, 2] > 0).all()
    x_min, y_min, x_max, y_max = world.bounds
    if (x_max - x_min) * (y_max - y_min) < 1000:
        try:
            places = find_places(world, 0.2, np.random.default_rng(0), 100)
        except InputError:
            return
        assert len(places.goals) > 0
        warning = starts_outside(world, places.starts)
        assert warning is None or "\n" not in warning


def drive(seen: Seen, reader: str, read: Callable[[], Iterable[World]]) -> None:
    """Read, and count what came of it."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            worlds = list(read())
    except InputError as error:
        problem = str(error)
    else:
        problem = ""
    if problem:
        assert "\n" not in problem
        seen[reader, "refused"] += 1
        return
    seen[reader, "world"] += 1
    for world in worlds:
        check(world)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with a whole file of each kind, so that a mutated one can refer to others."""
    (tmp_path / "table").mkdir()
    for name, content in (
        ("lab.yaml", YAML),
        ("map.yaml", MAP),
        ("map.pgm", PGM),
        ("lab.sdf", SDF),
        ("a.stl", STL),
        ("table/model.sdf", TABLE),
        ("table/model.config", CONFIG),
    ):
        (tmp_path / name).write_bytes(content)
    return tmp_path


@fuzz
@given(content=mutated(YAML) | world_files)
def test_yaml_world(folder: Path, seen: Seen, content: bytes) -> None:
    path = folder / "world.yaml"
    path.write_bytes(content)
    drive(seen, "yaml world", lambda: [read_world(path)])


map_files = st.builds(
    lambda origin, negate, thresholds, mode: (
        f"image: map.pgm\nresolution: 0.5\norigin: [{origin}]\nnegate: {negate}\n"
        f"free_thresh: {thresholds[0]}\noccupied_thresh: {thresholds[1]}\nmode: {mode}\n"
    ).encode(),
    st.lists(numbers, min_size=3, max_size=3).map(lambda row: ", ".join(map(repr, row))),
    st.sampled_from(["0", "1", "true", "2"]),
    st.lists(st.floats(0, 1), min_size=2, max_size=2).map(sorted),
    st.sampled_from(["trinary", "scale", "raw", "Trinary", "none"]),
)


@fuzz
@given(content=map_files, region=st.none() | st.tuples(numbers, numbers, numbers, numbers))
def test_turned_map(
    folder: Path, seen: Seen, content: bytes, region: tuple[float, float, float, float] | None
) -> None:
    (folder / "map.yaml").write_bytes(content)
    (folder / "map.pgm").write_bytes(PGM)

    def read() -> list[World]:
        world = read_world(folder / "map.yaml")
        return [world if region is None else drive_within(world, region)]

    drive(seen, "turned map", read)


@fuzz
@given(data=st.data(), name=st.sampled_from(["map.yaml", "map.pgm"]))
def test_ros_map(folder: Path, seen: Seen, data: st.DataObject, name: str) -> None:
    (folder / "map.yaml").write_bytes(MAP)
    (folder / "map.pgm").write_bytes(PGM)
    (folder / name).write_bytes(data.draw(mutated(MAP if name == "map.yaml" else PGM)))
    drive(seen, "ROS map", lambda: [read_world(folder / "map.yaml")])


@fuzz
@given(
    content=mutated(SDF) | sdf_files,
    options=st.sampled_from([{}, {"strict": True}, {"partial": True}, {"partial": True}]),
)
def test_sdf(folder: Path, seen: Seen, content: bytes, options: dict[str, bool]) -> None:
    path = folder / "world.sdf"
    path.write_bytes(content)
    drive(seen, "SDF", lambda: [read_world(path, **options)])


@fuzz
@given(content=mutated(STL))
def test_mesh_of_a_world(folder: Path, seen: Seen, content: bytes) -> None:
    (folder / "mesh").mkdir(exist_ok=True)
    path = folder / "mesh" / "lab.sdf"
    path.write_bytes(SDF)
    (folder / "mesh" / "a.stl").write_bytes(content)
    drive(
        seen,
        "SDF mesh",
        lambda: [read_world(path, model_folders=[folder], partial=True)],
    )


@fuzz
@given(data=st.data(), name=st.sampled_from(["model.sdf", "model.config"]))
def test_included_model(folder: Path, seen: Seen, data: st.DataObject, name: str) -> None:
    table = folder / "table"
    (table / "model.sdf").write_bytes(TABLE)
    (table / "model.config").write_bytes(CONFIG)
    (table / name).write_bytes(data.draw(mutated(TABLE if name == "model.sdf" else CONFIG)))
    drive(seen, "SDF include", lambda: [read_world(folder / "lab.sdf")])


@fuzz
@given(content=mutated(BARN))
def test_barn_world(folder: Path, seen: Seen, content: bytes) -> None:
    path = folder / "world_1.world"
    path.write_bytes(content)
    drive(seen, "BARN world", lambda: [read_barn_world(path)])


arrays = st.builds(
    lambda grid, kind, change: npy(change(grid.astype(kind))),
    st.just(GRID),
    st.sampled_from(["int64", "uint8", "float32", "bool", "complex64", "U3", "float16", ">i4"]),
    st.sampled_from(
        [lambda g: g, lambda g: g[1:], lambda g: g[:, :0], lambda g: g.T, lambda g: g[None]]
    ),
)


def with_flips(cells: list[tuple[int, int]]) -> bytes:
    grid = GRID.copy()
    for row, column in cells:
        grid[row, column] = 1 - grid[row, column]
    return npy(grid)


flipped = st.lists(st.tuples(st.integers(0, 29), st.integers(0, 29))).map(with_flips)


@fuzz
@given(content=mutated(npy(GRID)) | arrays | flipped)
def test_barn_grid(folder: Path, seen: Seen, content: bytes) -> None:
    path = folder / "grid_1.npy"
    path.write_bytes(content)
    drive(seen, "BARN grid", lambda: [read_world(path)])


@fuzz
@given(content=mutated(npy([[15, 0], [15, 30]])))
def test_barn_path(folder: Path, seen: Seen, content: bytes) -> None:
    path = folder / "path_1.npy"
    path.write_bytes(content)

    def read() -> list[World]:
        assert np.isfinite(read_path_length(path))
        return []

    drive(seen, "BARN path", read)


@fuzz
@given(content=mutated(DYNABARN))
def test_dynabarn(folder: Path, seen: Seen, content: bytes) -> None:
    path = folder / "dynabarn.json"
    path.write_bytes(content)
    drive(seen, "DynaBARN", lambda: read_dynabarn(path))
