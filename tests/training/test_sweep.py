# SPDX-License-Identifier: Apache-2.0
"""Sweeps over seeds: files, report, going on, and a failed seed."""

from __future__ import annotations

import json

import pytest
from click.testing import CliRunner

from pm01_nav.benchmark.policies import trained_task
from pm01_nav.cli import pm01
from pm01_nav.cli.options import task_from_options
from pm01_nav.config import to_yaml
from pm01_nav.errors import InputError
from pm01_nav.executors import INTERRUPTED, Done
from pm01_nav.task.tasks import task_config
from pm01_nav.training import sweep as sweep_module
from pm01_nav.training.run_folder import RunFolder
from pm01_nav.training.sweep import (
    EVALUATIONS,
    KEPT,
    MEASURED,
    SeedJob,
    Sweep,
    run_seed,
    suite_task,
)
from tests.training.test_training import config

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
                # No episode has ended in the first iteration; null in the file.
                "success_rate": [None, rates[1]],
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


def job(suites=(), episodes=10):
    return SeedJob(to_yaml(config().model_dump(mode="json")), 0, suites, episodes, 1, 1)


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
    assert set(report["training_curve"]["seconds"]) == {11.0}
    assert report["training_curve"]["iqm"][-1] == pytest.approx((0.96 + 0.9 + 1.0) / 3)
    assert report["git_revision"] is not None


def test_report_is_drawn(tmp_path):
    pytest.importorskip("matplotlib")
    from pm01_nav.rendering.sweep_plot import plot_sweep

    sweep = Sweep(tmp_path / "x", config(), range(3))
    sweep.run(Pretended(), job(), lambda seed, error: None)
    report = sweep.report()
    plot_sweep(report, tmp_path / "x.png")
    assert (tmp_path / "x.png").read_bytes().startswith(b"\x89PNG")
    # No episode of a run of seconds may have ended.
    nothing = {"seconds": [], "iqm": [], "ci95": []}
    plot_sweep(report | {"training_curve": nothing}, tmp_path / "y.png")
    assert (tmp_path / "y.png").read_bytes().startswith(b"\x89PNG")


def test_folder_of_another_sweep_is_left_alone(tmp_path):
    Sweep(tmp_path / "x", config(), range(1)).missing(job())
    with pytest.raises(InputError, match="other settings"):
        Sweep(tmp_path / "x", config(7), range(1)).missing(job())
    (tmp_path / "y").mkdir()
    (tmp_path / "y" / "thesis.tex").write_text("years of work")
    with pytest.raises(InputError, match="no sweep"):
        Sweep(tmp_path / "y", config(), range(1)).missing(job())


def test_interrupted_training_is_no_result(monkeypatch):
    def interrupted(arguments, environment):
        assert arguments[0] == "train"  # there is nothing to evaluate
        return f"{INTERRUPTED}: 512 steps in 3 s\nwrote policy.onnx\n"

    monkeypatch.setattr("pm01_nav.training.sweep.run_pm01", interrupted)
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


def on_task(name, **changes):
    """Return the configuration of a run on a task."""
    task = task_config(name).model_copy(update=changes)
    return config().model_copy(update={"task": task})


@pytest.mark.parametrize(
    ("suite", "message"),
    [
        ("statik", "task = 'statik': unknown"),
        ("barn", "its worlds are files; write barn=PATH"),
        ("barn=nowhere", "nowhere"),
        ("static=here", "the worlds of static are generated"),
    ],
)
def test_suite_that_cannot_be_had_is_refused_before_training(suite, message, tmp_path, monkeypatch):
    monkeypatch.setattr(Sweep, "run", lambda *_: pytest.fail("it trained"))
    out = tmp_path / "x"
    arguments = ["sweep", "--task", "empty", "--steps", "512", "--suite", suite, "--out", str(out)]
    error = CliRunner().invoke(pm01, arguments).exception
    assert isinstance(error, InputError)
    assert message in str(error)
    assert not out.exists()


def test_suite_of_another_rate_is_refused():
    with pytest.raises(InputError, match=r"suite = 'empty': acts every 0\.1 s, .* every 0\.2 s"):
        suite_task("empty", on_task("static", control_dt=0.2))


@pytest.mark.parametrize(
    ("trained", "suite"),
    [
        (on_task("static", robot="jackal"), "empty"),
        # The suite's own Jackal reverses at 0.5 m/s, the described one at 2 m/s.
        (on_task("static", robot="jackal"), "barn_like"),
        (on_task("barn_like"), "static"),
        (on_task("article"), "static"),
        (on_task("static", robot_changes={"limits": {"linear_max": 0.3}}), "static"),
    ],
)
def test_suite_is_driven_by_the_robot_of_the_training(trained, suite, tmp_path, monkeypatch):
    """What `pm01 evaluate` makes of the options has the robot that the policy fits."""
    robots = []

    def pretended(arguments, environment):
        if arguments[0] == "train":
            folder = RunFolder(arguments[-1])
            folder.create(trained)
            for name in KEPT[1:]:
                (folder.path / name).touch()
            return ""
        options = dict(zip(arguments[2::2], arguments[3::2], strict=True))
        task = task_from_options(
            trained_task(arguments[1]),
            task=options["--task"],
            config_file=options["--config"],
            changes=(),
        )
        assert task.name == suite
        robots.append(task.robot_spec())
        return "{}"

    monkeypatch.setattr(sweep_module, "run_pm01", pretended)
    run_seed(SeedJob(to_yaml(trained.model_dump(mode="json")), 0, (suite,), 10, 1, 0))
    assert robots == [trained.task.robot_spec()]


def test_other_suites_or_episodes_are_not_mixed(tmp_path):
    """Seed 0 was measured on two suites; the others would be on something else."""
    sweep = Sweep(tmp_path / "x", config(), range(1))
    sweep.run(Pretended(), job(("static", "empty")), lambda seed, error: None)
    more = Sweep(tmp_path / "x", config(), range(3))
    # The order does not matter.
    assert more.missing(job(("empty", "static"))) == [1, 2]
    for other in (job(), job(("static",)), job(("static", "empty"), episodes=20)):
        with pytest.raises(InputError, match="--suite empty --suite static --episodes 10"):
            more.missing(other)


def test_before_a_seed_is_done_another_measurement_may_be_chosen(tmp_path):
    sweep = Sweep(tmp_path / "x", config(), range(1))
    sweep.run(Pretended(failing=(0,)), job(), lambda seed, error: None)
    assert sweep.missing(job(("static",))) == [0]


def test_older_sweep_tells_by_its_figures_how_it_was_measured(tmp_path):
    sweep = Sweep(tmp_path / "x", config(), range(2))
    sweep.missing(job())
    (sweep.folder / MEASURED).unlink()
    (sweep.folder / "seed_0").mkdir()
    figures = {"training task": {"episodes": 10, "seed": 1}}
    (sweep.folder / "seed_0" / EVALUATIONS).write_text(json.dumps(figures))
    with pytest.raises(InputError, match="--episodes 10"):
        sweep.missing(job(episodes=20))
    assert sweep.missing(job()) == [1]


@pytest.mark.parametrize("name", ["file", "file/below"])
def test_file_in_the_way_is_said(name, tmp_path):
    (tmp_path / "file").write_text("years of work")
    with pytest.raises(InputError, match=rf"out = .*{name}: (exists and is not a|cannot be made)"):
        Sweep(tmp_path / name, config(), range(1)).missing(job())


STEPS = ("--steps", "512")
BOTH = (*STEPS, "--time-budget", "60")
TWO_THREADS = ("--set", "train.threads=2")


@pytest.mark.parametrize(
    ("options", "threads"),
    [
        (STEPS, 1),
        ((*STEPS, "--jobs", "2"), 1),
        (("--time-budget", "60"), 0),
        (BOTH, 0),
        ((*BOTH, "--jobs", "2"), 1),
        # The configuration says it: nothing goes over it.
        ((*STEPS, *TWO_THREADS), 0),
        ((*STEPS, *TWO_THREADS, "--jobs", "2"), 2),
    ],
)
def test_sweep_over_steps_gives_each_seed_one_thread(options, threads, tmp_path, monkeypatch):
    jobs = []

    def run(self, executor, job, told):
        jobs.append(job)
        raise InputError("enough")

    monkeypatch.setattr(Sweep, "run", run)
    arguments = ["sweep", "--task", "static", *options, "--out", str(tmp_path / "x")]
    assert str(CliRunner().invoke(pm01, arguments).exception) == "enough"
    assert [job.threads for job in jobs] == [threads]
