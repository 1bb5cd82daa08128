# SPDX-License-Identifier: Apache-2.0
"""The readers of the BARN dataset, on tiny worlds in its layout."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pm01_nav.errors import InputError
from pm01_nav.worlds.barn import load_barn, read_barn_world, read_path_length

GROUND = "<collision name='c'><geometry><plane><size>9 9</size></plane></geometry></collision>"
CYLINDER = "<cylinder><radius>0.075</radius><length>1</length></cylinder>"


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "cache"
    monkeypatch.setenv("PM01_CACHE", str(folder))
    return folder / "barn"


def model(pose: str, shape: str = CYLINDER, name: str = "unit_cylinder_0") -> str:
    return f"""<model name='{name}'><static>1</static><pose frame=''>{pose}</pose>
      <link name='link'><collision name='collision'><geometry>{shape}</geometry></collision>
      <visual name='visual'><geometry>{shape}</geometry></visual></link></model>"""


def sdf(*models: str) -> str:
    """Return a world as BARN writes it: sun, ground, models, and a state that repeats them."""
    return f"""<sdf version='1.6'><world name='default'><light name='sun' type='directional'/>
      <model name='ground_plane'><link name='link'>{GROUND}</link></model>{"".join(models)}
      <state world_name='default'><model name='unit_cylinder_0'><pose frame=''>9 9 0 0 0 0</pose>
      </model></state></world></sdf>"""


def write_world(folder: Path, text: str | bytes | None = None, index: int = 7) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"world_{index}.world"
    text = sdf(model("-1.5 6.0 0.0 0.0 0.0 0.0")) if text is None else text
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def write_path(folder: Path, cells: object = ((10, 0), (10, 20)), index: int = 7) -> Path:
    folder = folder / "path_files"
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"path_{index}.npy"
    np.save(path, np.asarray(cells))
    return path


def refused(path: Path, *words: str) -> None:
    with pytest.raises(InputError) as problem:
        read_barn_world(path)
    assert "\n" not in str(problem.value)
    for word in (str(path), *words):
        assert word in str(problem.value)


def load_refused(folder: Path, *words: str) -> None:
    with pytest.raises(InputError) as problem:
        load_barn(folder)
    for word in (str(folder), *words):
        assert word in str(problem.value)


def test_cylinders_become_discs(tmp_path: Path) -> None:
    text = sdf(model("-1.5 6.0 0 0 0 0"), model("-3.0 8.25 0 0 0 1.0"))
    world = read_barn_world(write_world(tmp_path, text))
    assert world.name == "barn_7"
    assert world.discs.tolist() == [[-1.5, 6.0, 0.075], [-3.0, 8.25, 0.075]]
    assert world.start == (-2.25, 3.0, 1.57)
    assert world.goal_area == (-2.25, 13.0, -2.25, 13.0)


def test_bounds_hold_walls_start_and_goal_with_a_margin(tmp_path: Path) -> None:
    x_min, y_min, x_max, y_max = read_barn_world(write_world(tmp_path)).bounds
    # Walls from x = -4.5 to 0 and y = 0 to 9.6; start y = 3, goal y = 13; 1 m around them.
    assert (x_min, y_min, x_max, y_max) == (-5.5, -1.0, 1.0, 14.0)


def test_link_and_collision_poses_add_up(tmp_path: Path) -> None:
    # The model is turned by 90 deg, so (0.5, 0) and (0, 0.25) in it point to (0, 0.5), (-0.25, 0).
    text = sdf(
        f"""<model name='m'><pose>-2 5 0 0 0 {np.pi / 2}</pose><link name='l'>
        <pose>0.5 0 0 0 0 0</pose><collision name='c'><pose>0 0.25 0 0 0 0</pose>
        <geometry>{CYLINDER}</geometry></collision></link></model>"""
    )
    world = read_barn_world(write_world(tmp_path, text))
    assert world.discs == pytest.approx(np.array([[-2.25, 5.5, 0.075]]), abs=1e-12)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.99])
def test_world_file_cut_short(tmp_path: Path, share: float) -> None:
    text = sdf(model("-1.5 6 0 0 0 0"))
    refused(write_world(tmp_path, text[: int(share * len(text))]), "is not a whole XML file")


def solid(shape: str) -> str:
    return sdf(model("-1.5 6 0 0 0 0", shape))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "not a whole XML file"),
        ("hello", "not a whole XML file"),
        (sdf(model("-1.5 6 0 0 0 0"))[:-5], "not a whole XML file"),
        ("<sdf/>", "must hold <world>"),
        (sdf(), "holds no cylinder"),
        (sdf().encode("utf-16"), "UTF-8"),
        ("<!DOCTYPE sdf [<!ENTITY a 'ha'>]><sdf><world>&a;</world></sdf>", "DOCTYPE"),
        (sdf(model("nan 6 0 0 0 0")), "unit_cylinder_0': pose = 'nan 6 0 0 0 0': must be 6 finite"),
        (sdf(model("-1.5 1e999 0 0 0 0")), "must be 6 finite"),
        (sdf(model("-1.5 6")), "must be 6 finite"),
        (sdf(model("a b c d e f")), "must be 6 finite"),
        (sdf(model("")), "must be 6 finite"),
        (sdf(model("-1.5 6 0 0.5 0 0")), "unit_cylinder_0': pose: must be upright"),
        (sdf(model("11 6 0 0 0 0")), "unit_cylinder_0': pose = (11, 6): must lie within"),
        (solid("<cylinder><radius>0</radius></cylinder>"), "radius = 0.0: must be above 0"),
        (solid("<cylinder><radius>-0.1</radius></cylinder>"), "radius = -0.1: must be above 0"),
        (solid("<cylinder><radius>nan</radius></cylinder>"), "radius = 'nan': must be 1 finite"),
        (solid("<cylinder><radius/></cylinder>"), "radius = '': must be 1 finite"),
        (solid("<cylinder/>"), "radius = '': must be 1 finite"),
        (solid("<box><size>1 1 1</size></box>"), "'unit_cylinder_0': must be made of cylinders"),
        (sdf("<include><uri>model://cafe_table</uri></include>"), "'model://cafe_table'"),
        (sdf(f"<model name='pair'>{model('0 6 0 0 0 0')}</model>"), "'pair': must not hold"),
        (sdf(model("0 6 0 0 0 0")).replace("frame=''", "frame='table'"), "another frame"),
    ],
)
def test_wrong_world_file(tmp_path: Path, text: str | bytes, words: str) -> None:
    refused(write_world(tmp_path, text), words)


def test_world_file_with_a_wrong_name(tmp_path: Path) -> None:
    refused(write_world(tmp_path).rename(tmp_path / "lab.world"), "world_<i>.world")


def test_missing_world_file(tmp_path: Path) -> None:
    refused(tmp_path / "world_3.world", "cannot be read")


def test_path_length_counts_start_and_goal(tmp_path: Path) -> None:
    path = write_path(tmp_path, [[15, 0], [15, 30]])
    # The cells lie at x = -4.575 + 15 * 0.15 = -2.325, y = 5.075 and 5.075 + 4.5 = 9.575.
    # From (-2.25, 3): hypot(0.075, 2.075); then 4.5; to (-2.25, 13): hypot(0.075, 3.425).
    expected = np.sqrt(0.075**2 + 2.075**2) + 4.5 + np.sqrt(0.075**2 + 3.425**2)
    assert read_path_length(path) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(
    "cells",
    [
        [1.0, 2.0],
        [[1, 2, 3]],
        [[0.0, np.nan]],
        [[0, np.iinfo(np.int64).min]],
        [["a", "b"]],
        np.zeros((0, 2)),
        np.array([[{}, {}]]),  # Needs pickle.
    ],
)
def test_path_must_hold_cells(tmp_path: Path, cells: object) -> None:
    path = write_path(tmp_path, cells)
    with pytest.raises(InputError, match=path.name):
        read_path_length(path)


def test_path_cut_short(tmp_path: Path) -> None:
    path = write_path(tmp_path)
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(InputError, match=r"path_7\.npy"):
        read_path_length(path)


@pytest.mark.parametrize("layout", ["", "worlds/BARN", "BARN_dataset/world_files"])
def test_load_finds_and_sorts_worlds(tmp_path: Path, layout: str) -> None:
    data = tmp_path / "data"
    for index in (10, 9, 100):
        text = sdf(model(f"-{index / 100} 6 0 0 0 0"))
        write_world(data / layout, text, index)
        # 0.15 m a cell: the longer the index, the further the only cell lies from the way.
        write_path(data, [[15 - index / 10, 0]], index)
    barn = load_barn(data)
    assert barn.indices == (9, 10, 100)
    assert [world.name for world in barn.worlds] == ["barn_9", "barn_10", "barn_100"]
    assert [world.discs[0, 0] for world in barn.worlds] == [-0.09, -0.1, -1.0]
    lengths = [world.reference_length for world in barn.worlds]
    assert lengths == sorted(lengths)
    assert len(lengths) == 3


def make_set(folder: Path) -> Path:
    write_world(folder, sdf(model("-1 6 0 0 0 0"), model("-2 6 0 0 0 0")), 3)
    write_world(folder, sdf(model("-3 6 0 0 0 0")), 4)
    write_path(folder, index=3)
    write_path(folder, [[0, 0]], index=4)
    return folder


def test_second_load_is_equal_and_reads_no_world(
    tmp_path: Path, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    data = make_set(tmp_path / "data")
    first = load_barn(data)
    assert [path.suffix for path in cache.iterdir()] == [".npz"]
    monkeypatch.setattr("pm01_nav.worlds.barn.read_barn_world", None)
    second = load_barn(data)
    assert second.indices == first.indices == (3, 4)
    lengths = [[world.reference_length for world in barn.worlds] for barn in (first, second)]
    assert lengths[0] == lengths[1]
    for one, other in zip(first.worlds, second.worlds, strict=True):
        assert one.discs.tolist() == other.discs.tolist()
        assert (one.name, one.bounds) == (other.name, other.bounds)
        assert (one.start, one.goal_area) == (other.start, other.goal_area)


def test_changed_world_is_read_again(tmp_path: Path) -> None:
    data = make_set(tmp_path / "data")
    load_barn(data)
    write_world(data, sdf(model("-3.25 6 0 0 0 0"), model("-1 7 0 0 0 0")), 4)
    assert load_barn(data).worlds[1].discs.tolist() == [[-3.25, 6.0, 0.075], [-1.0, 7.0, 0.075]]


@pytest.mark.parametrize("damage", [b"", b"nonsense", None])
def test_damaged_cache_is_made_again(tmp_path: Path, cache: Path, damage: bytes | None) -> None:
    data = make_set(tmp_path / "data")
    first = load_barn(data)
    (kept,) = cache.iterdir()
    whole = kept.read_bytes()
    kept.write_bytes(whole[: len(whole) // 2] if damage is None else damage)
    assert load_barn(data).worlds[0].discs.tolist() == first.worlds[0].discs.tolist()
    with np.load(kept) as file:
        assert file["indices"].tolist() == [3, 4]


def test_load_works_without_a_place_for_the_cache(tmp_path: Path, cache: Path) -> None:
    cache.parent.write_text("a file where the folder should be")
    assert load_barn(make_set(tmp_path / "data")).indices == (3, 4)


def test_load_folder_without_worlds(tmp_path: Path) -> None:
    load_refused(tmp_path, "world_<i>.world")
    load_refused(tmp_path / "nowhere", "existing folder")


def test_load_without_a_path_file(tmp_path: Path) -> None:
    data = make_set(tmp_path / "data")
    (data / "path_files" / "path_4.npy").unlink()
    load_refused(data, "path_files/path_4.npy is missing")


def test_load_names_the_damaged_world(tmp_path: Path) -> None:
    data = make_set(tmp_path / "data")
    path = data / "world_4.world"
    path.write_text(path.read_text()[:300])
    load_refused(data, "world_4.world", "not a whole XML file")


def test_load_two_worlds_of_one_index(tmp_path: Path) -> None:
    data = make_set(tmp_path / "data")
    write_world(data / "DynaBARN", index=4)
    load_refused(data, "two files world_4.world")


@settings(
    max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    place=st.integers(0, 2000),
    cut=st.integers(0, 8),
    patch=st.sampled_from([b"", b"<", b">", b"nan", b"&a;", b"<model>", b"</pose>"]) | st.binary(),
    of_path=st.booleans(),
)
def test_any_file_gives_a_world_or_an_input_error(
    tmp_path: Path, place: int, cut: int, patch: bytes, of_path: bool
) -> None:
    data = tmp_path / "data"
    path, cells = write_world(data), write_path(data)
    damaged = cells if of_path else path
    content = damaged.read_bytes()
    place %= len(content)
    damaged.write_bytes(content[:place] + patch + content[place + cut :])
    try:
        barn = load_barn(data)
    except InputError:
        return
    assert barn.indices == (7,)
    assert all(np.isfinite(world.reference_length) for world in barn.worlds)
