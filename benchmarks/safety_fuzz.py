# SPDX-License-Identifier: Apache-2.0
"""Throw broken sequences of messages at the controller and judge every command by other means.

    python benchmarks/safety_fuzz.py --sequences 200000 --out benchmarks/results/safety_fuzz.json

Each sequence (``fuzz_sequence.py``) is a robot among discs, with a clock of its own. Its messages
are dropped, doubled, delayed, overtaken and corrupted (``fuzz_faults.py``): NaN, zeros and ranges
beyond the limits, everywhere, here and there or just ahead, frozen and constant scans, other
numbers of beams, other frames, a second publisher. Clocks jump, the policy answers with nonsense,
and somebody plays with the emergency stop and the goal. The judge (``fuzz_judge.py``) shares no
code with the supervisor: it works with small time steps in true coordinates.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from typing import Any, NamedTuple

from fuzz_faults import BROKEN, HONEST, Faults
from fuzz_sequence import LONG_TICKS, TICKS, Sequence
from reference_robot import robot_with
from report import write_report

from pm01_nav.planners import make_planner

FAULTS: dict[str, Faults] = {"broken": BROKEN, "honest": HONEST, "goals": HONEST}
"""Of each kind of sequence; in ``goals`` a planner drives to a goal, with nothing in its way."""
GOAL_TICKS = 200
BATCH = 500


class Job(NamedTuple):
    """Sequences of some seeds."""

    seeds: range
    robot: str
    kind: str


def run_batch(job: Job) -> dict[str, Any]:
    """Play sequences."""
    robot = robot_with(job.robot, 60 if job.kind == "broken" else 360)
    total, told = Counter[str](), Counter[str]()
    contacts, undeceived, arrived = 0, 0, 0
    examples: list[int] = []
    for seed in job.seeds:
        policy = make_planner("goal_seeking", robot, 0.1) if job.kind == "goals" else None
        sequence = Sequence(seed, robot, FAULTS[job.kind], policy)
        sequence.run(GOAL_TICKS if policy else None)
        told.update(sequence.told)
        contacts += bool(sequence.contacts)
        wrong = bool(sequence.contacts) and not sequence.deceived
        undeceived += wrong
        arrived += sequence.arrived
        total.update(sequence.violations)
        if sequence.violations or wrong:
            examples.append(seed)
    return {
        "unsafe": total,
        "told": told,
        "contacts": contacts,
        "undeceived": undeceived,
        "arrived": arrived,
        "examples": examples[:5],
    }


def run(
    sequences: int,
    workers: int,
    robot: str,
    kind: str,
    write: Callable[[dict[str, Any]], None],
) -> None:
    """Play many sequences on so many cores, add up, and ``write`` after each batch."""
    starts = range(0, sequences, BATCH)
    jobs = [Job(range(k, min(k + BATCH, sequences)), robot, kind) for k in starts]
    unsafe, told = Counter[str](), Counter[str]()
    contacts, undeceived, arrived = 0, 0, 0
    examples: list[int] = []
    done, started = 0, time.perf_counter()
    with ProcessPoolExecutor(workers) as pool:
        for job, result in zip(jobs, pool.map(run_batch, jobs), strict=True):
            done += len(job.seeds)
            unsafe.update(result["unsafe"])
            told.update(result["told"])
            contacts += result["contacts"]
            undeceived += result["undeceived"]
            arrived += result["arrived"]
            examples += result["examples"]
            reached = {"goals_reached": arrived} if kind == "goals" else {}
            write(
                {
                    "robot": robot,
                    "faults": kind,
                    "sequences": done,
                    "commands": told["DRIVES"] + told["STANDS"],
                    "unsafe_commands": dict(unsafe),
                    # A lidar that froze less than a second ago, or lies plausibly, hides discs.
                    "sequences_with_contact_while_moving": contacts,
                    "of_these_with_true_messages": undeceived,
                    **reached,
                    "first_bad_seeds": examples[:5],
                    "told": dict(told.most_common()),
                    "seconds": round(time.perf_counter() - started, 1),
                }
            )


def main() -> None:
    """Play sequences of all kinds with a round, an oblong and an omnidirectional robot."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sequences", type=int, default=200_000, help="broken ones of PM01")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", required=True)
    arguments = parser.parse_args()
    count = arguments.sequences
    kinds = (
        ("pm01", "goals", count // 400),
        ("pm01", "broken", count),
        ("pm01", "honest", count // 20),
        ("jackal", "broken", count // 5),
        ("jackal", "honest", count // 20),
        ("omni_disc", "broken", count // 5),
        ("omni_disc", "honest", count // 20),
    )
    results: dict[str, dict[str, Any]] = {}
    settings = {"control_steps": TICKS, "with_a_frozen_lidar": LONG_TICKS}
    for robot, kind, sequences in kinds:
        name = f"{robot}_{kind}"

        def write(result: dict[str, Any], name: str = name) -> None:
            results[name] = result
            write_report(arguments.out, {"results": results, "settings": settings})

        run(sequences, arguments.workers, robot, kind, write)


if __name__ == "__main__":
    main()
