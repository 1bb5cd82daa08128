# SPDX-License-Identifier: Apache-2.0
"""How long a benchmark takes: 1000 static episodes, BARN ten times, and one step of each planner.

python benchmarks/benchmark_speed.py --policy runs/demo --barn-policy runs/barn --barn barn_data \
    --out benchmarks/results/benchmark_speed.json
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from report import write_report

from pm01_nav.benchmark.store import ResultsFolder

PM01 = str(Path(sys.executable).with_name("pm01"))
PLANNERS = ("gap_following", "vfh", "pure_pursuit", "regulated_pure_pursuit", "dwa", "mppi")


def seconds(out: Path, suite: str, policy: str, episodes: int, seed: int) -> float:
    """Return how long a benchmark of one policy takes, from the command's start to its end."""
    command = [PM01, "benchmark", "--suite", suite, "--policy", policy, "--seed", str(seed)]
    command += ["--episodes", str(episodes), "--replays", "0", "--out", str(out)]
    began = time.perf_counter()
    subprocess.run(command, check=True, capture_output=True)
    return time.perf_counter() - began


def repeats(suite: str, policy: str, episodes: int, count: int) -> dict[str, Any]:
    """Measure it with worlds of other seeds each time, so that no pool is in the cache."""
    times = []
    for _ in range(count + 1):
        with tempfile.TemporaryDirectory() as folder:
            seed = int(time.time()) % 1000
            times.append(seconds(Path(folder) / "results", suite, policy, episodes, seed))
    # The first one may have compiled kernels.
    times = times[1:]
    return {"median_s": round(median(times), 1), "all_s": [round(t, 1) for t in times]}


def step_times() -> dict[str, dict[str, float]]:
    """Return the computing time of single steps of each planner on `static`, one process."""
    with tempfile.TemporaryDirectory() as name:
        command = [PM01, "benchmark", "--suite", "static", "--episodes", "20", "--jobs", "1"]
        for planner in PLANNERS:
            command += ["--planner", planner]
        subprocess.run([*command, "--out", name], check=True, capture_output=True)
        data = json.loads((Path(name) / "results.json").read_text(encoding="utf-8"))
        found = {}
        for result in data["results"]:
            times = ResultsFolder(Path(name)).timing("static", result["entry"])
            assert times is not None
            found[result["entry"]] = {
                "median_ms": round(float(np.median(times)), 2),
                "p99_ms": round(float(np.percentile(times, 99)), 2),
            }
        return found


def main() -> None:
    """Measure and report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--policy", required=True, help="for the suite static")
    parser.add_argument("--barn-policy", required=True)
    parser.add_argument("--barn", required=True, help="the folder of the dataset, 250 worlds")
    parser.add_argument("--out", required=True)
    options = parser.parse_args()
    results = {
        "static_1000_episodes": repeats("static", options.policy, 1000, 5),
        "barn_2500_episodes": repeats(f"barn={options.barn}", options.barn_policy, 2500, 2),
        "step": step_times(),
    }
    write_report(options.out, results)


if __name__ == "__main__":
    main()
