# SPDX-License-Identifier: Apache-2.0
"""How long a control step takes, and whether memory grows over an hour of simulated driving.

python benchmarks/deploy_latency.py --policy runs/demo/policy.onnx --out FILE.json
"""

from __future__ import annotations

import argparse
import json
import resource
import time
from pathlib import Path
from typing import Any

import numpy as np

from pm01_nav.deploy.assembly import load_controller
from pm01_nav.deploy.controller import Controller, Goal
from pm01_nav.deploy.simulated_robot import SimulatedRobot, simulated_robot
from pm01_nav.provenance import provenance


def resident_mb() -> float:
    """Return the memory in use now [MB]."""
    pages = int(Path("/proc/self/statm").read_text(encoding="utf-8").split()[1])
    return pages * resource.getpagesize() / 1e6


def soak(controller: Controller, robot: SimulatedRobot, seconds: float) -> dict[str, Any]:
    """Drive for so long of simulated time, as fast as it goes, and note each step."""
    times, cpu, memory, arrived = [], [], [], 0
    controller.set_goal(Goal(*map(float, robot.goal)))
    began = time.perf_counter()
    while robot.time < seconds:
        new_scan = robot.step()
        controller.see_odometry(robot.odometry(), robot.time)
        if not new_scan:
            continue
        scan = robot.scan()
        start, start_cpu = time.perf_counter(), time.thread_time()
        controller.see_scan(scan, robot.time)
        status = controller.step(robot.time)
        cpu.append(time.thread_time() - start_cpu)
        times.append(time.perf_counter() - start)
        robot.command(*status.verdict.command)
        if status.arrived or len(times) % 600 == 0:
            arrived += status.arrived
            robot.reset()
        if controller.goal is None:
            controller.set_goal(Goal(*map(float, robot.goal)))
        if len(times) % 1000 == 0:
            memory.append(resident_mb())
    wall = time.perf_counter() - began
    return {
        "simulated_seconds": seconds,
        "times_real_time": round(seconds / wall, 1),
        "steps": len(times),
        "goals_reached": int(arrived),
        "collisions": robot.collisions,
        "step_ms": _percentiles(times),
        "step_cpu_ms": _percentiles(cpu),
        "steps_beyond_control_dt": int((np.array(times) > controller.control_dt).sum()),
        "memory_mb_first": memory[1],
        "memory_mb_last": memory[-1],
        "memory_growth_percent": round(100.0 * (memory[-1] / memory[1] - 1.0), 2),
    }


def _percentiles(seconds: list[float]) -> dict[str, float]:
    values = 1e3 * np.array(seconds[100:])
    return {f"p{p:g}": round(float(np.percentile(values, p)), 3) for p in (50, 95, 99, 99.9)}


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--policy", required=True)
    parser.add_argument("--seconds", type=float, default=3600.0)
    parser.add_argument("--out", type=Path, required=True)
    arguments = parser.parse_args()
    controller = load_controller(arguments.policy, same_clock=True)
    robot = simulated_robot("static", controller.robot.name, seed=1, dt=0.05)
    result = soak(controller, robot, arguments.seconds)
    print(json.dumps(result))
    command = "python benchmarks/deploy_latency.py --policy POLICY"
    report = result | provenance() | {"command": command}
    arguments.out.write_text(json.dumps(report, indent=2) + "\n")


if __name__ == "__main__":
    main()
