# SPDX-License-Identifier: Apache-2.0
"""Worlds as YAML: what a person writes, exact round trips, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pm01_nav.errors import InputError
from pm01_nav.worlds.mover import Mover
from pm01_nav.worlds.world import OccupancyGrid, World
from pm01_nav.worlds.yaml_world import read_yaml_world, world_to_yaml, write_yaml_world

LAB = """
name: lab
bounds: [0, 0, 8, 6]
start: [1, 1, 0.5]
goal_area: [6, 4, 7, 5]
discs:
- [3, 2, 0.4]
boxes:
- {x: 2, y: 4, length: 2, width: 1}
polygons:
- [[5, 1], [6, 1], [6, 2]]
segments:
- [0, 0, 8, 0]
movers:
- {motion: loop, radius: 0.3, speed: 1e-1, points: [[3, 4], [4, 4]]}
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "lab.yaml"
    path.write_text(text)
    return path


def same(one: World, other: World) -> None:
    """Fail unless the worlds agree to the last bit."""
    assert repr((one.name, one.bounds, one.start, one.goal_area)) == repr(
        (other.name, other.bounds, other.start, other.goal_area)
    )
    for a, b in ((one.discs, other.discs), (one.segments, other.segments)):
        assert a.tobytes() == b.tobytes()
    assert [p.tobytes() for p in one.polygons] == [p.tobytes() for p in other.polygons]
    for a, b in zip(one.movers, other.movers, strict=True):
        assert a.points.tobytes() == b.points.tobytes()
        assert a.times.tobytes() == b.times.tobytes()
        assert repr((a.motion, a.radius, a.speed, a.heading)) == repr(
            (b.motion, b.radius, b.speed, b.heading)
        )


def test_what_a_person_writes(tmp_path: Path) -> None:
    world = read_yaml_world(write(tmp_path, LAB))
    assert (world.name, world.bounds) == ("lab", (0.0, 0.0, 8.0, 6.0))
    assert (world.start, world.goal_area) == ((1.0, 1.0, 0.5), (6.0, 4.0, 7.0, 5.0))
    assert world.discs.tolist() == [[3.0, 2.0, 0.4]]
    assert world.segments.tolist() == [[0.0, 0.0, 8.0, 0.0]]
    triangle, box = world.polygons
    assert triangle.tolist() == [[5.0, 1.0], [6.0, 1.0], [6.0, 2.0]]
    # Around (2, 4): 1 m to each side along x, 0.5 m along y.
    assert box.tolist() == [[1.0, 3.5], [3.0, 3.5], [3.0, 4.5], [1.0, 4.5]]
    (mover,) = world.movers
    assert (mover.motion, mover.radius, mover.speed) == ("loop", 0.3, 0.1)
    assert mover.points.tolist() == [[3.0, 4.0], [4.0, 4.0]]


def test_name_is_the_files_if_not_given(tmp_path: Path) -> None:
    assert read_yaml_world(write(tmp_path, "bounds: [0, 0, 1, 1]")).name == "lab"


@settings(
    max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_round_trip_is_exact(
    any_world: st.SearchStrategy[World], tmp_path: Path, data: st.DataObject
) -> None:
    world = data.draw(any_world)
    write_yaml_world(world, tmp_path / "w.yaml")
    same(read_yaml_world(tmp_path / "w.yaml"), world)


@settings(
    max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    name=st.text(st.characters(exclude_categories=["Cs"])),
    x=st.floats(-1e7, 1e7),
    radius=st.floats(5e-324, 1e7),
)
def test_round_trip_of_any_number_and_name(
    tmp_path: Path, name: str, x: float, radius: float
) -> None:
    # 0.1 + 0.2, the smallest double, -0.0: all as they are.
    discs = np.array([[x, -0.0, radius], [0.1 + 0.2, 1e-7, 1.0]])
    mover = Mover("bounce", 0.5, np.array([[x, 1.0]]), speed=radius, heading=-0.0)
    world = World(name, (0.0, 0.0, 1.0, 1.0), discs=discs, movers=(mover,))
    write_yaml_world(world, tmp_path / "w.yaml")
    same(read_yaml_world(tmp_path / "w.yaml"), world)


def test_grid_goes_into_a_map_beside(tmp_path: Path) -> None:
    cells = np.array([[1, 0, 0], [0, 0, 1]], dtype=np.uint8)
    grid = OccupancyGrid(cells, 0.1, (0.1 + 0.2, -0.7))
    world = World("w", (0.0, -1.0, 1.0, 1.0), discs=np.array([[0.5, 0.5, 0.1]]), grid=grid)
    write_yaml_world(world, tmp_path / "w.yaml")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["w.yaml", "w_map.pgm", "w_map.yaml"]
    read = read_yaml_world(tmp_path / "w.yaml")
    same(read, world)
    assert read.grid is not None
    assert read.grid.occupied.tolist() == cells.tolist()
    assert (read.grid.origin, read.grid.resolution) == (grid.origin, grid.resolution)


def test_bounds_are_the_maps_if_not_given(tmp_path: Path) -> None:
    cells = np.array([[1, 0, 0], [0, 0, 1]], dtype=np.uint8)
    world = World("w", (0, 0, 1, 1), grid=OccupancyGrid(cells, 0.5, (2.0, 3.0)))
    write_yaml_world(world, tmp_path / "w.yaml")
    assert read_yaml_world(write(tmp_path, "map: w_map.yaml")).bounds == (2.0, 3.0, 3.5, 4.0)


def test_text_alone_cannot_hold_a_grid() -> None:
    grid = OccupancyGrid(np.zeros((2, 2), dtype=np.uint8), 0.1, (0.0, 0.0))
    with pytest.raises(InputError, match="its grid does not fit into YAML"):
        world_to_yaml(World("w", (0.0, 0.0, 1.0, 1.0), grid=grid))


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        (("bounds: [0, 0, 8, 6]", ""), "bounds: is missing; give x_min"),
        (("bounds: [0, 0, 8, 6]", "bounds: [0, 0, 8]"), "bounds.3: is missing"),
        (("name: lab", "label: lab"), "label: unknown key; allowed here: name, bounds"),
        (("[3, 2, 0.4]", "[3, 2, -0.4]"), r"discs\[0\]: radius = -0.4: must be positive"),
        (("[3, 2, 0.4]", "[3, .nan, 0.4]"), "discs.0.1 = nan: input should be a finite number"),
        (("[3, 2, 0.4]", "[3, 2, wide]"), "discs.0.2 = 'wide': input should be a valid number"),
        (("length: 2", "length: -2"), "boxes.0.length = -2: input should be greater than 0"),
        (("length: 2", "hoogte: 2"), "boxes.0.length: is missing"),
        (("[6, 2]]", "[5, 1]]"), r"polygons\[0\]: encloses no area"),
        (("[5, 1], [6, 1], [6, 2]", "[5, 1], [6, 3], [6, 1], [5, 2]"), "crosses or touches"),
        (("motion: loop", "motion: fly"), "movers.0.motion = 'fly': input should be 'bounce'"),
        (("speed: 1e-1", "speed: 0"), r"movers\[0\]: mover: speed = 0.0: must be above 0"),
        (("points: [[3, 4], [4, 4]]", "points: [[3, 4]]"), "a loop needs 2 or more"),
        (("start: [1, 1, 0.5]", "map: none.yaml"), "none.yaml: cannot be read"),
        (("name: lab", "name: &a lab\nmap: *a"), r"must not use YAML aliases \(\*a\)"),
        (("name: lab", "name: lab\nname: hall"), "the key 'name' stands twice"),
    ],
)
def test_refused(tmp_path: Path, changed: tuple[str, str], words: str) -> None:
    assert changed[0] in LAB
    path = write(tmp_path, LAB.replace(*changed))
    with pytest.raises(InputError, match=words) as problem:
        read_yaml_world(path)
    assert "\n" not in str(problem.value)
    assert str(path.parent) in str(problem.value)
