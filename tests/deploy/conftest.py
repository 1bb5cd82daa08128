# SPDX-License-Identifier: Apache-2.0
"""A robot's messages, worked out by hand, and the judge of the fuzzer."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest

from pm01_nav.deploy.messages import Odometry, Scan
from pm01_nav.robot import load_robot

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def robot():
    """PM01: a disc of 0.17 m, 0.5 m/s, 2 m/s^2, lag 0.05 s, 360 beams up to 3.5 m."""
    return load_robot("pm01")


@pytest.fixture(scope="session")
def make_scan(robot):
    def make(stamp: float, distance: float = np.inf, **ranges: float) -> Scan:
        """Return a scan with one range everywhere, but for beams named ``beam_180=0.4``."""
        lidar = robot.lidar
        values = np.full(lidar.num_beams, distance, dtype=np.float32)
        for name, value in ranges.items():
            values[int(name.removeprefix("beam_"))] = value
        return Scan(
            stamp,
            lidar.angle_min,
            lidar.angle_increment,
            lidar.range_min,
            lidar.range_max,
            values,
        )

    return make


@pytest.fixture(scope="session")
def make_odometry():
    def make(stamp: float, v: float = 0.0, w: float = 0.0, pose=(0.0, 0.0, 0.0)) -> Odometry:
        return Odometry(stamp, np.array(pose, dtype=float), np.array([v, w]))

    return make


@pytest.fixture(scope="session")
def benchmark_script():
    """Return a function that imports a script of ``benchmarks/`` by its name."""
    sys.path.insert(0, str(ROOT / "benchmarks"))
    yield importlib.import_module
    sys.path.remove(str(ROOT / "benchmarks"))


@pytest.fixture(scope="session")
def safety_fuzz(benchmark_script):
    """Return the fuzzer ``benchmarks/safety_fuzz.py`` as a module."""
    return benchmark_script("safety_fuzz")
