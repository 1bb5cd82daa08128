# SPDX-License-Identifier: Apache-2.0
"""Pools on disk: exactly what was generated, and nothing else is believed."""

from __future__ import annotations

import hashlib
import io
import os
from pathlib import Path

import numpy as np
import pytest

from pm01_nav.worlds import pool_cache
from pm01_nav.worlds.free_space import FreeSpace
from pm01_nav.worlds.frozen import worlds_hash
from pm01_nav.worlds.mover import Mover
from pm01_nav.worlds.pool import Places, WorldPool, generate_pool, pack_pool
from pm01_nav.worlds.pool_cache import cached_pool
from pm01_nav.worlds.suites import suites
from pm01_nav.worlds.views import Views
from pm01_nav.worlds.world import World

RADIUS = 0.27
SEEDS = range(1, 17, 2)


def suite_pool(name: str, seeds: range, radius: float) -> WorldPool:
    return cached_pool(name, suites()[name].generator, seeds, radius, __file__)


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch) -> Path:
    """Return the folder of the entries; few worlds are enough for one."""
    monkeypatch.setenv("PM01_CACHE", str(tmp_path))
    monkeypatch.setattr(pool_cache, "LEAST_WORLDS", 2)
    return tmp_path / "pools"


def never(*arguments: object) -> None:
    raise AssertionError("was generated again")


def assert_equal(one: WorldPool, other: WorldPool) -> None:
    for name, array in one.arrays._asdict().items():
        array, twin = np.asarray(array), np.asarray(getattr(other.arrays, name))
        assert array.dtype == twin.dtype
        assert np.array_equal(array, twin, equal_nan=array.dtype.kind == "f"), name
    assert worlds_hash(one.worlds) == worlds_hash(other.worlds)
    assert one.radius == other.radius
    for world, twin in zip(one.worlds, other.worlds, strict=True):
        assert world.name == twin.name
        assert world.start_area == twin.start_area
        assert world.goal_area == twin.goal_area
        assert world.start == twin.start
        assert [m.points.tolist() for m in world.movers] == [m.points.tolist() for m in twin.movers]


@pytest.mark.parametrize("name", sorted(suites()))
def test_second_pool_is_read_and_equal(name: str, folder: Path, monkeypatch) -> None:
    first = suite_pool(name, SEEDS, RADIUS)
    assert_equal(first, generate_pool(suites()[name].generator, SEEDS, RADIUS))
    assert len(list(folder.iterdir())) == 1
    monkeypatch.setattr(pool_cache, "draw_world", never)
    assert_equal(suite_pool(name, SEEDS, RADIUS), first)


def test_all_fields_of_a_world_survive() -> None:
    triangle = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    movers = (
        Mover("bounce", 0.2, triangle[:1], speed=0.5, heading=1.0),
        Mover("spline", 0.3, triangle, times=np.array([0.0, 1.0, 2.5])),
    )
    full = World(
        "full",
        (0.0, -1.0, 4.0, 4.0),
        discs=np.array([[1.0, 2.0, 0.3], [2.0, 2.0, 0.1]]),
        polygons=(triangle, triangle + 2.0),
        segments=np.array([[0.0, 1.0, 2.0, 3.0]]),
        movers=movers,
        start=(0.5, 0.5, -3.0),
        start_area=(0.0, 0.0, 1.0, 1.0),
        goal_area=(3.0, 3.0, 3.0, 3.0),
    )
    bare = World("bare", (0.0, 0.0, 1.0, 1.0))
    goals = np.array([[0.3, 0.4], [1 / 3, -0.0]])
    ways = FreeSpace(np.array([[True, False, True], [False, True, True]]), 0.2, (-1.0, 0.5))
    places = Places(np.array([[0.1, 0.2]]), goals, 1.5, (0.0, 0.05), ways)
    drawn = [(full, places), (bare, places._replace(start_yaw=np.nan, ways=None)), (full, places)]
    pool = pack_pool(drawn, RADIUS)
    again = pool_cache._from_arrays(pool_cache._to_arrays(pool), RADIUS)
    assert_equal(again, pool)
    assert again.worlds[2].movers[1].times.tolist() == [0.0, 1.0, 2.5]
    assert len(again.worlds[1].polygons) == 0
    # -0.0 is 0.0 to all who drive there.
    assert again.arrays.goals[2:4].tolist() == goals.tolist()


def test_what_is_seen_is_kept_beside_its_pool(folder: Path, monkeypatch) -> None:
    first = suite_pool("static", SEEDS, RADIUS)
    near, far = first.arrays_for(2.0), first.arrays_for(12.0)
    assert len(near.seen_discs) < len(far.seen_discs)
    assert len(list(folder.iterdir())) == 3
    monkeypatch.setattr(pool_cache, "draw_world", never)
    monkeypatch.setattr(pool_cache, "list_views", never)
    again = suite_pool("static", SEEDS, RADIUS)
    for view_range, arrays in ((2.0, near), (12.0, far)):
        read = again.arrays_for(view_range)
        assert read.view_range == view_range
        for name in Views._fields:
            assert np.array_equal(getattr(read, name), getattr(arrays, name)), name
    # Nobody has looked at a world so far.
    assert "_worlds" not in vars(again.worlds)


def test_other_worlds_have_another_entry(folder: Path) -> None:
    suite_pool("static", SEEDS, RADIUS)
    suite_pool("empty", SEEDS, RADIUS)
    suite_pool("static", range(2, 18, 2), RADIUS)
    suite_pool("static", SEEDS, 0.3)
    suite_pool("static", SEEDS, RADIUS)
    assert len(list(folder.iterdir())) == 4


def test_small_pools_are_not_kept(folder: Path, monkeypatch) -> None:
    monkeypatch.setattr(pool_cache, "LEAST_WORLDS", 9)
    assert len(suite_pool("static", SEEDS, RADIUS)) == 8
    assert not folder.exists()


def other_archive(entry: bytes) -> bytes:
    content = io.BytesIO()
    np.savez(content, names=np.array(["a"]))
    return content.getvalue()


def signed(entry: bytes) -> bytes:
    return entry + hashlib.sha256(entry).digest()


def fewer_rows(entry: bytes) -> bytes:
    arrays = dict(np.load(io.BytesIO(entry)))
    arrays["discs"] = arrays["discs"][:-1]
    content = io.BytesIO()
    np.savez(content, **arrays)
    return content.getvalue()


def negative_radius(entry: bytes) -> bytes:
    arrays = dict(np.load(io.BytesIO(entry)))
    arrays["discs"] = -arrays["discs"]
    content = io.BytesIO()
    np.savez(content, **arrays)
    return content.getvalue()


def pickled(entry: bytes) -> bytes:
    content = io.BytesIO()
    np.savez(content, names=np.array([{}], dtype=object))
    return content.getvalue()


DAMAGE = {
    "empty": lambda entry: b"",
    "cut short": lambda entry: entry[: len(entry) // 2],
    "no archive": lambda entry: b"moon" * 1000,
    "byte turned over": lambda entry: entry[:2000] + bytes([entry[2000] ^ 255]) + entry[2001:],
    "other archive": other_archive,
    "fewer rows": fewer_rows,
    "negative radius": negative_radius,
    "pickled": pickled,
    "pickled, signed": lambda entry: signed(pickled(entry)),
}


@pytest.mark.parametrize("damage", DAMAGE.values(), ids=list(DAMAGE))
def test_damaged_entry_is_not_used(damage, folder: Path) -> None:
    first = suite_pool("static", SEEDS, RADIUS)
    (entry,) = folder.iterdir()
    whole = entry.read_bytes()
    entry.write_bytes(damage(whole))
    assert_equal(suite_pool("static", SEEDS, RADIUS), first)
    # And it is mended.
    mended = pool_cache._kept_pool(entry, RADIUS)
    assert mended is not None
    assert_equal(mended, first)


def test_folder_that_cannot_be_written_does_no_harm(folder: Path) -> None:
    folder.write_text("a file where the folder should be")
    assert len(suite_pool("static", SEEDS, RADIUS)) == 8


def test_oldest_entries_are_removed(folder: Path, monkeypatch) -> None:
    folder.mkdir()
    for age, name in enumerate(("new", "old", "oldest")):
        file = folder / f"{name}.npz"
        file.write_bytes(bytes(100))
        os.utime(file, ns=(10**18 - age * 10**9, 10**18 - age * 10**9))
    monkeypatch.setattr(pool_cache, "MAX_BYTES", 250)
    pool_cache._remove_oldest(folder)
    assert {file.stem for file in folder.iterdir()} == {"new", "old"}
