# SPDX-License-Identifier: Apache-2.0
"""What a world refuses, in one line that names the key, the value and what is allowed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pm01_nav.errors import InputError
from pm01_nav.worlds.mover import Mover
from pm01_nav.worlds.world import OccupancyGrid, World

NAN, INF = float("nan"), float("inf")
SQUARE = [[1.0, 1.0], [2.0, 1.0], [2.0, 2.0], [1.0, 2.0]]
MOVER = Mover("bounce", 0.3, np.array([[2e7, 0.0]]), speed=1.0)


def world(**changes: Any) -> World:
    return World(**({"name": "lab", "bounds": (0.0, 0.0, 4.0, 4.0)} | changes))


def polygon(*corners: list[float]) -> dict[str, Any]:
    return {"polygons": (np.array(SQUARE), np.array(corners, dtype=np.float64))}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"discs": np.array([[1, 1, 0.5], [NAN, 1, 1]])}, "discs: nan: must be finite"),
        ({"discs": np.array([[1, 1, INF]])}, "discs: inf: must be finite"),
        ({"discs": np.array([[1, 1, 0.5], [1, 1, -0.1]])}, r"discs\[1\]: radius = -0.1"),
        ({"discs": np.array([[1, 1, 0.0]])}, r"discs\[0\]: radius = 0.0: must be positive"),
        ({"discs": np.array([[1, 2e7, 1]])}, r"discs: 20000000.0: .* -1e\+07 and 1e\+07"),
        ({"discs": np.zeros((2, 4))}, r"discs: must have shape \(n, 3\), not \(2, 4\)"),
        ({"segments": np.array([[0, 0, 1, NAN]])}, "segments: nan"),
        ({"segments": np.zeros(4)}, "segments: must have shape"),
        ({"discs": np.ones((200_001, 3))}, "200001 obstacles .* at most 200000 are allowed"),
        (polygon([0, 0], [1, 0]), r"polygons\[1\]: must have 3 to 10000 corners"),
        (polygon([0, 0], [1, 0], [1, NAN]), r"polygons\[1\]: nan: must be finite"),
        (polygon([0, 0], [1, 1], [1, 0], [0, 1]), r"polygons\[1\]: encloses no area"),
        (polygon([0, 0], [2, 2], [2, 0], [0, 1]), r"polygons\[1\]: crosses or touches itself"),
        (polygon([0, 0], [1, 1], [2, 2]), r"polygons\[1\]: encloses no area"),
        ({"bounds": (0.0, 0.0, 0.0, 4.0)}, "bounds .* enclose no area"),
        ({"bounds": (4.0, 0.0, 0.0, 4.0)}, "bounds .* enclose no area"),
        ({"bounds": (0.0, 0.0, NAN, 4.0)}, "bounds: nan"),
        ({"bounds": (0.0, 0.0, 1e-4, 4.0)}, "a side of 0.0001 m: must be 0.001 to 100000"),
        ({"bounds": (0.0, 0.0, 1e6, 4.0)}, "a side of 1e"),
        ({"start": (0.0, NAN, 0.0)}, "start: nan"),
        ({"goal_area": (0.0, 0.0, INF, 1.0)}, "goal_area: inf"),
        ({"goal_area": (2.0, 0.0, 1.0, 1.0)}, "goal_area = .*: must be x_min, y_min"),
        ({"movers": (MOVER,)}, r"movers\[0\]: 20000000.0"),
    ],
)
def test_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=f"world lab: .*{words}") as problem:
        world(**changes)
    assert "\n" not in str(problem.value)


def test_as_many_obstacles_as_allowed() -> None:
    assert len(world(discs=np.ones((200_000, 3))).discs) == 200_000


@pytest.mark.parametrize(
    ("cells", "resolution", "origin", "words"),
    [
        (np.zeros((0, 4)), 0.1, (0.0, 0.0), "1 to 64000000 cells"),
        (np.zeros(4), 0.1, (0.0, 0.0), "must have rows and columns"),
        (np.zeros((2, 2)), 0.0, (0.0, 0.0), "resolution = 0.0: must be above 0"),
        (np.zeros((2, 2)), NAN, (0.0, 0.0), "resolution = nan"),
        (np.zeros((2, 2)), 0.1, (0.0, NAN), "origin: nan"),
    ],
)
def test_grid_refused(
    cells: np.ndarray, resolution: float, origin: tuple[float, float], words: str
) -> None:
    with pytest.raises(InputError, match=f"grid: {words}|grid: .*{words}"):
        OccupancyGrid(cells.astype(np.uint8), resolution, origin)
