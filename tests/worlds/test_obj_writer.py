# SPDX-License-Identifier: Apache-2.0
"""The mesh of a world's obstacles, read back corner by corner."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from pm01_nav.worlds.obj_writer import DEVIATION, obstacles_obj
from pm01_nav.worlds.world import World

BOUNDS = (-5.0, -5.0, 5.0, 5.0)


def faces(text: str) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return corners (n, 3) and normal (3,) of each face of an OBJ."""
    corners: list[list[float]] = []
    normals: list[list[float]] = []
    found = []
    for line in text.splitlines():
        kind, *words = line.split()
        if kind == "v":
            corners.append([float(word) for word in words])
        elif kind == "vn":
            normals.append([float(word) for word in words])
        else:
            pairs = [[int(number) for number in word.split("//")] for word in words]
            (normal,) = {pair[1] for pair in pairs}
            found.append((np.array([corners[k] for k, _ in pairs]), np.array(normals[normal])))
    return found


def volume(text: str) -> float:
    """Return what the faces enclose with the floor, by the divergence theorem [m^3].

    Faces that look inwards would count as negative.
    """
    total = 0.0
    for corners, normal in faces(text):
        for second, third in pairwise(corners[1:]):
            across = np.cross(second - corners[0], third - corners[0])
            assert across @ normal > 0.0
            total += corners[0] @ across / 6.0
    return total


def test_a_disc_is_a_cylinder_to_a_millimetre() -> None:
    text = obstacles_obj(World("w", BOUNDS, discs=np.array([[1.0, 2.0, 0.25]])), 1.5)
    points = np.concatenate([corners for corners, _ in faces(text)])
    reach = np.hypot(points[:, 0] - 1.0, points[:, 1] - 2.0)
    assert reach == pytest.approx(0.25 + DEVIATION, abs=2e-6)
    assert set(points[:, 2]) == {0.0, 1.5}
    walls = [corners for corners, normal in faces(text) if normal[2] == 0.0]
    middle = np.array([corners.mean(axis=0) for corners in walls])
    inner = np.hypot(middle[:, 0] - 1.0, middle[:, 1] - 2.0)
    assert (inner >= 0.25 - DEVIATION - 2e-6).all()
    assert volume(text) == pytest.approx(np.pi * 0.25**2 * 1.5, rel=0.01)


def test_a_tiny_disc_still_has_corners() -> None:
    text = obstacles_obj(World("w", BOUNDS, discs=np.array([[0.0, 0.0, 1e-3]])), 1.0)
    assert len(faces(text)) == 13


def test_boxes_and_walls_enclose_what_they_should() -> None:
    box = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]])
    assert volume(obstacles_obj(World("w", BOUNDS, polygons=(box,)), 0.5)) == pytest.approx(1.0)
    wall = World("w", BOUNDS, segments=np.array([[0.0, 0.0, 3.0, 4.0]]))
    # 5 m long, 10 cm thick, 1 m high.
    assert volume(obstacles_obj(wall, 1.0, 0.1)) == pytest.approx(0.5, abs=1e-5)


def test_a_hook_is_cut_into_pieces() -> None:
    hook = np.array([[0, 0], [3, 0], [3, 3], [2, 3], [2, 1], [0, 1]], dtype=float)
    for corners in (hook, hook[::-1]):
        text = obstacles_obj(World("w", BOUNDS, polygons=(corners,)), 2.0)
        assert volume(text) == pytest.approx(2.0 * 5.0)


def test_an_empty_world_has_no_mesh() -> None:
    assert obstacles_obj(World("w", BOUNDS), 1.0) == ""
