# SPDX-License-Identifier: Apache-2.0
"""Start-up times, latency of a policy, and memory of a training.

python benchmarks/startup.py --policy runs/demo/policy.onnx --out benchmarks/results/startup.json
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
from report import write_report

from pm01_nav.policy import OnnxPolicy

FIRST_STEP = (
    "import gymnasium as gym, pm01_nav.envs; env = gym.make('PM01Nav-v1'); "
    "env.reset(seed=0); env.step(env.action_space.sample())"
)


def seconds(command: list[str], repeats: int, **environment: str) -> dict[str, Any]:
    """Run a command several times; return its wall time [s], Python's own start-up included."""
    times = []
    for _ in range(repeats):
        began = time.perf_counter()
        subprocess.run(command, check=True, capture_output=True, env=os.environ | environment)
        times.append(time.perf_counter() - began)
    return {"median": round(statistics.median(times), 3), "repeats": [round(t, 3) for t in times]}


def act_latency(path: str, calls: int = 20000) -> dict[str, float]:
    """Return the latency of ``OnnxPolicy.act`` on random scans [ms]."""
    policy = OnnxPolicy(path)
    rng = np.random.default_rng(0)
    scans = rng.uniform(0.2, 3.5, (64, policy.layout.scan.num_beams)).astype(np.float32)
    goal, velocity = np.array([2.0, 0.5]), np.array([0.3, 0.1])
    for scan in scans:
        policy.act(scan, goal, velocity)
    times = np.zeros(calls)
    for k in range(calls):
        began = time.perf_counter()
        policy.act(scans[k % 64], goal, velocity)
        times[k] = time.perf_counter() - began
    p50, p99 = np.percentile(1e3 * times, [50, 99])
    return {"p50_ms": round(float(p50), 4), "p99_ms": round(float(p99), 4), "calls": calls}


def training_memory() -> dict[str, float]:
    """Return the peak resident memory of a default training of 30 s [MB]."""
    measure = (
        "import resource, subprocess, sys; subprocess.run(sys.argv[1:], check=True); "
        "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024)"
    )
    with tempfile.TemporaryDirectory() as folder:
        pm01 = str(Path(sys.executable).with_name("pm01"))
        train = [pm01, "train", "--task", "static", "--time-budget", "30", "--out", f"{folder}/x"]
        answer = subprocess.run(
            [sys.executable, "-c", measure, *train], check=True, capture_output=True, text=True
        )
    return {"peak_mb": round(float(answer.stdout.split()[-1]))}


def main() -> None:
    """Measure and report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", required=True)
    parser.add_argument("--policy", required=True)
    options = parser.parse_args()
    python, pm01 = sys.executable, str(Path(sys.executable).with_name("pm01"))
    first_step = [python, "-c", FIRST_STEP]
    with tempfile.TemporaryDirectory() as cache:
        cold = seconds(first_step, 1, PM01_CACHE=cache)
        warm = seconds(first_step, 5, PM01_CACHE=cache)
    results = {
        "unit": "seconds, with Python's own start-up",
        "import_pm01_nav": seconds([python, "-c", "import pm01_nav"], 9),
        "pm01_help": seconds([pm01, "--help"], 9),
        "first_step_cold": cold,
        "first_step_warm": warm,
        "onnx_policy_act": act_latency(options.policy),
        "training_memory": training_memory(),
    }
    write_report(options.out, results)


if __name__ == "__main__":
    main()
