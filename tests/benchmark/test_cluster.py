# SPDX-License-Identifier: Apache-2.0
"""Episodes that are driven elsewhere are those that would have been driven here."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pm01_nav.benchmark.cluster import Piece, drive
from pm01_nav.benchmark.entry import policy_entry
from pm01_nav.benchmark.runner import Plan, plan_benchmark, run_plan
from pm01_nav.benchmark.store import PART, ResultsFolder
from pm01_nav.benchmark.suite import read_suite
from pm01_nav.errors import InputError
from pm01_nav.executors import Done

EPISODES = PART + 5


class Elsewhere:
    """A cluster of one, on which the policy's file does not lie; the last piece is done first."""

    def __init__(self, lent: Path) -> None:
        self.lent = lent

    def run(self, function: Any, arguments: Sequence[Piece]) -> Iterator[Done]:
        """Do the pieces with the file put away."""
        away = self.lent.with_suffix(".away")
        self.lent.rename(away)
        try:
            done = [Done(k, function(a)) for k, a in reversed(list(enumerate(arguments)))]
        finally:
            away.rename(self.lent)
        yield from done


class Broken:
    """A cluster that loses what it is given."""

    def run(self, function: Any, arguments: Sequence[Piece]) -> Iterator[Done]:
        """Lose it."""
        yield Done(0, error="the worker died three times")


def plan_of(folder: ResultsFolder, policy: Path) -> Plan:
    suites = [read_suite("static", 1)]
    return plan_benchmark(folder, suites, [policy_entry(f"p={policy}")], EPISODES, replays=0)


def test_results_of_a_cluster_are_those_of_one_machine(policy_file: Path, tmp_path: Path) -> None:
    here, there = ResultsFolder(tmp_path / "here"), ResultsFolder(tmp_path / "there")
    for _ in run_plan(here, plan_of(here, policy_file), processes=1):
        pass
    jobs = list(run_plan(there, plan_of(there, policy_file), 1, Elsewhere(policy_file)))
    assert [(job.kind, job.count) for job in jobs[:2]] == [("episodes", 5), ("episodes", PART)]
    # Computing times are measured on this machine.
    assert there.timing("static", "p") is not None
    for (_, mine), (_, theirs) in zip(here.parts(), there.parts(), strict=True):
        for field in dataclasses.fields(mine.results):
            one, other = getattr(mine.results, field.name), getattr(theirs.results, field.name)
            np.testing.assert_array_equal(one, other)
        assert mine.header["about_entry"] == theirs.header["about_entry"]
        assert mine.header["about_suite"] == theirs.header["about_suite"]
    assert not plan_of(there, policy_file).episodes


def test_a_piece_that_is_lost_ends_the_run_and_says_why(policy_file: Path, tmp_path: Path) -> None:
    folder = ResultsFolder(tmp_path)
    with pytest.raises(InputError, match="died three times"):
        list(run_plan(folder, plan_of(folder, policy_file), 1, Broken()))


def test_a_policy_that_does_not_load_is_said(policy_file: Path, tmp_path: Path) -> None:
    (job, *_) = plan_of(ResultsFolder(tmp_path), policy_file).episodes
    with pytest.raises(InputError, match="onnx"):
        drive(Piece(job, b"no policy", "pm01 benchmark"))
