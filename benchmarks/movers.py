# SPDX-License-Identifier: Apache-2.0
"""Environment steps a second of simulator and task among walking pedestrians, both models.

python benchmarks/movers.py --out benchmarks/results/movers.json
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np
from report import write_report
from throughput import measure, with_beams

from pm01_nav.worlds.mover import Mover
from pm01_nav.worlds.pool import generate_pool
from pm01_nav.worlds.world import World


def crowd(rng: np.random.Generator, num_pedestrians: int) -> World:
    """Draw a walled 10 m x 10 m room with pedestrians that walk to random places."""
    walls = np.array([[0, 0, 10, 0], [10, 0, 10, 10], [10, 10, 0, 10], [0, 10, 0, 0]], dtype=float)
    places: list[np.ndarray] = []
    while len(places) < num_pedestrians:
        # Centre U(0.5, 9.5)^2 m, at least 0.7 m from the others.
        place = rng.uniform(0.5, 9.5, 2)
        if all(np.hypot(*(place - other)) > 0.7 for other in places):
            places.append(place)
    # Preferred speed U(0.8, 1.4) m/s.
    movers = tuple(
        Mover("pedestrian", 0.25, place[None], speed=rng.uniform(0.8, 1.4)) for place in places
    )
    return World("crowd", (0.0, 0.0, 10.0, 10.0), segments=walls, movers=movers)


def main() -> None:
    """Measure and report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", required=True)
    parser.add_argument("--num-envs", type=int, default=256)
    parser.add_argument("--pedestrians", type=int, default=20)
    parser.add_argument("--beams", type=int, default=360)
    parser.add_argument("--seconds", type=float, default=1.0)
    options = parser.parse_args()
    results: dict[str, Any] = {"num_envs": options.num_envs, "unit": "environment steps/s"}
    for count, model in (
        (0, "orca"),
        (options.pedestrians, "orca"),
        (options.pedestrians, "social_force"),
    ):
        pool = generate_pool(lambda rng, count=count: crowd(rng, count), range(64), radius=0.27)
        task = with_beams(options.beams).model_copy(update={"pedestrians": model})
        name = f"{options.beams}_beams_{count}_pedestrians_{model}"
        results[name] = measure(task, pool, options.num_envs, options.seconds)
        results[name]["best"] = max(results[name]["repeats"])
    write_report(options.out, results)


if __name__ == "__main__":
    main()
