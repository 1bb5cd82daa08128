# SPDX-License-Identifier: Apache-2.0
"""SDF worlds: shapes, poses, heights, includes and actors; what is skipped and what refused."""

from __future__ import annotations

import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pm01_nav.errors import InputError
from pm01_nav.worlds import sdf_include
from pm01_nav.worlds.sdf import read_sdf
from pm01_nav.worlds.world import World

BOX = "<box><size>2 1 1</size></box>"
CYLINDER = "<cylinder><radius>0.3</radius><length>1</length></cylinder>"
MESH = "<mesh><uri>model://a/b.dae</uri></mesh>"


def part(shape: str, pose: str = "", kind: str = "collision") -> str:
    return f"<{kind} name='c'>{pose}<geometry>{shape}</geometry></{kind}>"


def model(content: str, pose: str = "0 0 0.5 0 0 0", name: str = "m") -> str:
    content = (
        content
        if content.startswith(("<link", "<model", "<include"))
        else (f"<link name='link'>{content}</link>")
    )
    return f"<model name='{name}'><pose>{pose}</pose>{content}</model>"


def sdf(*content: str) -> str:
    return f"<sdf version='1.9'><world name='hall'>{''.join(content)}</world></sdf>"


def read(folder: Path, text: str, **options: Any) -> World:
    path = folder / "hall.sdf"
    path.write_text(text)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return read_sdf(path, **options).world


def refused(folder: Path, text: str, words: str, **options: Any) -> None:
    with pytest.raises(InputError, match=words) as problem:
        read(folder, text, **options)
    assert "\n" not in str(problem.value)
    assert "hall.sdf" in str(problem.value)


def corners(world: World) -> list[list[float]]:
    (polygon,) = world.polygons
    return sorted(polygon.round(9).tolist())


def test_upright_shapes(tmp_path: Path) -> None:
    text = sdf(
        model(part(BOX), "3 4 0.5 0 0 0"),
        model(part(CYLINDER), "1 2 0.5 0 0 0.7"),
        model(part("<sphere><radius>0.4</radius></sphere>"), "5 5 0.25 0 0 0"),
        model(part("<capsule><radius>0.2</radius><length>1</length></capsule>"), "7 5 0.5 0 0 0"),
        model(part("<plane><normal>0 0 1</normal></plane>"), "0 0 0 0 0 0"),
    )
    world = read(tmp_path, text)
    assert world.name == "hall"
    assert corners(world) == [[2, 3.5], [2, 4.5], [4, 3.5], [4, 4.5]]
    # The sphere's centre lies in the band: its whole width counts.
    assert world.discs.tolist() == [[1, 2, 0.3], [5, 5, 0.4], [7, 5, 0.2]]
    # 1 m around the extent: x 0.7 to 7.2, y 1.7 to 5.4.
    assert world.bounds == pytest.approx((-0.3, 0.7, 8.2, 6.4))
    assert (world.start, world.goal_area) == (None, None)


def test_poses_add_up_and_turn(tmp_path: Path) -> None:
    # The model is turned by 90 degrees: (1, 0) in it points to (0, 1), so the link stands at
    # (3, 5), the collision 0.5 m further along -x of the world. There the box lies across.
    inner = (
        f"<link name='l'><pose>1 0 0 0 0 0</pose>{part(BOX, '<pose>0 0.5 0 0 0 0</pose>')}</link>"
    )
    world = read(tmp_path, sdf(model(inner, f"3 4 0.5 0 0 {np.pi / 2}")))
    assert corners(world) == [[2, 4], [2, 6], [3, 4], [3, 6]]


def test_degrees_and_quaternions(tmp_path: Path) -> None:
    quarter = "<pose degrees='true'>0 0 0.5 0 0 90</pose>"
    world = read(
        tmp_path, sdf(f"<model name='m'>{quarter}<link name='l'>{part(BOX)}</link></model>")
    )
    assert corners(world) == [[-0.5, -1], [-0.5, 1], [0.5, -1], [0.5, 1]]
    # A quarter turn about z: (0, 0, sin 45 deg, cos 45 deg), here of length 2.
    half = np.sqrt(2.0)
    pose = f"<pose rotation_format='quat_xyzw'>0 0 0.5 0 0 {half} {half}</pose>"
    world = read(tmp_path, sdf(f"<model name='m'>{pose}<link name='l'>{part(BOX)}</link></model>"))
    assert corners(world) == [[-0.5, -1], [-0.5, 1], [0.5, -1], [0.5, 1]]


def test_nested_models(tmp_path: Path) -> None:
    inner = model(part(CYLINDER), "1 0 0 0 0 0", "inner")
    world = read(tmp_path, sdf(model(inner, f"2 2 0.5 0 0 {np.pi}")))
    assert world.discs == pytest.approx(np.array([[1.0, 2.0, 0.3]]))


def test_visuals_count_where_nothing_can_be_touched(tmp_path: Path) -> None:
    both = part(CYLINDER) + part(BOX, kind="visual")
    world = read(tmp_path, sdf(model(both), model(part(BOX, kind="visual"), "5 5 0.5 0 0 0")))
    assert len(world.discs) == 1
    assert corners(world) == [[4, 4.5], [4, 5.5], [6, 4.5], [6, 5.5]]


def test_polyline_stands_on_its_origin(tmp_path: Path) -> None:
    points = "".join(f"<point>{p}</point>" for p in ("0 0", "1 0", "1 1", "0 0"))
    line = f"<polyline>{points}<height>0.4</height></polyline>"
    world = read(tmp_path, sdf(model(part(line), "2 3 0 0 0 0")))
    assert [p.tolist() for p in world.polygons] == [[[2, 3], [3, 3], [3, 4]]]
    # At z = -0.5 it ends at -0.1, below the ground.
    refused(tmp_path, sdf(model(part(line), "2 3 -0.5 0 0 0")), "holds no obstacle between")


@pytest.mark.parametrize(
    ("z", "seen"),
    # The cylinder reaches 0.5 m up and down; what only touches the band is not in it, and what
    # reaches up to 3 cm is driven over.
    [(1.0, False), (0.99, True), (-0.5, False), (-0.47, False), (-0.46, True), (3.0, False)],
)
def test_only_what_reaches_the_band(tmp_path: Path, z: float, seen: bool) -> None:
    text = sdf(model(part(CYLINDER), f"1 2 {z} 0 0 0"), model(part(BOX)))
    assert len(read(tmp_path, text).discs) == seen


def test_band_can_be_chosen(tmp_path: Path) -> None:
    text = sdf(model(part(CYLINDER), "1 2 2 0 0 0"), model(part(BOX)))
    world = read(tmp_path, text, z_min=1.6, z_max=1.7)
    assert len(world.discs) == 1
    assert not world.polygons
    with pytest.raises(InputError, match="z_min = 1, z_max = 1: must be finite and z_min below"):
        read(tmp_path, text, z_min=1, z_max=1)


def test_sphere_is_as_wide_as_in_the_band(tmp_path: Path) -> None:
    # 0.5 m of radius, the centre 0.3 m above the band: sqrt(0.25 - 0.09) = 0.4.
    text = sdf(model(part("<sphere><radius>0.5</radius></sphere>"), "1 2 0.8 0 0 0"))
    assert read(tmp_path, text).discs == pytest.approx(np.array([[1.0, 2.0, 0.4]]))


def test_box_tilted_by_a_quarter_turn(tmp_path: Path) -> None:
    # Pitched by 90 degrees the box of 2 x 1 x 1 stands on its end: 1 x 1 on the floor.
    world = read(tmp_path, sdf(model(part(BOX), f"0 0 0.5 0 {np.pi / 2} 0")))
    assert corners(world) == [[-0.5, -0.5], [-0.5, 0.5], [0.5, -0.5], [0.5, 0.5]]


@pytest.mark.parametrize("tilt", ["0.3 0 0", "0 0.8 0.4", "1.2 -0.5 2.0"])
@pytest.mark.parametrize("shape", [BOX, CYLINDER])
def test_tilted_shape_covers_all_its_points_in_the_band(
    tmp_path: Path, tilt: str, shape: str
) -> None:
    world = read(tmp_path, sdf(model(part(shape), f"1 2 0.3 {tilt}")))
    roll, pitch, yaw = map(float, tilt.split())
    rng = np.random.default_rng(0)
    inside = rng.uniform(-1, 1, (3000, 3)) * ([1, 0.5, 0.5] if shape == BOX else [0.3, 0.3, 0.5])
    if shape == CYLINDER:
        inside = inside[np.hypot(inside[:, 0], inside[:, 1]) <= 0.3]
    # Roll about x, then pitch about y, then yaw about z: row by row, without matrices.
    x, y, z = inside.T
    y, z = np.cos(roll) * y - np.sin(roll) * z, np.sin(roll) * y + np.cos(roll) * z
    x, z = np.cos(pitch) * x + np.sin(pitch) * z, -np.sin(pitch) * x + np.cos(pitch) * z
    x, y = np.cos(yaw) * x - np.sin(yaw) * y, np.sin(yaw) * x + np.cos(yaw) * y
    # Between 3 cm, which wheels drive over, and 0.5 m, where the band ends.
    high = 0.3 + z
    x, y = x[(high > 0.03) & (high < 0.5)], y[(high > 0.03) & (high < 0.5)]
    (hull,) = world.polygons
    edges = np.roll(hull, -1, axis=0) - hull
    for point in np.column_stack([x + 1, y + 2]):
        left = edges[:, 0] * (point - hull)[:, 1] - edges[:, 1] * (point - hull)[:, 0]
        assert (left >= -1e-9).all()
    # And not much more than them: the area is at most that of the points' own box.
    area = 0.5 * np.sum(hull[:, 0] * np.roll(hull[:, 1], -1) - hull[:, 1] * np.roll(hull[:, 0], -1))
    assert area <= np.ptp(x) * np.ptp(y) * 1.3


def test_unsupported_geometry_is_named(tmp_path: Path) -> None:
    text = sdf(model(part(MESH), name="table"), model(part(CYLINDER)))
    (tmp_path / "hall.sdf").write_text(text)
    reading = read_sdf(tmp_path / "hall.sdf")
    assert len(reading.world.discs) == 1
    lost = "mesh 'model://a/b.dae' not found (model 'table': link 'link')"
    assert (reading.notes, reading.summary) == ((f"lost: {lost}",), "hall.sdf: read 1 of 2 shapes")
    refused(tmp_path, text, rf"not supported: {re.escape(lost)}", strict=True)


def test_tilted_shape_that_rounding_leaves_no_area(tmp_path: Path) -> None:
    # A nanometre at 100 000 km from the origin: all its corners are the same number.
    grain = part("<box><size>1e-9 1e-9 1e-9</size></box>")
    text = sdf(model(grain, "1e8 1e8 0.2 0.5 0 0"), model(part(BOX)))
    refused(tmp_path, text, "not supported: shape too thin to have a floor area", strict=True)


def include(uri: str, pose: str = "") -> str:
    pose = f"<pose>{pose}</pose>" if pose else ""
    return f"<include><uri>{uri}</uri>{pose}</include>"


def make_model(folder: Path, name: str, content: str, file: str = "model.sdf") -> None:
    (folder / name).mkdir(parents=True, exist_ok=True)
    (folder / name / file).write_text(f"<sdf version='1.6'>{content}</sdf>")


def test_included_models(tmp_path: Path) -> None:
    make_model(tmp_path / "models", "post", model(part(CYLINDER), "9 9 0.5 0 0 0"))
    make_model(tmp_path, "beside", model(include("model://post", "1 0 0 0 0 0"), "0 5 0.5 0 0 0"))
    text = sdf(
        include("model://post", f"1 2 0.5 0 0 {np.pi}"),
        include("model://beside"),
        include("model://sun"),
        include("model://ground_plane"),
    )
    world = read(tmp_path, text, model_folders=[tmp_path / "models"])
    # The pose of the include replaces the model's own; without one that of the model counts.
    assert world.discs.round(9).tolist() == [[1, 2, 0.3], [1, 5, 0.3]]


def test_model_config_names_the_file(tmp_path: Path) -> None:
    make_model(tmp_path, "post", model(part(BOX)), "model.sdf")
    make_model(tmp_path, "post", model(part(CYLINDER)), "post-1_6.sdf")
    (tmp_path / "post" / "model.config").write_text(
        "<model><sdf version='1.4'>model.sdf</sdf><sdf version='1.6'>post-1_6.sdf</sdf></model>"
    )
    assert len(read(tmp_path, sdf(include("model://post"))).discs) == 1


def test_relative_file(tmp_path: Path) -> None:
    make_model(tmp_path, "post", model(part(CYLINDER)), "post.sdf")
    for uri in ("post/post.sdf", "file://post/post.sdf"):
        assert len(read(tmp_path, sdf(include(uri))).discs) == 1


@pytest.mark.parametrize(
    ("uri", "words"),
    [
        ("model://table", r"include 'model://table': no such model in .*; give its folder"),
        ("model://../secret", "leads out of the model folders"),
        ("../secret/model.sdf", "leads out of the model folders"),
        ("/etc/passwd", "leads out of the model folders"),
        ("file:///etc/passwd", "leads out of the model folders"),
        ("model://link", "leads out of the model folders"),
        ("model://config", "leads out of the model folders"),
        ("https://fuel.example/1.0/me/models/table", "no such model"),
        ("model://itself", "more than 8 files include each other"),
        ("model://broken", "is not a whole XML file"),
        ("", "no such model"),
        ("model://" + "a" * 5000, "no such model"),
    ],
)
def test_include_refused(tmp_path: Path, uri: str, words: str) -> None:
    world, secret = tmp_path / "world", tmp_path / "secret"
    make_model(tmp_path, "secret", model(part(CYLINDER)))
    make_model(world, "itself", model(include("model://itself")))
    make_model(world, "config", "")
    (world / "config" / "model.config").write_text(
        "<model><sdf>../../secret/model.sdf</sdf></model>"
    )
    (world / "link").symlink_to(secret)
    make_model(world, "broken", "<model>")
    refused(world, sdf(include(uri), model(part(BOX))), words)


def test_models_that_repeat_each_other_without_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sdf_include, "MAX_INCLUDES", 500)
    # Six files that include the next one 30 times: 30^6 = 7e8 models.
    for level in range(6):
        inner = include(f"model://level{level + 1}") * 30
        make_model(tmp_path, f"level{level}", f"<model name='m'>{inner}</model>")
    make_model(tmp_path, "level6", model(part(CYLINDER)))
    refused(tmp_path, sdf(include("model://level0")), "more than 500 models")


ACTOR = """<actor name='walker'><skin><filename>walk.dae</filename></skin><script>
<trajectory id='0' type='walk'><waypoint><time>0</time><pose>1 2 1 0 0 0</pose></waypoint>
<waypoint><time>1.5</time><pose>3 2 1 0 0 1</pose></waypoint></trajectory></script></actor>"""


def test_actor_becomes_a_spline(tmp_path: Path) -> None:
    (mover,) = read(tmp_path, sdf(ACTOR)).movers
    assert (mover.motion, mover.radius) == ("spline", 0.3)
    assert mover.points.tolist() == [[1, 2], [3, 2]]
    assert mover.times.tolist() == [0, 1.5]
    sized = ACTOR.replace("</actor>", f"<link name='l'>{part(CYLINDER)}</link></actor>")
    assert read(tmp_path, sdf(sized.replace("0.3", "0.45"))).movers[0].radius == 0.45


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        (("<script>", "<script><loop>false</loop>"), "does not loop"),
        (("<script>", "<script><delay_start>2</delay_start>"), "delay_start is not 0"),
        (("id='0'", "id='0' tension='0.5'"), "tension is not 0"),
        (("<skin>", "<pose>1 0 0 0 0 0</pose><skin>"), "its own pose is not 0"),
        (("<time>1.5</time>", "<time>0</time>"), "its waypoints are not"),
        (("<time>0</time>", "<time>1</time>"), "its waypoints are not"),
        (("</trajectory>", "</trajectory><trajectory id='1'/>"), "2 trajectories instead of one"),
    ],
)
def test_other_actors_are_skipped(tmp_path: Path, changed: tuple[str, str], words: str) -> None:
    text = sdf(ACTOR.replace(*changed), model(part(CYLINDER)))
    refused(tmp_path, text, f"actor 'walker': {words}", strict=True)
    reading = read_sdf(tmp_path / "hall.sdf")
    assert reading.world.movers == ()
    assert words in reading.notes[0]


def posed(attributes: str, text: str = "0 0 0 0 0 0") -> str:
    return (
        f"<model name='m'><pose {attributes}>{text}</pose><link name='l'>{part(BOX)}</link></model>"
    )


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "not a whole XML file"),
        ("<world/>", "must be <sdf>, not <world>"),
        ("<!DOCTYPE a [<!ENTITY b 'c'>]><sdf/>", "DOCTYPE"),
        ("<a>" * 65 + "</a>" * 65, "nested more than 64 deep"),
        (sdf(), r"holds no obstacle between the heights 0.0 and 0.5 m"),
        (sdf(posed("relative_to='door'")), "relative_to = 'door': no such frame"),
        (sdf(posed("", "0 0 0")), "pose = '0 0 0': must be 6 number"),
        (sdf(posed("", "0 0 0 nan 0 0")), "must be 6 number"),
        (sdf(posed("rotation_format='quat_xyzw'")), "must be 7 number"),
        (sdf(posed("rotation_format='quat_xyzw'", "0 0 0 0 0 0 0")), "must have length 1"),
        (sdf("<model name='m' placement_frame='a'/>"), "relative_to = 'a': no such frame"),
        (sdf(model(part("<box><size>1 1</size></box>"))), "box = '1 1': must be 3 number"),
        (sdf(model(part("<box><size>1 -1 1</size></box>"))), "box = .*: must be above 0"),
        (sdf(model(part("<box/>"))), "box = '': must be 3 number"),
        (sdf(model(part("<cylinder><radius>1</radius></cylinder>"))), "length = ''"),
        (sdf(model(part("<sphere><radius>1e999</radius></sphere>"))), "radius = '1e999'"),
        (sdf(model(part("<sphere><radius>9e8</radius></sphere>"))), "world hall: discs: 9"),
        (
            sdf(model(part("<polyline><point>0 0</point><height>1</height></polyline>"))),
            "3 or more",
        ),
    ],
)
def test_refused(tmp_path: Path, text: str, words: str) -> None:
    refused(tmp_path, text, words)


def test_model_folder_must_exist(tmp_path: Path) -> None:
    (tmp_path / "hall.sdf").write_text(sdf())
    with pytest.raises(InputError, match=r"model folder .*nowhere: must be an existing folder"):
        read_sdf(tmp_path / "hall.sdf", model_folders=[tmp_path / "nowhere"])
