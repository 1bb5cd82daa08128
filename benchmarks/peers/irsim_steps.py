"""Environment steps per second of IR-SIM: one robot, one 2D lidar, no display.

IR-SIM is no dependency of this package. Install it in a virtual environment of its own:

    python -m venv irsim-env
    irsim-env/bin/pip install ir-sim==2.12.0
    irsim-env/bin/python benchmarks/peers/irsim_steps.py --beams 20

One step is one ``env.step()``: motion, lidar scan and collision check, and the reset of an
episode that ends. The result is one line of JSON, the last on standard output.
"""

import argparse
import json
import math
import statistics
import tempfile
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any

import irsim  # pyright: ignore[reportMissingImports]
import numpy as np

SIZE_M, DISCS, RADIUS_M, RANGE_M, STEP_S = 10.0, 12, 0.17, 3.5, 0.1
MAX_V, MAX_W, MAX_STEPS = 0.5, 1.5, 500
CONDITIONS = (
    f"headless; {SIZE_M:g} m square room, {DISCS} discs of radius 0.15-0.5 m, a new scene per "
    f"repeat; diff robot r={RADIUS_M} m; lidar 360 deg, {RANGE_M} m; {STEP_S} s step; random "
    f"actions; reset to a random pose in the same scene on collision or {MAX_STEPS} steps"
)


def free_point(rng: np.random.Generator, discs: np.ndarray, radius: float) -> np.ndarray:
    """Draws a point whose circle of ``radius`` touches no wall and no disc (x, y, r)."""
    while True:
        point = rng.uniform(radius, SIZE_M - radius, 2)
        if (np.hypot(*(discs[:, :2] - point).T) > discs[:, 2] + radius).all():
            return point


def make_env(rng: np.random.Generator, beams: int, path: Path) -> tuple[Any, np.ndarray]:
    """Builds a walled room of random discs, written as JSON, which IR-SIM reads as YAML."""
    discs = np.empty((0, 3))
    for radius in rng.uniform(0.15, 0.5, DISCS):
        discs = np.vstack([discs, [*free_point(rng, discs, radius), radius]])
    ring = [[0, 0], [SIZE_M, 0], [SIZE_M, SIZE_M], [0, SIZE_M], [0, 0]]
    obstacles: list[Any] = [{"shape": {"name": "linestring", "vertices": ring}}]
    obstacles += [{"shape": {"name": "circle", "radius": r}, "state": [*p, 0]} for *p, r in discs]
    turn = 2 * math.pi * (beams - 1) / beams  # both end beams are included
    lidar = {"name": "lidar2d", "range_max": RANGE_M, "angle_range": turn, "number": beams}
    robot = {"kinematics": {"name": "diff"}, "shape": {"name": "circle", "radius": RADIUS_M}}
    robot |= {"state": [*free_point(rng, discs, RADIUS_M), 0.0], "sensors": [lidar]}
    robot |= {"vel_min": [0.0, -MAX_W], "vel_max": [MAX_V, MAX_W]}
    world = {"height": SIZE_M, "width": SIZE_M, "step_time": STEP_S, "collision_mode": "stop"}
    path.write_text(json.dumps({"world": world, "robot": [robot], "obstacle": obstacles}))
    return irsim.make(str(path), headless=True, log_level="ERROR"), discs


def measure(env: Any, discs: np.ndarray, rng: np.random.Generator, seconds: float) -> list[float]:
    """Steps for ``seconds``; returns steps per wall second, per CPU second and per episode."""
    actions, steps, age, episodes = rng.uniform([0, -MAX_W], [MAX_V, MAX_W], (4096, 2)), 0, 0, 0
    cpu, wall = time.process_time(), time.perf_counter()
    while time.perf_counter() - wall < seconds:
        env.step(actions[steps % len(actions)])
        steps, age = steps + 1, age + 1
        if age >= MAX_STEPS or env.done():
            heading = rng.uniform(-math.pi, math.pi)
            env.robot.set_state([*free_point(rng, discs, RADIUS_M), heading], init=True)
            env.reset()
            age, episodes = 0, episodes + 1
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    return [round(steps / wall, 1), round(steps / cpu, 1), round(steps / max(1, episodes), 1)]


def main() -> None:
    """Measures a new scene per repeat and prints the result."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    for flag, default in (("--beams", 20), ("--repeats", 5), ("--seconds", 2.5)):
        parser.add_argument(flag, type=type(default), default=default)
    args, rows = parser.parse_args(), []
    for repeat in range(args.repeats):
        rng = np.random.default_rng(repeat)
        with tempfile.TemporaryDirectory() as folder:
            scene = make_env(rng, args.beams, Path(folder, "world.yaml"))
        measure(*scene, rng, 0.3)  # warm-up
        rows.append(measure(*scene, rng, args.seconds))
    wall, cpu, episode = (list(column) for column in zip(*rows, strict=True))
    result: dict[str, Any] = {"name": "ir-sim", "version": version("ir-sim")}
    result |= {"env_steps_per_s": statistics.median(wall), "repeats": wall}
    result |= {"env_steps_per_cpu_s": statistics.median(cpu), "cpu_repeats": cpu}
    result |= {"steps_per_episode": statistics.median(episode), "beams": args.beams, "num_envs": 1}
    print(json.dumps(result | {"conditions": CONDITIONS}))


if __name__ == "__main__":
    main()
