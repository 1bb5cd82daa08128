# SPDX-License-Identifier: Apache-2.0
"""Worlds written as SDF and read back."""

from __future__ import annotations

import shutil
import subprocess
import warnings
from pathlib import Path
from xml.etree.ElementTree import fromstring

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pm01_nav.geometry import rectangle
from pm01_nav.worlds.mover import Mover
from pm01_nav.worlds.sdf import read_sdf
from pm01_nav.worlds.sdf_writer import world_to_sdf
from pm01_nav.worlds.world import OccupancyGrid, World

BOUNDS = (0.0, 0.0, 10.0, 8.0)
WALLS = np.array([[0.0, 0.0, 3.0, 4.0], [5.0, 5.0, 5.0, 5.0]])


def read_back(folder: Path, world: World) -> World:
    path = folder / "w.sdf"
    path.write_text(world_to_sdf(world), encoding="utf-8")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return read_sdf(path, strict=True).world


def ring(polygon: np.ndarray) -> np.ndarray:
    """The corners from the lowest one on, counter-clockwise: equal for equal polygons."""
    x, y = polygon.T
    if np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) < 0.0:
        polygon = polygon[::-1]
    keys = polygon.round(5)
    return np.roll(polygon, -np.lexsort((keys[:, 0], keys[:, 1]))[0], axis=0)


def test_parts_of_the_file() -> None:
    text = world_to_sdf(World("hall 2", BOUNDS, discs=np.array([[1.0, 2.0, 0.25]])))
    root = fromstring(text)
    assert root.get("version") == "1.9"
    world = root.find("world")
    assert world is not None
    assert world.get("name") == "hall_2"
    assert [light.get("name") for light in world.iter("light")] == ["sun"]
    assert [m.get("name") for m in world.iter("model")] == ["ground_plane", "obstacles"]
    for kind in ("collision", "visual"):
        (disc,) = world.findall(f"model[@name='obstacles']/link/{kind}")
        assert disc.findtext("geometry/cylinder/radius") == "0.25"
        # 1 m high, on the ground.
        assert disc.findtext("pose") == "1.0 2.0 0.5 0.0 0.0 0.0"


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_round_trip(
    any_world: st.SearchStrategy[World], tmp_path: Path, data: st.DataObject
) -> None:
    world = data.draw(any_world)
    read = read_back(tmp_path, world)
    still = [(*m.points[0], m.radius) for m in world.movers if m.motion != "spline"]
    discs = np.concatenate([world.discs, np.array(still).reshape(-1, 3)])
    assert read.discs == pytest.approx(discs, abs=1e-9)
    walls = [wall_box(*wall) for wall in world.segments]
    left = [ring(polygon) for polygon in (*world.polygons, *walls)]
    for polygon in read.polygons:
        twins = [k for k, other in enumerate(left) if same(ring(polygon), other)]
        assert twins
        left.pop(twins[0])
    assert not left
    for name in ("bounds", "start", "start_area", "goal_area"):
        assert getattr(read, name) == getattr(world, name)


def same(one: np.ndarray, other: np.ndarray) -> bool:
    return one.shape == other.shape and np.allclose(one, other, rtol=0.0, atol=2e-6)


def wall_box(x1: float, y1: float, x2: float, y2: float) -> np.ndarray:
    """A wall as a rectangle of 2 cm around it; a point as a square."""
    along = np.array([x2 - x1, y2 - y1])
    length = np.hypot(*along)
    ahead = np.array([1.0, 0.0]) if length == 0 else along / length
    middle, half = np.array([x1 + x2, y1 + y2]) / 2, max(length, 0.02) / 2
    left = 0.01 * np.array([-ahead[1], ahead[0]])
    return np.array(
        [middle + s * half * ahead + t * left for s, t in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    )


def test_walls_become_boxes(tmp_path: Path) -> None:
    wall, point = read_back(tmp_path, World("w", BOUNDS, segments=WALLS)).polygons
    # From (0, 0) to (3, 4), 5 m: its left is (-0.8, 0.6), of which 1 cm to each side.
    assert ring(wall) == pytest.approx(
        np.array([[0.008, -0.006], [3.008, 3.994], [2.992, 4.006], [-0.008, 0.006]])
    )
    assert ring(point) == pytest.approx(rectangle(5.0, 5.0, 0.02, 0.02))


def test_grid_becomes_few_boxes(tmp_path: Path) -> None:
    cells = np.zeros((5, 6), dtype=np.uint8)
    cells[1:4, 2:4] = cells[0, 5] = 1
    world = World("w", BOUNDS, grid=OccupancyGrid(cells, 0.5, (1.0, 2.0)))
    block, cell = sorted(read_back(tmp_path, world).polygons, key=lambda p: p[0, 0])
    # Columns 2 and 3 from x = 2 to 3, rows 1 to 3 from y = 2.5 to 4.
    assert ring(block) == pytest.approx(np.array([[2, 2.5], [3, 2.5], [3, 4], [2, 4]]))
    assert ring(cell) == pytest.approx(np.array([[3.5, 2], [4, 2], [4, 2.5], [3.5, 2.5]]))


def test_spline_is_an_actor_and_others_stand(tmp_path: Path) -> None:
    points, times = np.array([[1.0, 2.0], [3.0, 2.0], [3.0, 4.0]]), np.array([0.0, 1.0, 2.5])
    spline = Mover("spline", 0.35, points, times=times)
    walker = Mover("pedestrian", 0.25, points, speed=1.0)
    world = read_back(tmp_path, World("w", BOUNDS, movers=(walker, spline)))
    (mover,) = world.movers
    assert (mover.motion, mover.radius) == ("spline", 0.35)
    assert mover.points.tolist() == points.tolist()
    assert mover.times.tolist() == times.tolist()
    assert world.discs.tolist() == [[1.0, 2.0, 0.25]]


@pytest.mark.parametrize("name", ["", "a\x00b", "<&\"'>", "办公室", "x" * 300])
def test_any_name_gives_well_formed_xml(tmp_path: Path, name: str) -> None:
    assert read_back(tmp_path, World(name, BOUNDS, segments=WALLS)).bounds == BOUNDS


@pytest.mark.skipif(shutil.which("gz") is None and shutil.which("ign") is None, reason="no Gazebo")
def test_libsdformat_finds_it_valid(tmp_path: Path) -> None:
    arrow = np.array([[1.0, 1.0], [3.0, 0.5], [2.0, 1.0], [3.0, 1.5]])
    mover = Mover("spline", 0.3, arrow[:2], times=np.array([0.0, 2.0]))
    standing = Mover("loop", 0.3, arrow, speed=1.0)
    cells = OccupancyGrid(np.eye(3, dtype=np.uint8), 0.5, (6.0, 6.0))
    world = World(
        *("w", BOUNDS),
        discs=np.array([[5.0, 5.0, 0.3]]),
        polygons=(arrow, rectangle(7.0, 2.0, 1.0, 0.5, 0.4)),
        segments=WALLS,
        grid=cells,
        movers=(mover, standing),
        start=(1.0, 4.0, 0.0),
    )
    (tmp_path / "w.sdf").write_text(world_to_sdf(world))
    command = ["gz" if shutil.which("gz") else "ign", "sdf", "-k", str(tmp_path / "w.sdf")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.stdout.strip() == "Valid."
    assert "Warning" not in done.stderr
