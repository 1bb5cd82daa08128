# SPDX-License-Identifier: Apache-2.0
"""What a worker does: episodes, computing times, traces."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pm01_nav.benchmark.entry import Entry, planner_entry
from pm01_nav.benchmark.evaluate import Evaluator
from pm01_nav.benchmark.job import WARM_UP_STEPS, Job, Worker, notable
from pm01_nav.benchmark.merge import merge_results
from pm01_nav.benchmark.store import ResultsFolder
from pm01_nav.benchmark.suite import read_suite
from pm01_nav.benchmark.trace import load_trace, trace_episode
from pm01_nav.errors import InputError
from pm01_nav.planners import make_planner

SUITE = read_suite("static", seed=1)
ENTRY = planner_entry("goal_seeking")


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> ResultsFolder:
    """Return results of 12 episodes in two parts, with computing times and traces."""
    found = ResultsFolder(tmp_path_factory.mktemp("results"))
    worker = Worker(found, {"git_revision": "c0ffee"})
    worker.do(Job("episodes", SUITE, ENTRY, first=0, count=8))
    worker.do(Job("episodes", SUITE, ENTRY, first=8, count=4))
    worker.do(Job("timing", SUITE, ENTRY, count=2))
    worker.do(Job("replays", SUITE, ENTRY, count=5))
    return found


def planner():
    return make_planner("goal_seeking", SUITE.robot, SUITE.task.control_dt)


def test_parts_hold_what_an_evaluation_finds(folder: ResultsFolder) -> None:
    [score] = merge_results([folder.path]).scores
    whole, _ = Evaluator(SUITE.task, 12, 1).run(planner())
    assert score.results.success.tolist() == whole.success.tolist()
    assert score.results.steps.tolist() == whole.steps.tolist()
    assert score.results.world.tolist() == list(range(12))
    assert score.results.path_length == pytest.approx(whole.path_length)


def test_computing_times_are_measured_without_the_first_steps(folder: ResultsFolder) -> None:
    times = folder.timing("static", "goal_seeking")
    assert times is not None
    whole, _ = Evaluator(SUITE.task, 2, 1).run(planner())
    assert len(times) == whole.steps.sum() - WARM_UP_STEPS
    assert (times > 0.0).all()


def test_traces_tell_the_same_story(folder: ResultsFolder) -> None:
    [score] = merge_results([folder.path]).scores
    traces = dict(folder.traces("static", "goal_seeking"))
    assert len(traces) == 5
    for number, trace in traces.items():
        results = score.results
        steps = results.steps[number]
        assert trace.pose.shape == (steps + 1, 3)
        assert trace.scan.shape == (steps + 1, 60)
        assert len(trace.command) == len(trace.rewards) == steps
        outcome = "success" if results.success[number] else "collision"
        assert trace.about["outcome"] == outcome
        moved = np.linalg.norm(np.diff(trace.pose[:, :2], axis=0), axis=1).sum()
        assert moved == pytest.approx(results.path_length[number], rel=1e-4)
        assert trace.clearance.min() == pytest.approx(results.min_clearance[number], abs=1e-5)
        # The goal's reward is paid once, in the last step, the time's in each.
        paid = dict(zip(trace.about["rewards"], trace.rewards.sum(axis=0), strict=True))
        assert paid["goal"] == (100.0 if outcome == "success" else 0.0)
        assert paid["time"] == pytest.approx(-0.05 * steps, rel=1e-4)


def test_a_trace_has_the_moving_obstacles() -> None:
    crowd = read_suite("crowd", seed=1)
    driver = make_planner("goal_seeking", crowd.robot, crowd.task.control_dt)
    trace = trace_episode(Evaluator(crowd.task, 1, 1), driver, 0)
    assert trace.movers.shape == (len(trace.pose), trace.movers.shape[1], 3)
    assert 8 <= trace.movers.shape[1] <= 12
    assert np.linalg.norm(np.diff(trace.movers[:, :, :2], axis=0), axis=2).max() > 0.01


class Nan:
    """Answers with NaN after two steps."""

    def __init__(self) -> None:
        self.left = 2

    def reset(self) -> None:
        self.left = 2

    def keep(self, robots) -> None:
        pass

    def act(self, scan, goal, velocity):
        self.left -= 1
        return np.full((1, 2), 0.1 if self.left >= 0 else np.nan)


def test_a_trace_ends_where_the_policy_fails() -> None:
    trace = trace_episode(Evaluator(SUITE.task, 1, 1), Nan(), 0)
    assert (trace.about["outcome"], len(trace.command)) == ("failure", 2)
    assert trace.about["reason"] == "answered with NaN or infinity"


def test_a_trace_that_is_none_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "trace.npz"
    file.write_bytes(b"PK")
    with pytest.raises(InputError, match="is not a readable trace"):
        load_trace(file)
    np.savez(file, about=np.array('{"format": 9}'))
    with pytest.raises(InputError, match="another version"):
        load_trace(file)


def test_the_worst_come_first_after_the_first(make_results) -> None:
    results = make_results("sstcfs", steps=np.array([90, 200, 500, 30, 3, 100]))
    episode = np.arange(10, 16)
    assert notable(results, episode, 4).tolist() == [10, 14, 13, 12]
    # Of the successes the one that took longest for its way.
    assert notable(results, episode, 9).tolist() == [10, 14, 13, 12, 11, 15]


def test_a_policy_that_cannot_be_had_ends_the_job(tmp_path: Path) -> None:
    missing = Entry("ours", "policy", str(tmp_path / "none.onnx"), "")
    with pytest.raises(InputError, match="ours on suite static"):
        Worker(ResultsFolder(tmp_path), {}).do(Job("episodes", SUITE, missing, count=1))
