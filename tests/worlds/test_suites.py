# SPDX-License-Identifier: Apache-2.0
"""The generated worlds: repeatable, within the declared laws, and solvable."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from pm01_nav.errors import InputError
from pm01_nav.worlds.pool import generate_pool
from pm01_nav.worlds.suites import suites
from pm01_nav.worlds.suites.barn_like import barn_like
from pm01_nav.worlds.suites.dynabarn_like import dynabarn_like
from pm01_nav.worlds.suites.open import article, empty, static
from pm01_nav.worlds.world import World

Generator = Callable[[np.random.Generator], World]


def draw(generator: Generator, count: int) -> list[World]:
    return [generator(np.random.default_rng(seed)) for seed in range(count)]


def test_table_names_every_suite() -> None:
    assert set(suites()) >= {"empty", "static", "article", "barn_like"}


@pytest.mark.parametrize("name", sorted(suites()))
def test_most_draws_can_be_crossed(name: str) -> None:
    assert len(generate_pool(suites()[name].generator, range(5), radius=0.21)) == 5


def test_empty_room_is_closed() -> None:
    world = empty(np.random.default_rng(0))
    assert world.bounds == (0.0, 0.0, 10.0, 10.0)
    assert len(world.discs) == 0
    ends = sorted(map(tuple, world.segments.reshape(-1, 2)))
    # Each corner ends two walls, and each wall is 10 m long.
    corners = [(0.0, 0.0), (0.0, 10.0), (10.0, 0.0), (10.0, 10.0)]
    assert ends == sorted(corners * 2)
    lengths = np.linalg.norm(world.segments[:, 2:] - world.segments[:, :2], axis=1)
    assert lengths.tolist() == [10.0] * 4


def test_static_obstacles_follow_their_law() -> None:
    worlds = draw(static, 400)
    assert {len(world.discs) for world in worlds} == set(range(4, 13))
    assert {len(world.polygons) for world in worlds} == set(range(4))
    discs = np.concatenate([world.discs for world in worlds])
    assert ((discs[:, :2] >= 0.5) & (discs[:, :2] <= 9.5)).all()
    assert ((discs[:, 2] >= 0.15) & (discs[:, 2] <= 0.5)).all()
    # About 3200 discs: U(0.15, 0.5) has mean 0.325 and deviation 0.101; 4 sigma are 0.0072.
    assert discs[:, 2].mean() == pytest.approx(0.325, abs=0.0072)
    for world in worlds:
        for box in world.polygons:
            sides = np.linalg.norm(np.diff(box, axis=0), axis=1)
            assert ((sides > 0.3 - 1e-9) & (sides < 1.2 + 1e-9)).all()
            # Opposite sides are equal and neighbours at right angles.
            assert sides[0] == pytest.approx(sides[2])
            assert np.dot(box[1] - box[0], box[2] - box[1]) == pytest.approx(0.0, abs=1e-9)


def test_article_leaves_the_start_clear() -> None:
    worlds = draw(article, 300)
    assert {len(world.discs) for world in worlds} == set(range(7))
    for world in worlds:
        assert world.bounds == (-1.5, -3.5, 8.5, 3.5)
        assert world.start == (0.0, 0.0, 0.0)
        assert world.goal_area == (3.0, -2.0, 7.0, 2.0)
        x, y, radius = world.discs.T
        assert (np.hypot(x, y) - radius >= 0.8).all()
        assert ((radius >= 0.15) & (radius <= 0.4)).all()
        assert ((x > -1.5) & (x < 8.5) & (np.abs(y) < 3.5)).all()


def test_dynabarn_like_is_shared_out_as_the_published_worlds() -> None:
    worlds = draw(dynabarn_like, 200)
    counts = [len(world.movers) for world in worlds]
    assert 5 <= min(counts) <= 6
    assert 23 <= max(counts) <= 24
    for world in worlds:
        assert len(world.polygons) == 3
        for mover in world.movers:
            # From one side of the hall to another, never outside.
            ends = np.abs(mover.points[[0, -1]])
            np.testing.assert_allclose(ends.max(axis=1), 10.0)
            assert np.abs(mover.points).max() <= 10.0
            way = np.hypot(*np.diff(mover.points, axis=0).T)
            speed = way / np.diff(mover.times)
            assert 0.5 * 0.9 - 1e-9 <= speed.min() <= speed.max() <= 1.9 * 1.1 + 1e-9


def test_barn_like_has_the_walls_of_barn() -> None:
    # Back wall 30 cylinders; side walls 0.075 + 0.15 k up to 9.525: 63 more on each side.
    expected = {(round(-4.425 + 0.15 * k, 6), 0.075) for k in range(30)}
    expected |= {(x, round(0.075 + 0.15 * k, 6)) for k in range(1, 64) for x in (-4.425, -0.075)}
    assert len(expected) == 156
    for world in draw(barn_like, 10):
        places = {(round(x, 6), round(y, 6)) for x, y, _ in world.discs.tolist()}
        assert expected <= places
        assert len(places) == len(world.discs)
        # The others stand in the 28 x 30 cells between the side walls, at y = 5.175 to 9.525.
        inner = np.array(sorted(places - expected)).reshape(-1, 2)
        assert ((inner[:, 0] > -4.4) & (inner[:, 0] < -0.1)).all()
        assert ((inner[:, 1] > 5.1) & (inner[:, 1] < 9.6)).all()
        assert (world.discs[:, 2] == 0.075).all()


def test_barn_like_blobs_are_hollow() -> None:
    for world in draw(barn_like, 30):
        cells = np.zeros((30, 30), dtype=bool)
        row = np.rint((world.discs[:, 0] + 4.425) / 0.15).astype(int)
        column = np.rint((world.discs[:, 1] - 5.175) / 0.15).astype(int)
        cells[row[column >= 0], column[column >= 0]] = True
        squares = np.lib.stride_tricks.sliding_window_view(cells, (3, 3))
        # A cylinder in the middle of eight others would be inside a blob.
        assert not squares.all(axis=(2, 3)).any()


def test_barn_like_matches_the_real_worlds() -> None:
    # The 250 published worlds hold 25 to 209 obstacle cylinders, mean 108, deviation 51. With 400
    # draws the mean has a deviation of 2.5; the law matches it to a few cylinders.
    counts = np.array([len(world.discs) - 156 for world in draw(barn_like, 400)])
    assert counts.mean() == pytest.approx(108, abs=10)
    assert counts.std() == pytest.approx(51, abs=10)


def test_barn_like_lets_the_widest_robot_pass_that_barn_does() -> None:
    # All published worlds let a disc of radius 0.35 m pass from start to goal.
    pool = generate_pool(barn_like, range(20), radius=0.35)
    assert len(pool) == 20


def test_a_variant_has_what_it_was_asked_for() -> None:
    rng = np.random.default_rng(0)
    world = suites()["static"].variant({"obstacles": 16})(rng)
    # One in five is a box.
    assert (len(world.discs), len(world.polygons)) == (13, 3)
    slow, fast = (
        suites()["crowd"].variant({"pedestrians": 5, "speed_factor": factor})(
            np.random.default_rng(3)
        )
        for factor in (1.0, 1.5)
    )
    assert len(slow.movers) == len(fast.movers) == 5
    assert [m.speed for m in fast.movers] == pytest.approx([1.5 * m.speed for m in slow.movers])


@pytest.mark.parametrize(
    ("name", "params", "message"),
    [
        ("rooms", {"obstacles": 3}, "suite rooms: suite_params.obstacles: unknown key; .*none"),
        ("crowd", {"obstacles": 3}, "obstacles: unknown key; allowed here: pedestrians, speed"),
        ("static", {"obstacles": 3.5}, "obstacles = 3.5: input should be a valid integer"),
        ("static", {"obstacles": -1}, "obstacles = -1: input should be greater .* 0"),
        ("crowd", {"speed_factor": 5.5}, "speed_factor = 5.5: .* less than or equal to 5"),
        ("crowd", {"speed_factor": float("nan")}, "speed_factor = nan: .* finite"),
    ],
)
def test_parameters_that_no_variant_has_are_refused(name: str, params, message: str) -> None:
    with pytest.raises(InputError, match=message):
        suites()[name].variant(params)
