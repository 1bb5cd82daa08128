# SPDX-License-Identifier: Apache-2.0
"""Sweeps over seeds: files, report, going on, and a failed seed."""

from __future__ import annotations

import json

import pytest
from click.testing import CliRunner

from pm01_nav.cli import pm01
from pm01_nav.config import to_yaml
from pm01_nav.errors import InputError
from pm01_nav.executors import INTERRUPTED, Done
from pm01_nav.train.sweep import EVALUATIONS, SeedJob, Sweep, run_seed
from tests.train.test_training import config

RATES = {0: [0.5, 0.96], 1: [0.7, 0.9], 2: [0.6, 1.0]}


class Pretended:
    """An executor whose runs are made up; seed 1 fails at first."""

    def __init__(self, failing=()):
        self.failing, self.asked = failing, []

    def run(self, function, arguments):
        for index, job in enumerate(arguments):
            self.asked.append(job.seed)
            if job.seed in self.failing:
                yield Done(index, error="lost")
                continue
            rates = RATES[job.seed]
            history = {
                "steps": [1000.0, 2000.0],
                "seconds": [5.0, 11.0],
                "eval_seconds": [5.0, 10.0],
                "eval_success_rate": rates,
            }
            names = ("collision_rate", "timeout_rate", "spl")
            measured = {"success_rate": rates[-1]} | dict.fromkeys(names, 0.0)
            yield Done(
                index,
                {
                    "history.json": json.dumps(history).encode(),
                    EVALUATIONS: json.dumps({"static": measured}).encode(),
                },
            )


def job():
    return SeedJob(to_yaml(config().model_dump(mode="json")), 0, (), 10, 1, 1)


def test_report_of_all_seeds_and_going_on_after_a_failure(tmp_path):
    sweep = Sweep(tmp_path / "x", config(), range(3))
    heard = []
    first = Pretended(failing=(1,))
    failed = sweep.run(first, job(), lambda seed, error: heard.append((seed, error)))
    assert failed == {1: "lost"}
    assert heard == [(0, None), (1, "lost"), (2, None)]
    assert sweep.report()["seeds_missing"] == [1]
    second = Pretended()
    assert sweep.run(second, job(), lambda seed, error: None) == {}
    assert second.asked == [1]
    report = sweep.report()
    assert [run["seed"] for run in report["runs"]] == [0, 1, 2]
    # Of three, a quarter is less than one: nothing is left out.
    assert report["success_rate"]["static"]["iqm"] == pytest.approx((0.96 + 0.9 + 1.0) / 3)
    times = [run["seconds_to_95%"] for run in report["runs"]]
    assert times == [10.0, None, 10.0]
    assert report["runs"][2]["seconds_to_99%"] == 10.0
    assert report["curve"]["seconds"][0] == 5.0
    assert report["curve"]["iqm"][0] == pytest.approx((0.5 + 0.7 + 0.6) / 3)
    assert report["git_revision"] is not None


def test_report_is_drawn(tmp_path):
    pytest.importorskip("matplotlib")
    from pm01_nav.rendering.sweep_plot import plot_sweep

    sweep = Sweep(tmp_path / "x", config(), range(3))
    sweep.run(Pretended(), job(), lambda seed, error: None)
    plot_sweep(sweep.report(), tmp_path / "x.png")
    assert (tmp_path / "x.png").read_bytes().startswith(b"\x89PNG")


def test_folder_of_another_sweep_is_left_alone(tmp_path):
    Sweep(tmp_path / "x", config(), range(1)).missing()
    with pytest.raises(InputError, match="other settings"):
        Sweep(tmp_path / "x", config(7), range(1)).missing()
    (tmp_path / "y").mkdir()
    (tmp_path / "y" / "thesis.tex").write_text("years of work")
    with pytest.raises(InputError, match="no sweep"):
        Sweep(tmp_path / "y", config(), range(1)).missing()


def test_interrupted_training_is_no_result(monkeypatch):
    def interrupted(arguments, environment):
        assert arguments[0] == "train"  # there is nothing to evaluate
        return f"{INTERRUPTED}: 512 steps in 3 s\nwrote policy.onnx\n"

    monkeypatch.setattr("pm01_nav.train.sweep.run_pm01", interrupted)
    with pytest.raises(RuntimeError, match="interrupted: 512 steps"):
        run_seed(job())


def test_interrupted_sweep_says_how_to_go_on(tmp_path, monkeypatch):
    def interrupted(self, executor, job, told):
        raise KeyboardInterrupt

    monkeypatch.setattr(Sweep, "run", interrupted)
    arguments = ["sweep", "--task", "static", "--out", str(tmp_path / "x")]
    done = CliRunner().invoke(pm01, arguments)
    assert done.exit_code == 1
    assert "the same command goes on" in done.stderr
    assert isinstance(done.exception, SystemExit)  # no traceback


def test_nothing_done_is_said(tmp_path):
    with pytest.raises(InputError, match="no seed is done"):
        Sweep(tmp_path / "x", config(), range(1)).report()
