# SPDX-License-Identifier: Apache-2.0
"""Clearance and contact: hand-made cases, the slow twin, and walls that hold."""

from __future__ import annotations

import numpy as np
import pytest

from pm01_nav.geometry import rectangle
from pm01_nav.worlds.world import OccupancyGrid, World
from tests.sim.reference import reference_clearance

BOUNDS = (-5.0, -5.0, 5.0, 5.0)
CIRCLE = {"shape": "circle", "radius": 0.2, "vertices": ()}
# A wedge: blunt behind, pointed ahead.
WEDGE = {"shape": "polygon", "radius": 0.0, "vertices": ((-0.3, -0.2), (0.4, 0.0), (-0.3, 0.2))}
BOX = {
    "shape": "polygon",
    "radius": 0.0,
    "vertices": ((-0.3, -0.2), (0.3, -0.2), (0.3, 0.2), (-0.3, 0.2)),
}
DISC = World("disc", BOUNDS, discs=np.array([[1.0, 0.0, 0.3]]))
WALL = World("wall", BOUNDS, segments=np.array([[1.0, -1.0, 1.0, 1.0]]))
CELLS = np.zeros((20, 20), dtype=np.uint8)
CELLS[12, 14] = 1
# The solid cell spans x [0.4, 0.5] and y [0.2, 0.3].
GRID = World("grid", BOUNDS, grid=OccupancyGrid(CELLS, 0.1, (-1.0, -1.0)))


@pytest.mark.parametrize(
    ("footprint", "world", "pose", "expected"),
    [
        # Centre to centre 1 m, less both radii.
        (CIRCLE, DISC, (0.0, 0.0, 0.0), 0.5),
        (CIRCLE, DISC, (0.5, 0.0, 2.0), 0.0),
        (CIRCLE, DISC, (0.7, 0.0, 0.0), -0.2),
        # Side by side with the wall, and diagonally off its upper end: 3-4-5 times 0.1.
        (CIRCLE, WALL, (0.0, 0.5, 0.0), 0.8),
        (CIRCLE, WALL, (0.6, 1.3, 0.0), 0.5 - 0.2),
        # The nearest corner of the cell, (0.4, 0.2), is 3-4-5 times 0.1 away.
        (CIRCLE, GRID, (0.0, -0.1, 0.0), 0.5 - 0.2),
        # Straight below the cell's lower side.
        (CIRCLE, GRID, (0.45, -0.15, 0.0), 0.35 - 0.2),
        # The box's front is 0.3 m ahead; turned by 90 degrees its side, 0.2 m.
        (BOX, DISC, (0.0, 0.0, 0.0), 1.0 - 0.3 - 0.3),
        (BOX, DISC, (0.0, 0.0, np.pi / 2), 1.0 - 0.2 - 0.3),
        # The corner (0.3, 0.2) lies 0.3, 0.4 from the disc's centre.
        (BOX, DISC, (0.4, -0.6, 0.0), 0.5 - 0.3),
        (BOX, WALL, (0.0, 0.0, 0.0), 0.7),
        (BOX, WALL, (0.0, 0.0, np.pi), 0.7),
        # At 45 degrees the box reaches (0.3 + 0.2) / sqrt(2) ahead.
        (BOX, WALL, (0.0, 0.0, np.pi / 4), 1.0 - 0.5 / np.sqrt(2)),
        # The wall crosses the box, ends not inside it.
        (BOX, WALL, (0.9, 0.0, 0.0), 0.0),
        # An end of the wall is inside the box.
        (BOX, WALL, (1.0, 1.1, 0.0), 0.0),
        # The point of the wedge leads; backwards its blunt end does.
        (WEDGE, WALL, (0.0, 0.0, 0.0), 0.6),
        (WEDGE, WALL, (0.0, 0.0, np.pi), 0.7),
        # The cell's lower side (y = 0.2) is 0.2 m above the box's upper side (y = 0).
        (BOX, GRID, (0.45, -0.2, 0.0), 0.2),
        # Diagonally: corner (0.0, 0.0) - cell corner (0.4, 0.2) would be 0.447; the box's own
        # corner (0.1, -0.2) to (0.4, 0.2) is 3-4-5 times 0.1.
        (BOX, GRID, (-0.2, -0.4, 0.0), 0.5),
        # The whole cell lies inside the box.
        (BOX, GRID, (0.45, 0.25, 0.3), 0.0),
    ],
)
def test_clearance_by_hand(make_robot, simulate, footprint, world, pose, expected) -> None:
    robot = make_robot(footprint=footprint)
    sim = simulate(robot, world, [pose])
    # Float64 arithmetic on lengths of about 1 m leaves errors of 1e-15.
    assert sim.state.clearance[0] == pytest.approx(expected, abs=1e-12)
    assert reference_clearance(world, robot, pose) == pytest.approx(expected, abs=1e-12)


def test_clearance_without_obstacles_is_huge(make_robot, simulate) -> None:
    sim = simulate(make_robot(), World("open", BOUNDS), [[0.0, 0.0, 0.0]])
    assert sim.state.clearance[0] >= 1e9


def random_world(rng: np.random.Generator, *, grid: bool) -> World:
    discs = np.column_stack([rng.uniform(-4, 4, (12, 2)), rng.uniform(0.05, 0.5, 12)])
    boxes = tuple(
        rectangle(*rng.uniform(-4, 4, 2), *rng.uniform(0.1, 1.0, 2), rng.uniform(-3, 3))
        for _ in range(2)
    )
    walls = rng.uniform(-5, 5, (3, 4))
    cells = (rng.random((20, 24)) < 0.03).astype(np.uint8)
    origin = (float(rng.uniform(-3, 0)), float(rng.uniform(-3, 0)))
    if grid:
        yaw = float(rng.choice([0.0, rng.uniform(-np.pi, np.pi)]))
        return World("grid", BOUNDS, grid=OccupancyGrid(cells, 0.13, origin, yaw))
    return World("random", BOUNDS, discs=discs, polygons=boxes, segments=walls)


@pytest.mark.parametrize("footprint", [CIRCLE, BOX, WEDGE], ids=["circle", "box", "wedge"])
def test_clearance_equals_the_slow_twin(make_robot, simulate, footprint) -> None:
    rng = np.random.default_rng(5)
    worlds = [random_world(rng, grid=False) for _ in range(150)]
    poses = rng.uniform([-5, -5, -np.pi], [5, 5, np.pi], (150, 3))
    robot = make_robot(footprint=footprint)
    fast = simulate(robot, worlds, poses).state.clearance
    pairs = zip(worlds, poses, strict=True)
    slow = np.array([reference_clearance(world, robot, pose) for world, pose in pairs])
    assert (np.sign(fast) == np.sign(slow)).all()
    outside = slow > 0.0
    assert outside.sum() > 50
    assert (~outside).sum() > 20
    assert fast[outside] == pytest.approx(slow[outside], abs=1e-9)


@pytest.mark.parametrize("footprint", [CIRCLE, BOX, WEDGE], ids=["circle", "box", "wedge"])
def test_clearance_to_a_grid_equals_the_slow_twin(make_robot, simulate, footprint) -> None:
    rng = np.random.default_rng(6)
    worlds = [random_world(rng, grid=True) for _ in range(100)]
    poses = rng.uniform([-3, -3, -np.pi], [3, 3, np.pi], (100, 3))
    robot = make_robot(footprint=footprint)
    fast = simulate(robot, worlds, poses).state.clearance
    pairs = zip(worlds, poses, strict=True)
    slow = np.array([reference_clearance(world, robot, pose) for world, pose in pairs])
    # As declared: exact up to half a metre, beyond it never too large.
    near = slow <= 0.5
    assert near.sum() > 20
    assert (~near).sum() > 5
    assert np.maximum(fast[near], 0.0) == pytest.approx(np.maximum(slow[near], 0.0), abs=1e-9)
    assert (fast[~near] >= 0.5 - 1e-12).all()
    assert (fast[~near] <= slow[~near] + 1e-6).all()


def test_depth_in_the_deepest_disc_counts(make_robot, simulate) -> None:
    # The robot stands at the middle of a disc of 0.5 m: -0.5 - 0.2. The other disc, 0.1 m away,
    # gives 0.1 - 0.1 - 0.2 = -0.2 only.
    discs = np.array([[0.0, 0.0, 0.5], [0.1, 0.0, 0.1]])
    sim = simulate(make_robot(footprint=CIRCLE), World("two", BOUNDS, discs=discs), [[0, 0, 0]])
    assert sim.state.clearance[0] == pytest.approx(-0.7)


def test_a_polygon_inside_a_solid_cell_touches_it(make_robot, simulate) -> None:
    cells = np.array([[1]], dtype=np.uint8)
    world = World("block", BOUNDS, grid=OccupancyGrid(cells, 2.0, (-1.0, -1.0)))
    sim = simulate(make_robot(footprint=BOX), world, [[0.0, 0.0, 0.0]])
    assert sim.state.clearance[0] <= 0.0


FAST = {
    "limits": {
        "linear_min": -2.0,
        "linear_max": 2.0,
        "linear_acceleration": 20.0,
        "angular_max": 4.0,
    },
    "actuator": {"lag_s": 0.0},
}


@pytest.mark.parametrize("footprint", [CIRCLE, BOX, WEDGE], ids=["circle", "box", "wedge"])
@pytest.mark.parametrize("speed", [0.3, 2.0])
@pytest.mark.parametrize("obstacle", ["wall", "disc", "grid"])
def test_driven_at_an_obstacle_it_stops_before_it(
    make_robot, simulate, footprint, speed: float, obstacle: str
) -> None:
    column = (np.arange(40) == 20).astype(np.uint8)
    world = {
        "wall": World("wall", BOUNDS, segments=np.array([[1.0, -1.0, 1.0, 1.0]])),
        "disc": World("disc", BOUNDS, discs=np.array([[1.075, 0.0, 0.075]])),
        "grid": World("grid", BOUNDS, grid=OccupancyGrid(column[None], 0.05, (0.0, -0.025))),
    }[obstacle]
    robot = make_robot(footprint=footprint, **FAST)
    # Starts at different distances, so that the last step falls short by different amounts.
    starts = -np.linspace(0.0013, 0.1987, 32)
    poses = np.column_stack([starts, np.zeros((32, 2))])
    sim = simulate(robot, world, poses)
    touched = np.zeros(32, dtype=bool)
    front = {0.2: 0.2, 0.0: 0.3 if footprint is BOX else 0.4}[footprint["radius"]]
    for _ in range(60):
        sim.step(np.tile([speed, 0.0], (32, 1)))
        touched |= sim.state.contact
        # All obstacles begin at x = 1; 1e-9 is far above the rounding of 60 steps.
        assert (sim.state.pose[:, 0] + front < 1.0 + 1e-9).all()
    assert touched.all()
    # One check of contact for each 0.05 m of travel, the simulator's declared accuracy.
    assert (sim.state.clearance <= 0.05 + 1e-9).all()
    assert (sim.state.clearance > 0.0).all()


def test_contact_stops_at_once_and_the_way_back_is_free(make_robot, simulate) -> None:
    sim = simulate(make_robot(footprint=CIRCLE, **FAST), WALL, [[0.0, 0.0, 0.0]])
    while not sim.state.contact[0]:
        sim.step(np.array([[2.0, 0.0]]))
    assert sim.state.twist[0].tolist() == [0.0, 0.0]
    place = sim.state.pose[0].copy()
    sim.step(np.array([[2.0, 0.0]]))
    # It may close up to the wall, by less than a check of travel, and never leaves again forwards.
    assert 0.0 <= sim.state.pose[0, 0] - place[0] <= 0.05
    for _ in range(10):
        sim.step(np.array([[-2.0, 0.0]]))
        assert not sim.state.contact[0]
    # From -0 to -2 m/s in one step of 0.1 s, then 0.2 m a step: over 1.5 m in 1 s.
    assert sim.state.pose[0, 0] < place[0] - 1.5


def test_turning_on_the_spot_a_box_hits_what_a_circle_does_not(make_robot, simulate) -> None:
    wall = np.array([[-1.0, 0.25, 1.0, 0.25]])
    world = World("beside", BOUNDS, segments=wall)
    # The box's corner reaches 0.36 m, its side only 0.2 m: it cannot turn beside a wall at 0.25 m.
    outcomes = []
    for footprint in (CIRCLE, BOX):
        sim = simulate(make_robot(footprint=footprint, **FAST), world, [[0.0, 0.0, 0.0]])
        touched = False
        for _ in range(40):
            sim.step(np.array([[0.0, 1.0]]))
            touched |= bool(sim.state.contact[0])
        outcomes.append(touched)
        # The corner (0.3, 0.2) is level with the wall at 0.25 m when turned by
        # asin(0.25 / 0.3606) - atan(0.2 / 0.3) = 0.766 - 0.588 = 0.178 rad.
        if footprint is BOX:
            assert 0.0 <= sim.state.pose[0, 2] < 0.178
    assert outcomes == [False, True]
