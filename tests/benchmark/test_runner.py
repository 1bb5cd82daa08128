# SPDX-License-Identifier: Apache-2.0
"""A benchmark in worker processes: complete, resumed after a kill, and refused where it must be."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from pm01_nav.benchmark.entry import Entry, planner_entry
from pm01_nav.benchmark.runner import Plan, plan_benchmark, run_plan
from pm01_nav.benchmark.store import PART, ResultsFolder
from pm01_nav.benchmark.suite import read_suite
from pm01_nav.errors import InputError

PM01 = str(Path(sys.executable).with_name("pm01"))
SUITE = read_suite("empty", seed=1)
ENTRY = planner_entry("goal_seeking")


def plan(folder: ResultsFolder, episodes: int, entry: Entry = ENTRY, seed: int = 1) -> Plan:
    return plan_benchmark(folder, [read_suite("empty", seed)], [entry], episodes, replays=1)


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> ResultsFolder:
    """Return the results of 130 episodes."""
    folder = ResultsFolder(tmp_path_factory.mktemp("results"))
    jobs = list(run_plan(folder, plan(folder, PART + 5), processes=1))
    assert [job.kind for job in jobs[:2]] == ["episodes", "episodes"]
    assert {job.kind for job in jobs[2:]} == {"timing", "replays"}
    return folder


def test_everything_is_there(finished: ResultsFolder) -> None:
    assert [(part.first, len(part)) for _, part in finished.parts()] == [(0, PART), (PART, 5)]
    header = next(finished.parts())[1].header
    assert header["about_suite"]["hash"] == SUITE.hash
    assert header["about_entry"]["fingerprint"] == ENTRY.fingerprint
    assert {"command", "git_revision", "machine", "versions"} <= set(header)
    assert finished.timing("empty", "goal_seeking") is not None
    assert len(list(finished.traces("empty", "goal_seeking"))) == 1


def test_what_is_there_is_not_done_again(finished: ResultsFolder) -> None:
    again = plan(finished, PART + 5)
    assert (again.episodes, again.done, again.total) == ([], PART + 5, PART + 5)
    # Of the same kind there are no more computing times to measure; traces are looked up by name.
    assert [job.kind for job in again.rest] == ["replays"]
    more = plan(finished, 3 * PART)
    assert [(job.first, job.count) for job in more.episodes] == [(PART, PART), (2 * PART, PART)]
    assert plan(finished, 20).episodes == []


def test_another_suite_or_policy_of_the_same_name_is_refused(finished: ResultsFolder) -> None:
    with pytest.raises(InputError, match="cannot be merged: its suite empty has the hash"):
        plan(finished, 10, seed=2)
    with pytest.raises(InputError, match="cannot be merged: its goal_seeking is not"):
        plan(finished, 10, Entry("goal_seeking", "planner", "goal_seeking", "other"))


def test_a_worker_that_fails_says_why(tmp_path: Path) -> None:
    folder = ResultsFolder(tmp_path)
    good = plan(folder, 2)
    missing = Entry("ours", "policy", "none.onnx", "")
    bad = [job.__class__(job.kind, job.suite, missing, 0, 2) for job in good.episodes]
    with pytest.raises(InputError, match=r"ours on suite empty: .*no such file"):
        list(run_plan(folder, good._replace(episodes=bad), processes=1))


def test_a_folder_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.touch()
    folder = ResultsFolder(file / "results")
    with pytest.raises(InputError, match="cannot be written: Not a directory"):
        list(run_plan(folder, plan(folder, 2), processes=1))


@pytest.mark.slow
def test_a_killed_run_goes_on_where_it_stopped(tmp_path: Path) -> None:
    out = tmp_path / "results"
    command = [PM01, "benchmark", "--suite", "static", "--planner", "vfh", "--jobs", "1"]
    command += ["--episodes", str(4 * PART), "--out", str(out)]
    first_part = ResultsFolder(out).part_file("static", "vfh", 0)
    with subprocess.Popen(command, start_new_session=True) as process:
        while not first_part.is_file():
            assert process.poll() is None
            time.sleep(0.05)
        os.kill(process.pid, signal.SIGKILL)
    kept = first_part.stat().st_mtime_ns
    # The worker notices that nobody is left to work for.
    deadline = time.monotonic() + 10.0
    while _group_is_alive(process.pid):
        assert time.monotonic() < deadline
        time.sleep(0.1)
    done = subprocess.run(command, capture_output=True, text=True, timeout=500)
    assert done.returncode == 0, done.stderr
    assert first_part.stat().st_mtime_ns == kept
    [result] = json.loads((out / "results.json").read_text(encoding="utf-8"))["results"]
    assert result["episodes"] == 4 * PART


def _group_is_alive(leader: int) -> bool:
    try:
        os.killpg(leader, 0)
    except ProcessLookupError:
        return False
    return True
