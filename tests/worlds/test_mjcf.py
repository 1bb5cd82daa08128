# SPDX-License-Identifier: Apache-2.0
"""Worlds written as MJCF: well-formed everywhere, loaded where MuJoCo is installed."""

from __future__ import annotations

from xml.etree.ElementTree import Element, fromstring

import numpy as np
import pytest

from pm01_nav.geometry import rectangle
from pm01_nav.worlds.mjcf import world_to_mjcf
from pm01_nav.worlds.mover import Mover
from pm01_nav.worlds.world import OccupancyGrid, World

ELL = np.array([[4, 4], [6, 4], [6, 4.5], [4.5, 4.5], [4.5, 6], [4, 6]], dtype=np.float64)
WORLD = World(
    "hall <2>",
    (0.0, -2.0, 10.0, 8.0),
    discs=np.array([[1.0, 2.0, 0.25]]),
    polygons=(rectangle(3.0, 3.0, 1.0, 0.5, np.pi / 2), ELL, ELL[[0, 1, 4]]),
    segments=np.array([[0.0, 0.0, 0.0, 4.0]]),
    grid=OccupancyGrid(np.array([[1, 1], [0, 0]], dtype=np.uint8), 0.5, (7.0, 1.0)),
    movers=(Mover("bounce", 0.3, np.array([[8.0, 7.0]]), speed=1.0),),
)


def floats(element: Element, key: str) -> list[float]:
    return [float(number) for number in element.get(key, "").split()]


def test_geoms() -> None:
    root = fromstring(world_to_mjcf(WORLD))
    assert root.get("model") == "hall_2_"
    geoms = {geom.get("name"): geom for geom in root.iter("geom")}
    # The L takes four triangles.
    meshes = [f"polygon_1_{k}" for k in range(4)] + ["polygon_2_0"]
    assert set(geoms) == {"floor", "disc_0", "box_0", "wall_0", "cells_0", "mover_0", *meshes}
    disc, box, wall = geoms["disc_0"], geoms["box_0"], geoms["wall_0"]
    # MuJoCo counts half lengths; all is 1 m high.
    assert (floats(disc, "size"), floats(disc, "pos")) == ([0.25, 0.5], [1.0, 2.0, 0.5])
    assert floats(box, "size") == pytest.approx([0.5, 0.25, 0.5])
    # A quarter turn about z: (cos 45 deg, 0, 0, sin 45 deg).
    assert floats(box, "quat") == pytest.approx([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])
    assert floats(wall, "size") == pytest.approx([2.0, 0.01, 0.5])
    assert floats(geoms["cells_0"], "pos") == pytest.approx([7.5, 1.25, 0.5])
    # The floor reaches 5 m beyond the bounds of 10 m x 10 m.
    assert floats(geoms["floor"], "size")[:2] == [10.0, 10.0]
    (body,) = root.iter("body")
    assert (body.get("mocap"), floats(body, "pos")) == ("true", [8.0, 7.0, 0.0])


def test_mujoco_loads_it_and_its_rays_hit() -> None:
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string(world_to_mjcf(WORLD))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)

    def distance(x: float, y: float, dx: float, dy: float) -> float:
        hit = np.zeros(1, dtype=np.int32)
        start, along = np.array([x, y, 0.3]), np.array([dx, dy, 0.0])
        return mujoco.mj_ray(model, data, start, along, None, 1, -1, hit)

    assert distance(0.5, 2.0, 1.0, 0.0) == pytest.approx(0.25)  # The disc begins at x = 0.75.
    assert distance(3.0, 5.0, 0.0, -1.0) == pytest.approx(1.5)  # The box ends at y = 3.5.
    assert distance(5.0, 5.0, 0.0, -1.0) == pytest.approx(0.5)  # The notch of the L: y = 4.5.
    assert distance(5.0, 5.0, -1.0, 0.0) == pytest.approx(0.5)
    assert distance(8.0, 4.0, 0.0, 1.0) == pytest.approx(2.7)  # The mover begins at y = 6.7.
