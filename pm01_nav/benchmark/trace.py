# SPDX-License-Identifier: Apache-2.0
"""One episode step by step, to be looked at later."""

from __future__ import annotations

import io
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pm01_nav.benchmark.evaluate import Evaluator, GoalSource, PolicyFailureError, answer
from pm01_nav.config import write_atomically
from pm01_nav.errors import InputError
from pm01_nav.policy.protocol import Policy
from pm01_nav.robot import RobotSpec
from pm01_nav.task.navigation import NavigationBatch
from pm01_nav.task.terminations import out_of_time
from pm01_nav.worlds.barn import UNREADABLE
from pm01_nav.worlds.grid import OccupancyGrid
from pm01_nav.worlds.raster import rasterise
from pm01_nav.worlds.world import World

FORMAT = 1
BEAMS = 60
"""Beams kept of a scan, evenly spread."""

FloatArray = NDArray[np.float64]
Single = NDArray[np.float32]


@dataclass(frozen=True)
class Trace:
    """T steps of one robot; arrays of T + 1 rows begin with the start."""

    about: dict[str, Any]
    """Plain data: ``outcome`` (success, collision, timeout or failure), ``reason``, ``control_dt``,
    ``goal_radius``, ``rewards`` (names of the columns), ``robot`` (footprint, lidar), ``world``."""
    pose: Single
    """x, y, yaw [m, m, rad], shape (T + 1, 3)."""
    goal: Single
    """x, y [m], shape (2,)."""
    scan: Single
    """Ranges as measured, by REP-117 [m], shape (T + 1, beams)."""
    angles: Single
    """Directions of these beams in base_link [rad], shape (beams,)."""
    movers: Single
    """x, y, radius [m], shape (T + 1, num_movers, 3)."""
    twist: Single
    """v, w [m/s, rad/s], shape (T + 1, 2)."""
    command: Single
    """What the policy answered [m/s, rad/s], shape (T, 2)."""
    clearance: Single
    """[m], shape (T + 1,)."""
    rewards: Single
    """Each term's weighted share of the reward of a step, shape (T, num_terms)."""
    bounds: Single
    """x_min, y_min, x_max, y_max [m], shape (4,)."""
    discs: Single
    """x, y, radius [m], shape (n, 3)."""
    segments: Single
    """x1, y1, x2, y2 of thin walls [m], shape (n, 4)."""
    corners: Single
    """Corners of all polygons [m], shape (n, 2)."""
    corner_counts: NDArray[np.int64]
    """Corners of each polygon."""
    grid: NDArray[np.uint8]
    """1 where a cell is solid, row 0 lowest, shape (height, width) or (0, 0)."""
    grid_frame: Single
    """Origin x, y and side of a cell [m], shape (3,)."""

    def save(self, path: Path) -> None:
        """Write an .npz file."""
        content = io.BytesIO()
        arrays = {name: value for name, value in vars(self).items() if name != "about"}
        about = json.dumps({"format": FORMAT} | self.about)
        np.savez_compressed(content, allow_pickle=False, about=np.array(about), **arrays)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(path, content.getvalue())


def load_trace(path: Path) -> Trace:
    """Read what ``Trace.save`` wrote.

    Raises:
        InputError: the file is not one of ours, or damaged.
    """
    try:
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as entry:
            arrays = dict(entry)
        about = json.loads(str(arrays.pop("about")))
        found = about.pop("format")
        trace = Trace(about, **arrays) if found == FORMAT else None
    except (*UNREADABLE, TypeError, AttributeError) as error:
        raise InputError(f"{path}: is not a readable trace") from error
    if trace is None:
        raise InputError(f"{path}: is a trace of another version (format {found!r})")
    return trace


def trace_episode(evaluator: Evaluator, policy: Policy, number: int) -> Trace:
    """Drive one episode of an evaluator once more, and keep every step."""
    batch = evaluator.begin(np.array([number]))
    source = GoalSource(batch, evaluator.pool, evaluator.look_ahead)
    tape = _Tape(batch)
    policy.reset()
    tape.look()
    outcome, reason = "", ""
    while not outcome:
        try:
            command = answer(policy, batch, source)
        except PolicyFailureError as failure:
            outcome, reason = "failure", str(failure)
            break
        if not np.all(np.isfinite(command)):
            outcome, reason = "failure", "answered with NaN or infinity"
            break
        outcome = tape.step(command)
    world = evaluator.pool.worlds[int(batch.simulator.state.world[0])]
    return tape.trace(world, outcome, reason)


class _Tape:
    """Collects the rows of a trace."""

    def __init__(self, batch: NavigationBatch) -> None:
        self._batch = batch
        beams = batch.robot.lidar.num_beams
        self._beams = np.unique(np.linspace(0, beams - 1, min(beams, BEAMS)).astype(np.int64))
        names = ("pose", "scan", "movers", "twist", "clearance", "command", "rewards")
        self._rows: dict[str, list[NDArray[Any]]] = {name: [] for name in names}
        self._action = np.zeros((1, batch.layout.drive.size))

    def look(self) -> None:
        """Note how things are."""
        simulator, state = self._batch.simulator, self._batch.simulator.state
        now = {
            "pose": state.pose[0],
            "scan": simulator.scan[0, self._beams],
            "movers": simulator.movers(0),
            "twist": state.twist[0],
            "clearance": state.clearance[0],
        }
        for name, row in now.items():
            self._rows[name].append(np.array(row, dtype=np.float32))

    def step(self, command: FloatArray) -> str:
        """Advance by a command (1, axes); return how the episode ended, empty if it goes on."""
        batch = self._batch
        step = batch.advance(command)
        step.action, step.previous_action = batch.layout.drive.to_action(command), self._action
        self._action = step.action
        self._rows["command"].append(command[0].astype(np.float32))
        self._rows["rewards"].append(batch.reward_terms(step)[:, 0].astype(np.float32))
        self.look()
        if step.reached[0]:
            return "success"
        if step.collided[0]:
            return "collision"
        return "timeout" if out_of_time(step, batch.config)[0] else ""

    def trace(self, world: World, outcome: str, reason: str) -> Trace:
        """Return all of it."""
        batch, config = self._batch, self._batch.config
        rows = {name: np.array(rows, dtype=np.float32) for name, rows in self._rows.items()}
        # A policy that fails at once leaves no rows, whose width must be known all the same.
        rows["command"] = rows["command"].reshape(-1, batch.layout.drive.size)
        rows["rewards"] = rows["rewards"].reshape(-1, len(config.rewards))
        about = {
            "outcome": outcome,
            "reason": reason,
            "control_dt": config.control_dt,
            "goal_radius": config.goal_radius,
            "rewards": list(config.rewards),
            "robot": _robot(batch.robot),
            "world": world.name,
        }
        lidar = batch.robot.lidar
        angles = (lidar.angles + lidar.yaw)[self._beams]
        goal = batch.simulator.state.goal[0]
        return Trace(about, goal=_single(goal), angles=_single(angles), **rows, **_geometry(world))


def _robot(robot: RobotSpec) -> dict[str, Any]:
    lidar = robot.lidar
    return {
        "name": robot.name,
        "footprint": robot.footprint.model_dump(mode="json"),
        "lidar": {"x": lidar.x, "y": lidar.y, "range_max": lidar.range_max},
        "limits": robot.limits.model_dump(mode="json"),
    }


def _geometry(world: World) -> dict[str, NDArray[Any]]:
    grid = None if world.grid is None else _not_turned(world.grid.known)
    frame = (*grid.origin, grid.resolution) if grid else (0.0, 0.0, 1.0)
    return {
        "bounds": _single(world.known_bounds),
        "discs": _single(world.discs),
        "segments": _single(world.segments),
        "corners": _single(np.concatenate([np.zeros((0, 2)), *world.polygons])),
        "corner_counts": np.array([len(polygon) for polygon in world.polygons], dtype=np.int64),
        "grid": grid.occupied if grid else np.zeros((0, 0), dtype=np.uint8),
        "grid_frame": _single(frame),
    }


def _not_turned(grid: OccupancyGrid) -> OccupancyGrid:
    """Return a grid for a picture: a turned one on lines along x and y."""
    if grid.yaw == 0.0:
        return grid
    return rasterise(World("grid", grid.extent(), grid=grid), grid.resolution)


def _single(values: Any) -> Single:
    return np.asarray(values, dtype=np.float32)
