# SPDX-License-Identifier: Apache-2.0
"""Where to drive: a region that a person names, and a warning where walls enclose other places."""

from __future__ import annotations

import numpy as np
import pytest

from pm01_nav.errors import InputError
from pm01_nav.geometry import rectangle
from pm01_nav.worlds.grid import OccupancyGrid
from pm01_nav.worlds.pool import build_pool
from pm01_nav.worlds.region import drive_within, starts_outside
from pm01_nav.worlds.world import World

RADIUS = 0.27


def house(door: float, *, seen: bool = True, side: int = 400) -> World:
    """A map of 20 m x 20 m: a house of 8 m x 6 m with a door of this width; the rest is lawn.

    Where it is not ``seen``, the lawn is unknown.
    """
    cells = np.zeros((side, side), dtype=np.uint8) if seen else np.ones((side, side), np.uint8)
    cells[100:220, 120:280] = 1
    cells[102:218, 122:278] = 0
    cells[100:102, 200 : 200 + round(door / 0.05)] = 0
    return World("house", (0, 0, 20, 20), grid=OccupancyGrid(cells, 0.05, (0, 0), closed=True))


def starts(world: World) -> np.ndarray:
    return build_pool([world], RADIUS).arrays.starts


def test_region_bounds_starts_goals_and_the_ways_between() -> None:
    world = drive_within(house(1.0), (6.0, 5.0, 14.0, 11.0))
    arrays = build_pool([world], RADIUS).arrays
    for places in (arrays.starts, arrays.goals):
        # The house's inner walls stand at x = 6.1 and 13.9, y = 5.1 and 10.9.
        assert (places >= [6.1 + RADIUS - 1e-9, 5.0]).all()
        assert (places <= [13.9 - RADIUS + 1e-9, 10.9 - RADIUS + 1e-9]).all()


@pytest.mark.parametrize(
    ("region", "words"),
    [
        ((1.0, 5.0, 1.0, 9.0), "region = 1 5 1 9: must be x_min y_min x_max y_max"),
        ((3.0, 9.0, 5.0, 7.0), "region = 3 9 5 7: must be"),
        ((20.0, 0.0, 30.0, 5.0), "lies beside world house, which spans 0 0 20 20"),
    ],
)
def test_wrong_region(region: tuple[float, float, float, float], words: str) -> None:
    with pytest.raises(InputError, match=words):
        drive_within(house(1.0), region)


def test_start_must_be_in_the_region() -> None:
    world = World("w", (0, 0, 9, 9), start=(1.0, 1.0, 0.0))
    with pytest.raises(
        InputError, match=r"region = 2 2 5 5: the start of world w, .* is not in it"
    ):
        drive_within(world, (2.0, 2.0, 5.0, 5.0))


@pytest.mark.parametrize("door", [0.0, 1.0])
def test_lawn_outside_a_house_is_warned_of(door: float) -> None:
    world = house(door)
    warning = starts_outside(world, starts(world))
    assert warning is not None
    # With a closed door all starts lie outside, 400 m² - 48 m² of lawn. With an open one the robot
    # gets in: of the places for a disc of 0.27 m, (20 - 0.54)² - 8.54 x 6.54 = 322.8 m² lie
    # outside and (7.8 - 0.54) x (5.8 - 0.54) = 38.2 m² inside: 89 %.
    assert warning.startswith(f"house: {100 if door == 0.0 else 89} % of the starts lie outside")
    # Around the room, to half a raster's cell or so.
    numbers = [float(word) for word in warning.split('"')[-2].split()]
    assert numbers == pytest.approx([6.1, 5.1, 13.9, 10.9], abs=0.15)
    # There the robot stays inside.
    part = drive_within(world, (6.0, 5.0, 14.0, 11.0))
    assert starts_outside(world, starts(part)) is None


def test_region_that_holds_more_lawn_than_room_is_not_suggested() -> None:
    # An L of corridors 2 m wide and 12 m long: in the rectangle around it there is mostly lawn.
    walls = np.ones((400, 400), dtype=np.uint8)
    walls[60:102, 60:302] = walls[60:302, 60:102] = 2
    cells = (walls == 2).astype(np.uint8)
    cells[61:101, 61:301] = cells[61:301, 61:101] = 0
    world = World("angle", (0, 0, 20, 20), grid=OccupancyGrid(cells, 0.05, (0, 0), closed=True))
    warning = starts_outside(world, starts(world))
    assert warning is not None
    assert warning.endswith("says where to drive")


def test_what_nobody_has_seen_is_no_lawn() -> None:
    world = house(0.0, seen=False)
    assert starts_outside(world, starts(world)) is None


def test_corridor_that_ends_at_the_edge_of_a_map_is_not_outside() -> None:
    # A room of 6 m x 6 m, and a corridor of 2 m from it to the edge of the image.
    cells = np.ones((200, 300), dtype=np.uint8)
    cells[40:160, 40:160] = cells[80:120, 160:] = 0
    cells[40:160, 98:101] = 1
    cells[60:80, 98:101] = 0
    world = World("hall", (0, 0, 15, 10), grid=OccupancyGrid(cells, 0.05, (0, 0), closed=True))
    assert starts_outside(world, starts(world)) is None


def test_a_world_at_the_end_of_all_coordinates_is_not_looked_at() -> None:
    wall = rectangle(1e7 - 5.0, 0.0, 4.0, 4.0)
    world = World("far", (1e7 - 10.0, -5.0, 1e7, 5.0), polygons=(wall,))
    assert starts_outside(world, starts(world)) is None


def test_margin_around_an_arena_is_warned_of() -> None:
    # Walls of 0.2 m around 6 m x 6 m, with 4 m of margin: more of it than of the arena, which is
    # 20 m² for the robot.
    walls = [rectangle(0.0, s * 3.0, 6.2, 0.2) for s in (-1, 1)]
    walls += [rectangle(s * 3.0, 0.0, 0.2, 6.2) for s in (-1, 1)]
    world = World("arena", (-7.0, -7.0, 7.0, 7.0), polygons=tuple(walls))
    warning = starts_outside(world, starts(world))
    assert warning is not None
    assert warning.startswith("arena: 100 % of the starts")


@pytest.mark.parametrize("walls", [True, False])
def test_a_room_and_an_open_field_are_as_they_should_be(walls: bool) -> None:
    rng = np.random.default_rng(3)
    discs = np.column_stack([rng.uniform(1, 9, (12, 2)), rng.uniform(0.15, 0.4, 12)])
    edges = np.array([[0, 0, 10, 0], [10, 0, 10, 10], [10, 10, 0, 10], [0, 10, 0, 0]], dtype=float)
    world = World("w", (0, 0, 10, 10), discs=discs, segments=edges if walls else edges[:0])
    assert starts_outside(world, starts(world)) is None
