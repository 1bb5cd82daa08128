"""Results folders and traces made by hand: nothing is driven."""

from __future__ import annotations

import numpy as np
import pytest

from pm01_nav.benchmark.recorder import EpisodeResults
from pm01_nav.benchmark.store import Part, ResultsFolder
from pm01_nav.benchmark.trace import Trace

STEPS = 20


def _results(success):
    """Episodes of 20 steps over 2 m, where 1.6 m would do; who does not succeed collides."""
    success = np.asarray(success, dtype=np.bool_)
    n = len(success)
    return EpisodeResults(
        world=np.arange(n),
        success=success,
        collision=~success,
        steps=np.full(n, STEPS),
        moving_time=np.full(n, 2.0),
        path_length=np.full(n, 2.0),
        shortest_path=np.full(n, 1.6),
        reference_path=np.full(n, np.nan),
        min_clearance=np.linspace(0.1, 0.4, n),
        mean_clearance=np.full(n, 0.5),
        jerk=np.full(n, 0.2),
        turn_reversals=np.zeros(n),
        intrusion=np.full(n, np.nan),
        failure=np.full(n, "", dtype="U1"),
    )


def _trace(outcome="success", reason=""):
    """Two metres to the east in 20 steps of 0.1 s, past a disc, a wall, a triangle and a cell."""
    east = np.linspace(1.0, 3.0, STEPS + 1)
    rows = STEPS + 1
    scan = np.full((rows, 8), 2.0)
    scan[:, 0], scan[:, 1], scan[:, 2] = np.inf, -np.inf, np.nan
    arrays = {
        "pose": np.stack([east, np.full(rows, 2.0), np.linspace(-3.1, 3.1, rows)], axis=1),
        "goal": np.array([3.0, 2.0]),
        "scan": scan,
        "angles": np.linspace(-3.0, 3.0, 8),
        "movers": np.stack([np.stack([east, 0.5 * east, np.full(rows, 0.3)], axis=1)], axis=1),
        "twist": np.tile([1.0, -0.5], (rows, 1)),
        "command": np.tile([1.0, -0.5], (STEPS, 1)),
        "clearance": np.linspace(0.9, 0.1, rows),
        "rewards": np.stack([np.full(STEPS, -0.05), np.linspace(0.0, 0.4, STEPS)], axis=1),
        "bounds": np.array([0.0, 0.0, 4.0, 4.0]),
        "discs": np.array([[2.0, 3.0, 0.5]]),
        "segments": np.array([[0.0, 0.0, 4.0, 0.0]]),
        "corners": np.array([[0.5, 0.5], [1.0, 0.5], [1.0, 1.0]]),
        "grid_frame": np.array([0.0, 0.0, 0.5]),
    }
    grid = np.zeros((8, 8), dtype=np.uint8)
    grid[7, 7] = 1
    about = {
        "outcome": outcome,
        "reason": reason,
        "control_dt": 0.1,
        "goal_radius": 0.3,
        "rewards": ["time", "progress"],
        "robot": {
            "name": "pm01",
            "footprint": {"shape": "circle", "radius": 0.2, "vertices": []},
            "lidar": {"x": 0.1, "y": 0.0, "range_max": 3.5},
        },
        "world": "static",
    }
    arrays = {name: np.asarray(array, dtype=np.float32) for name, array in arrays.items()}
    return Trace(about, grid=grid, corner_counts=np.array([3]), **arrays)


def _header(suite, entry, sweep, **changes):
    return {
        "suite": suite,
        "entry": entry,
        "first": 0,
        "about_suite": {
            "task": "static",
            "robot": "pm01",
            "seed": 1,
            "hash": "a" * 64,
            "control_dt": 0.1,
            "time_limit_s": 50.0,
            "sweep": sweep,
        },
        "about_entry": {
            "name": entry,
            "kind": "planner",
            "source": entry,
            "fingerprint": "b" * 64,
        },
        "command": "pm01 benchmark --out x",
        "created": "2026-01-02T03:04:05+00:00",
        "git_revision": "0123456789ab",
        "versions": {"python": "3.11.7"},
        "machine": {"system": "Linux", "processor": "a processor", "cores": 2},
    } | changes


@pytest.fixture
def trace():
    return _trace


@pytest.fixture
def results(tmp_path):
    """A function that adds an entry's episodes on a suite to ``tmp_path/NAME``."""

    def add(suite, entry, success, *, traces=(), sweep=None, reason="", folder="x", **changes):
        store = ResultsFolder(tmp_path / folder)
        store.save(Part(_header(suite, entry, sweep, **changes), _results(success)))
        if "/" in suite + entry:
            # A stranger's header may say what a folder's name cannot.
            there = store.path / "parts" / "any" / "any" / "00000000.npz"
            there.parent.mkdir(parents=True)
            store.part_file(suite, entry, 0).rename(there)
        for number in traces:
            outcome = "success" if success[number] else "collision"
            _trace(outcome, reason).save(store.trace_file(suite, entry, number))
        return store.path

    return add
