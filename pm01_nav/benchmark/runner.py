# SPDX-License-Identifier: Apache-2.0
"""Run a benchmark in parallel processes; what is finished stays finished, whatever happens."""

from __future__ import annotations

import multiprocessing
import os
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import Any, NamedTuple

from pm01_nav.benchmark.cluster import drive_on
from pm01_nav.benchmark.entry import Entry
from pm01_nav.benchmark.job import Job, Worker
from pm01_nav.benchmark.merge import Merged
from pm01_nav.benchmark.store import PART, ResultsFolder
from pm01_nav.benchmark.suite import Suite
from pm01_nav.errors import InputError
from pm01_nav.executors import Executor
from pm01_nav.provenance import provenance

TIMED_EPISODES = 20
"""Computing times are measured on at most so many episodes."""


class Plan(NamedTuple):
    """What is still to do."""

    episodes: list[Job]
    rest: list[Job]
    """Computing times and traces; traces need all episodes."""
    done: int
    """Episodes that the folder holds already."""

    @property
    def total(self) -> int:
        """Episodes in all."""
        return self.done + sum(job.count for job in self.episodes)


def plan_benchmark(
    folder: ResultsFolder,
    suites: Sequence[Suite],
    entries: Sequence[Entry],
    episodes: int,
    replays: int,
) -> Plan:
    """Return the jobs that bring a folder to ``episodes`` of each entry on each suite.

    Raises:
        InputError: a policy does not fit a suite's robot, worlds cannot be had, or the folder holds
            results of another suite or policy of the same name.
    """
    merged, held = Merged(), {}
    for file, part in folder.parts():
        merged.admit(file, part.header)
        held[part.header["suite"], part.header["entry"], part.first] = len(part)
    jobs, rest, done = [], [], 0
    for suite in suites:
        for entry in entries:
            entry.load(suite)
            about = {"about_suite": suite.describe(), "about_entry": entry.describe()}
            merged.admit(folder.path, {"suite": suite.name, "entry": entry.name} | about)
            missing = []
            for first in range(0, episodes, PART):
                count = min(PART, episodes - first)
                if held.get((suite.name, entry.name, first), 0) < count:
                    missing.append(Job("episodes", suite, entry, first, count))
            jobs += missing
            done += episodes - sum(job.count for job in missing)
            rest += _rest(folder, suite, entry, min(episodes, TIMED_EPISODES), replays, missing)
    return Plan(jobs, rest, done)


def _rest(
    folder: ResultsFolder,
    suite: Suite,
    entry: Entry,
    timed: int,
    replays: int,
    missing: list[Job],
) -> list[Job]:
    jobs = []
    if missing or not folder.timing_file(suite.name, entry.name).is_file():
        jobs.append(Job("timing", suite, entry, count=timed))
    # On a sweep there are many suites of which nobody looks at single episodes.
    if replays and suite.point is None:
        jobs.append(Job("replays", suite, entry, count=replays))
    return jobs


def run_plan(
    folder: ResultsFolder, plan: Plan, processes: int, cluster: Executor | None = None
) -> Iterator[Job]:
    """Do what a plan says; yield each job when it is done.

    A cluster drives the episodes. Computing times are measured here: those of one machine compare.

    Raises:
        InputError: a job could not be done, or a worker died.
    """
    if cluster is not None:
        yield from drive_on(cluster, folder, plan.episodes)
        plan = plan._replace(episodes=[])
    origin = provenance()
    context = multiprocessing.get_context("spawn")
    stop = context.Event()
    pool = ProcessPoolExecutor(processes, context, _begin, (folder.path, origin, stop))
    try:
        for jobs in (plan.episodes, plan.rest):
            for future in as_completed([pool.submit(_do, job) for job in jobs]):
                yield future.result()
    except BrokenProcessPool:
        raise InputError(
            "a worker process died (out of memory?); the same command goes on where it stopped"
        ) from None
    except OSError as error:
        raise InputError(f"{folder.path}: cannot be written: {error.strerror or error}") from None
    finally:
        # Nobody waits for half-done jobs after an interrupt or an error.
        stop.set()
        pool.shutdown(wait=True, cancel_futures=True)


_worker: Worker | None = None


def _begin(folder: Path, origin: dict[str, Any], stop: Event) -> None:
    """Prepare a worker process: one thread each, and none outlives the run."""
    import numba

    global _worker
    numba.set_num_threads(1)
    threading.Thread(target=_leave_with_parent, args=(stop,), daemon=True).start()
    _worker = Worker(ResultsFolder(folder), origin)


def _leave_with_parent(stop: Event) -> None:
    parent = multiprocessing.parent_process()
    while not stop.wait(0.3):
        if parent is not None and not parent.is_alive():
            break
    os._exit(1)


def _do(job: Job) -> Job:
    assert _worker is not None
    _worker.do(job)
    return job
