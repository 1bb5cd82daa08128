# SPDX-License-Identifier: Apache-2.0
"""What a worker process of a benchmark does: one job after the other, each for one entry."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pm01_nav.benchmark.entry import Entry
from pm01_nav.benchmark.evaluate import Evaluator, GoalSource, PolicyFailureError, answer
from pm01_nav.benchmark.merge import merge_parts
from pm01_nav.benchmark.recorder import EpisodeResults
from pm01_nav.benchmark.store import Part, ResultsFolder
from pm01_nav.benchmark.suite import Suite
from pm01_nav.benchmark.trace import trace_episode
from pm01_nav.policy.protocol import Policy
from pm01_nav.task.terminations import out_of_time

TIMED_STEPS = 300
WARM_UP_STEPS = 10
"""The first steps compile kernels and fill caches; they are not timed."""
KEPT_EVALUATORS = 4
"""Worlds of so many parts are kept for the next entry."""


@dataclass(frozen=True)
class Job:
    """Episodes to drive, computing times to measure, or episodes to trace."""

    kind: Literal["episodes", "timing", "replays"]
    suite: Suite
    entry: Entry
    first: int = 0
    """Number of the first episode to drive."""
    count: int = 0
    """Episodes to drive, or to trace."""


class Worker:
    """Does jobs for one results folder, and keeps worlds and policies from one to the next."""

    def __init__(self, folder: ResultsFolder, origin: dict[str, Any]) -> None:
        """Write into ``folder``; ``origin`` says where results come from (``provenance``)."""
        self._folder, self._origin = folder, origin
        self._evaluators: dict[tuple[str, int, int], Evaluator] = {}
        self._policies: dict[tuple[str, str], Policy] = {}

    def do(self, job: Job) -> None:
        """Do a job and write what comes of it.

        Raises:
            InputError: worlds or policy cannot be had.
        """
        {"episodes": self._drive, "timing": self._time, "replays": self._trace}[job.kind](job)

    def _drive(self, job: Job) -> None:
        evaluator = self._evaluator(job.suite, job.first, job.count)
        numbers = np.arange(job.first, job.first + job.count)
        results, _ = evaluator.run(self._policy(job), numbers)
        header = {
            "suite": job.suite.name,
            "entry": job.entry.name,
            "first": job.first,
            "about_suite": job.suite.describe(),
            "about_entry": job.entry.describe(),
        }
        self._folder.save(Part(header | self._origin, results))

    def _time(self, job: Job) -> None:
        """Measure single steps of one robot, as it would be on a robot."""
        evaluator = self._evaluator(job.suite, 0, job.count)
        policy, times = self._policy(job), []
        for number in range(job.count):
            times += _step_times(evaluator, policy, number)
            if len(times) >= WARM_UP_STEPS + TIMED_STEPS:
                break
        self._folder.save_timing(job.suite.name, job.entry.name, times[WARM_UP_STEPS:])

    def _trace(self, job: Job) -> None:
        parts = self._folder.parts(job.suite.name, job.entry.name)
        episode, results = merge_parts([part for _, part in parts])
        for number in notable(results, episode, job.count).tolist():
            file = self._folder.trace_file(job.suite.name, job.entry.name, number)
            if not file.is_file():
                evaluator = self._evaluator(job.suite, number, 1)
                trace_episode(evaluator, self._policy(job), number).save(file)

    def _evaluator(self, suite: Suite, first: int, count: int) -> Evaluator:
        # Worlds from files are the same for all parts, and slow to read.
        key = (suite.name, 0, 1) if suite.from_files else (suite.name, first, count)
        if key not in self._evaluators:
            while len(self._evaluators) >= KEPT_EVALUATORS:
                self._evaluators.pop(next(iter(self._evaluators)))
            self._evaluators[key] = Evaluator(suite.task, key[2], suite.seed, first=key[1])
        return self._evaluators[key]

    def _policy(self, job: Job) -> Policy:
        key = (job.entry.name, job.suite.name)
        if key not in self._policies:
            self._policies[key] = job.entry.load(job.suite)
        return self._policies[key]


def _step_times(evaluator: Evaluator, policy: Policy, number: int) -> list[float]:
    """Return how long the policy took for each step of an episode, or of its beginning [ms]."""
    batch = evaluator.begin(np.array([number]))
    source = GoalSource(batch, evaluator.pool, evaluator.look_ahead)
    policy.reset()
    times: list[float] = []
    over = False
    while not over and len(times) < TIMED_STEPS:
        began = time.perf_counter()
        try:
            command = answer(policy, batch, source)
        except PolicyFailureError:
            break
        times.append(1e3 * (time.perf_counter() - began))
        if not np.all(np.isfinite(command)):
            break
        step = batch.advance(command)
        over = bool(step.reached[0] | step.collided[0] | out_of_time(step, batch.config)[0])
    return times


def notable(results: EpisodeResults, episode: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """Return the numbers of ``count`` episodes to look at: the first one, then the worst.

    Failures are worst, then collisions, timeouts, and successes that took long for their way.
    """
    lost = ~results.success
    outcome = np.select([results.failure != "", results.collision, lost], [3, 2, 1], 0)
    slow = results.steps / np.maximum(results.shortest_path, 1e-3)
    worst = episode[np.lexsort((-slow, -outcome))]
    return np.concatenate([episode[:1], worst[worst != episode[0]]])[:count]
