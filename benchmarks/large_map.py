# SPDX-License-Identifier: Apache-2.0
"""What a large map costs whose known part is one room, beside the same room cut out.

python benchmarks/large_map.py --out benchmarks/results/large_map.json

Both maps show a room of 12 m x 12 m with a pillar on cells of 0.05 m, one in 4000 x 4000 cells of
grey 205, as SLAM tools save it, and one in 260 x 260. Commands run turn about, so that other work
on the machine falls on both; processor time is less disturbed by it than wall time.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from report import write_report

SIDES = {"large": 4000, "cropped": 260}
EVALUATE = ("evaluate", "goal_seeking", "--task", "map", "--episodes", "100")
TRAIN = ("train", "--task", "map", "--steps", "131072")
"""As many steps as two cores at rest make in about 20 s."""


def write_map(folder: Path, name: str, side: int) -> Path:
    """Write a map of ``side`` x ``side`` cells with the room in its middle."""
    cells = np.full((side, side), 205, dtype=np.uint8)
    middle = side // 2
    cells[middle - 120 : middle + 120, middle - 120 : middle + 120] = 0
    cells[middle - 118 : middle + 118, middle - 118 : middle + 118] = 254
    cells[middle - 10 : middle + 10, middle - 10 : middle + 10] = 0
    Image.fromarray(cells).save(folder / f"{name}.pgm")
    path = folder / f"{name}.yaml"
    path.write_text(
        f"image: {name}.pgm\nresolution: 0.05\norigin: [{-0.025 * side}, {-0.025 * side}, 0.0]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.25\n"
    )
    return path


def measure(command: list[str]) -> dict[str, float]:
    """Run a command; return its wall and processor time [s] and its peak memory [MB]."""
    began = time.perf_counter()
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, command)
    return {
        "wall_s": round(time.perf_counter() - began, 2),
        "processor_s": round(usage.ru_utime + usage.ru_stime, 2),
        "peak_mb": round(usage.ru_maxrss / 1024),
    }


def medians(runs: list[dict[str, float]]) -> dict[str, Any]:
    """Return the median of each figure, and all runs."""
    return {key: statistics.median(run[key] for run in runs) for key in runs[0]} | {"runs": runs}


def main() -> None:
    """Measure and report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", required=True)
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    pm01 = str(Path(sys.executable).with_name("pm01"))
    evaluations: dict[str, list[dict[str, float]]] = {name: [] for name in SIDES}
    trainings: dict[str, list[dict[str, float]]] = {name: [] for name in SIDES}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        maps = {name: write_map(folder, name, side) for name, side in SIDES.items()}
        measure([pm01, *EVALUATE, "--map", str(maps["cropped"])])  # Compiles the kernels.
        for k in range(options.repeats):
            for kind, path in maps.items():
                evaluations[kind].append(measure([pm01, *EVALUATE, "--map", str(path)]))
                out = str(folder / f"{kind}_{k}")
                trainings[kind].append(measure([pm01, *TRAIN, "--map", str(path), "--out", out]))
    results = {
        "evaluate_100_episodes": {kind: medians(runs) for kind, runs in evaluations.items()},
        "train_131072_steps": {kind: medians(runs) for kind, runs in trainings.items()},
    }
    for figures in results.values():
        pair = figures["large"], figures["cropped"]
        figures["ratio"] = {
            key: round(pair[0][key] / pair[1][key], 3) for key in pair[0] if key != "runs"
        }
    write_report(options.out, results)


if __name__ == "__main__":
    main()
