# SPDX-License-Identifier: Apache-2.0
"""Results folders: what is written is read back, and nothing that a stranger made is trusted."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from pm01_nav.benchmark.merge import merge_results
from pm01_nav.benchmark.store import Part, ResultsFolder, read_part
from pm01_nav.errors import InputError

SUITE = {"task": "static", "robot": "pm01", "seed": 1, "hash": "a" * 64, "control_dt": 0.1}
ENTRY = {"name": "dwa", "kind": "planner", "source": "dwa", "fingerprint": "b" * 64}


@pytest.fixture
def part(make_results):
    """Return a function that makes a part."""

    def make(first: int, outcomes: str, *, suite=None, entry=None, **origin) -> Part:
        header = {
            "suite": "static",
            "entry": "dwa",
            "first": first,
            "about_suite": SUITE | {"sweep": None} | (suite or {}),
            "about_entry": ENTRY | (entry or {}),
        }
        world = first + np.arange(len(outcomes))
        return Part(header | origin, make_results(outcomes, world=world))

    return make


def saved(path: Path, *parts: Part) -> Path:
    for one in parts:
        ResultsFolder(path).save(one)
    return path


def test_a_part_is_read_as_it_was_written(tmp_path, part) -> None:
    written = part(125, "sct", git_revision="c0ffee")
    saved(tmp_path, written)
    [(file, read)] = ResultsFolder(tmp_path).parts()
    assert file == tmp_path / "parts" / "static" / "dwa" / "00000125.npz"
    assert read.header == written.header
    for field in fields(read.results):
        one, other = getattr(read.results, field.name), getattr(written.results, field.name)
        np.testing.assert_array_equal(one, other)


def test_folders_are_merged(tmp_path, part) -> None:
    here = saved(tmp_path / "here", part(0, "sss", git_revision="1"), part(6, "tt"))
    there = saved(tmp_path / "there", part(3, "ccc", git_revision="2"))
    merged = merge_results([here, there])
    [score] = merged.scores
    assert score.episode.tolist() == list(range(8))
    assert score.results.success.tolist() == [True] * 3 + [False] * 5
    assert score.results.collision.tolist() == [False] * 3 + [True] * 3 + [False] * 2
    assert {origin["git_revision"] for origin in merged.origins} == {"1", "2", None}


def test_of_the_same_episodes_the_larger_part_counts(tmp_path, part) -> None:
    few, many = saved(tmp_path / "few", part(0, "cc")), saved(tmp_path / "many", part(0, "sss"))
    for order in ([few, many], [many, few]):
        [score] = merge_results(order).scores
        assert score.results.success.tolist() == [True] * 3


def test_parts_that_overlap_count_once(tmp_path, part) -> None:
    [score] = merge_results([saved(tmp_path, part(0, "ssss"), part(2, "cccc"))]).scores
    assert score.episode.tolist() == [0, 1, 2, 3, 4, 5]
    assert score.results.success.tolist() == [True] * 4 + [False] * 2


def test_another_suite_of_the_same_name_is_refused(tmp_path, part) -> None:
    here = saved(tmp_path / "here", part(0, "s"))
    there = saved(tmp_path / "there", part(1, "s", suite={"hash": "d" * 64}))
    with pytest.raises(InputError, match=r"00000001\.npz: cannot be merged: its suite static has"):
        merge_results([here, there])


def test_another_policy_of_the_same_name_is_refused(tmp_path, part) -> None:
    here = saved(tmp_path / "here", part(0, "s"))
    there = saved(tmp_path / "there", part(1, "s", entry={"fingerprint": "d" * 64}))
    with pytest.raises(InputError, match="its dwa is not the dwa of the other results"):
        merge_results([here, there])


def test_a_folder_without_results_is_refused(tmp_path) -> None:
    with pytest.raises(InputError, match="holds no results; `pm01 benchmark --out"):
        merge_results([tmp_path])


class Bomb:
    """Betrays itself when it is unpickled."""

    def __reduce__(self):
        return (pytest.fail, ("it was unpickled",))


def test_a_pickle_is_never_opened(tmp_path) -> None:
    file = tmp_path / "part.npz"
    np.savez(file, header=np.array([Bomb()], dtype=object))
    with pytest.raises(InputError, match="is no readable results file"):
        read_part(file)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 not a zip", b"{}"])
def test_a_damaged_file_is_refused(content: bytes, tmp_path) -> None:
    file = tmp_path / "part.npz"
    file.write_bytes(content)
    with pytest.raises(InputError, match="is no readable results file"):
        read_part(file)


@pytest.mark.parametrize("header", ["[]", "{}", "no json", "3"])
def test_a_header_that_is_none_is_refused(header: str, tmp_path) -> None:
    file = tmp_path / "part.npz"
    np.savez(file, header=np.array(header))
    with pytest.raises(InputError, match="is no readable results file"):
        read_part(file)


@pytest.mark.parametrize("header", ['{"format": 2}', '{"format": 1}'])
def test_another_format_is_refused(header: str, tmp_path) -> None:
    file = tmp_path / "part.npz"
    np.savez(file, header=np.array(header))
    with pytest.raises(InputError, match="is a results file of another version"):
        read_part(file)


def test_a_half_written_part_is_refused(tmp_path, part) -> None:
    [(file, _)] = ResultsFolder(saved(tmp_path, part(0, "sc"))).parts()
    file.write_bytes(file.read_bytes()[:-40])
    with pytest.raises(InputError, match="is no readable results file"):
        merge_results([tmp_path])


def test_computing_times(tmp_path) -> None:
    folder = ResultsFolder(tmp_path)
    assert folder.timing("static", "dwa") is None
    folder.save_timing("static", "dwa", [1.0, 2.5])
    times = folder.timing("static", "dwa")
    assert times is not None
    assert times.tolist() == [1.0, 2.5]
    folder.timing_file("static", "dwa").write_text("{}", encoding="utf-8")
    with pytest.raises(InputError, match="computing times"):
        folder.timing("static", "dwa")
