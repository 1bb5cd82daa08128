# SPDX-License-Identifier: Apache-2.0
"""DynaBARN, on a tiny file in its layout."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from pm01_nav.errors import InputError
from pm01_nav.worlds.dynabarn import read_dynabarn

FILE: dict[str, Any] = {
    "about": "for people",
    "radius": 0.5,
    "walls_cx_cy_sx_sy": [[-10, 0, 0.5, 20], [0, 10, 20, 0.5]],
    "start": [11, 0, 3.14],
    "goal": [-9, 0],
    "worlds": [
        {"id": 7, "difficulty": "easy", "obstacles": ["b", "a"]},
        {"id": 3, "difficulty": "hard", "obstacles": ["a"]},
    ],
    "trajectories": {"a": [[0, 1, 2], [1.5, 3, 4]], "b": [[0, 5, 5], [1, 6, 5], [3, 5, 5]]},
}


def write(folder: Path, data: object) -> Path:
    path = folder / "dynabarn.json"
    path.write_text(data if isinstance(data, str) else json.dumps(data))
    return path


def test_worlds(tmp_path: Path) -> None:
    first, second = read_dynabarn(write(tmp_path, FILE))
    assert (first.name, second.name) == ("dynabarn_7", "dynabarn_3")
    assert (first.start, first.goal_area) == ((11.0, 0.0, 3.14), (-9.0, 0.0, -9.0, 0.0))
    # 1 m around walls and places: x -10.25 to 11, y -10 to 10.25.
    assert first.bounds == (-11.25, -11.0, 12.0, 11.25)
    assert first.polygons[0].tolist() == [[-10.25, -10], [-9.75, -10], [-9.75, 10], [-10.25, 10]]
    assert len(first.polygons) == 2
    one, other = first.movers
    assert (one.motion, one.radius) == ("spline", 0.5)
    assert one.points.tolist() == [[5, 5], [6, 5], [5, 5]]
    assert one.times.tolist() == [0, 1, 3]
    assert other.points.tolist() == [[1, 2], [3, 4]]
    assert second.movers == (other,)


def changed(**changes: Any) -> dict[str, Any]:
    return FILE | changes


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ("", "is not valid JSON"),
        ("[]", "must be a JSON object, not list"),
        ("[" * 100_000, "is not valid JSON"),
        ('{"radius": 1, "radius": 2}', "the key 'radius' stands twice"),
        ({k: v for k, v in FILE.items() if k != "goal"}, "goal: is missing"),
        (changed(radius=-0.5), "radius = -0.5: input should be greater than 0"),
        (changed(radius=float("nan")), "radius = nan"),
        (changed(worlds=[]), "worlds = "),
        (changed(worlds=[{"id": 1, "obstacles": ["c"]}]), "worlds: 1: obstacle 'c': has no traj"),
        (changed(worlds=[{"id": 1, "obstacles": []}] * 2), "worlds: two have the same id"),
        (changed(trajectories={"a": [[0, 1, 2]]}), "trajectories: a: mover: points: a spline"),
        (changed(trajectories={"a": [[0, 1, 2], [0, 3, 4]]}), "a: mover: times: .* rising from 0"),
        (changed(trajectories={"a": [[0, 1], [1, 3]]}), "trajectories.a.0.2: is missing"),
        (changed(walls_cx_cy_sx_sy=[[0, 0, 0, 20]]), r"polygons\[0\]: encloses no area"),
    ],
)
def test_refused(tmp_path: Path, data: object, words: str) -> None:
    path = write(tmp_path, data)
    with pytest.raises(InputError, match=words) as problem:
        read_dynabarn(path)
    assert str(path) in str(problem.value)
    assert "\n" not in str(problem.value)
