# SPDX-License-Identifier: Apache-2.0
"""Searches: what is proposed, that they go on, and what comes of them."""

from __future__ import annotations

import pytest
from click.testing import CliRunner

optuna = pytest.importorskip("optuna")

from pm01_nav.cli import pm01  # noqa: E402
from pm01_nav.cli.tune import _employ  # noqa: E402
from pm01_nav.documents import load_yaml  # noqa: E402
from pm01_nav.errors import InputError  # noqa: E402
from pm01_nav.executors import LocalProcesses  # noqa: E402
from pm01_nav.training import tuning  # noqa: E402
from pm01_nav.training.algorithms import ALGORITHMS  # noqa: E402
from pm01_nav.training.config import RunConfig  # noqa: E402
from pm01_nav.training.supervision import TrainResult  # noqa: E402
from pm01_nav.training.tuning import (  # noqa: E402
    STARTUP_TRIALS,
    Range,
    TrialProgress,
    Tuning,
    default_space,
    load_space,
)
from tests.training.test_training import config  # noqa: E402


def write(path, text):
    path.write_text(text)
    return load_space(path, "ppo")


def test_study_goes_on_and_reports_its_best(tmp_path):
    # One batch size cannot divide the rollout of 512 steps: such a trial is cut, not the search.
    space = write(
        tmp_path / "space.yaml",
        "learning_rate: {low: 1.0e-4, high: 1.0e-2, log: true}\n"
        "batch_size: {choices: [256, 300]}\nnet_arch: {choices: [[8], [8, 8]]}\n",
    )
    first = Tuning(tmp_path / "study", config(1), space)
    first.work(2)
    again = Tuning(tmp_path / "study", config(1), space)
    again.work(5)
    again.work(5)  # is done already
    trials = again.study().get_trials()
    assert len(trials) == 5
    complete = [t for t in trials if t.state.name == "COMPLETE"]
    for trial in complete:
        assert 1e-4 <= trial.params["learning_rate"] <= 1e-2
        assert trial.params["batch_size"] == "256"
    assert all("impossible" in t.user_attrs for t in trials if t.state.name == "PRUNED")
    if complete:
        report = again.write_report()
        assert report["best"]["success_rate"] == max(t.value for t in complete)
        best = load_yaml(tmp_path / "study" / "best.yaml")["train"]
        assert best["algo"] == "ppo"
        assert best["ppo"]["net_arch"] in ([8], [8, 8])


@pytest.mark.parametrize("algo", ALGORITHMS)
def test_default_spaces_name_hyper_parameters(algo):
    assert set(default_space(algo)) <= set(ALGORITHMS[algo].model_fields)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("gamma: 0.9\n", "mapping"),
        ("gamma: {low: 0.9}\n", "low and high, or choices"),
        ("gamma: {low: 0.9, high: 1.0, choices: [1]}\n", "low and high, or choices"),
        ("gamma: {lowest: 0.9}\n", "unknown key"),
        ("gamma: {low: 0.99, high: 0.9}\n", r"gamma.*low = 0\.99 must not exceed high = 0\.9"),
        ("ent_coef: {low: 0.0, high: 0.1, log: true}\n", "ent_coef.*low = 0 must be positive"),
        ("n_epochs: {low: 1.5, high: 8, integer: true}\n", "n_epochs.*whole numbers"),
        ("gamma: {choices: []}\n", "gamma.*choices: give one or more"),
        ("learning_rat: {low: 0.1, high: 1.0}\n", "learning_rat: ppo has no.*learning_rate"),
        ("buffer_size: {choices: [1000]}\n", "buffer_size: ppo has no.*allowed here: .*n_steps"),
    ],
)
def test_impossible_space_is_refused(tmp_path, text, message):
    with pytest.raises(InputError, match=message):
        write(tmp_path / "space.yaml", text)


def test_file_in_place_of_the_folder_is_refused(tmp_path):
    (tmp_path / "notes").write_text("years of work")
    with pytest.raises(InputError, match=r"out = .*notes: exists and is not a folder"):
        Tuning(tmp_path / "notes", config(1), {}).study()
    with pytest.raises(InputError, match=r"out = .*notes/x: cannot be made"):
        Tuning(tmp_path / "notes" / "x", config(1), {}).study()


def pretended(monkeypatch, *rates, interrupted=False):
    """Replace training by evaluations with these success rates."""

    def train(config, folder, progress, *, started_at, force):
        for k, rate in enumerate(rates, start=1):
            progress.iteration(k / len(rates), {}, 1000.0)
            progress.evaluated(1000 * k, {"success_rate": rate})
        return TrainResult(1000 * len(rates), 1.0, interrupted, max(rates), 1000)

    monkeypatch.setattr("pm01_nav.training.tuning.train", train)


def fixed_trials(folder, values, evaluations):
    """Let so many trials finish with these success rates at each evaluation."""
    study = Tuning(folder, config(1), {}).study()
    for value in values:
        trial = study.ask()
        for k in range(evaluations):
            trial.report(value, k + 1)
        study.tell(trial, value)


def test_trial_behind_the_median_is_cut_whatever_its_rollouts(tmp_path):
    fixed_trials(tmp_path, [0.8] * STARTUP_TRIALS, 3)
    trial = Tuning(tmp_path, config(1), {}).study().ask()
    watch = TrialProgress(trial)
    watch.iteration(0.2, {}, 1.0)
    watch.evaluated(777, {"success_rate": 0.9})
    watch.iteration(0.4, {}, 1.0)
    watch.evaluated(1554, {"success_rate": 0.1})
    watch.iteration(0.6, {}, 1.0)  # its best is 0.9
    other = TrialProgress(Tuning(tmp_path, config(1), {}).study().ask())
    other.evaluated(512, {"success_rate": 0.1})
    other.iteration(1.0, {}, 1.0)  # the budget is spent: only the final evaluation is left
    with pytest.raises(optuna.TrialPruned):
        other.iteration(0.4, {}, 1.0)


def test_finished_trial_counts_however_bad_it_is(tmp_path, monkeypatch):
    fixed_trials(tmp_path, [0.8] * STARTUP_TRIALS, 1)
    pretended(monkeypatch, 0.1)
    Tuning(tmp_path, config(1), {}).work(STARTUP_TRIALS + 1)
    assert states(tmp_path) == ["COMPLETE"] * (STARTUP_TRIALS + 1)


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        (["--steps", "500000"], 50_000),
        (["--time-budget", "60"], 250_000),
        (["--steps", "500000", "--set", "train.eval_every=7000"], 7_000),
    ],
)
def test_search_evaluates_often_enough_to_cut_trials(tmp_path, monkeypatch, given, expected):
    seen = []
    monkeypatch.setattr(Tuning, "work", lambda self, _: seen.append(self.config.train.eval_every))
    out = ["--out", str(tmp_path / "x")]
    CliRunner().invoke(pm01, ["tune", "--task", "static", *given, *out])
    assert seen == [expected]


@pytest.mark.parametrize("kind", [InputError, ValueError, AssertionError])
def test_trial_that_fails_is_one_of_many(tmp_path, monkeypatch, kind):
    pretended(monkeypatch, 0.5)
    succeed, tried = tuning.train, []

    def train(config, folder, progress, **options):
        tried.append(folder)
        if len(tried) < 3:
            raise kind("no such luck")
        return succeed(config, folder, progress, **options)

    monkeypatch.setattr(tuning, "train", train)
    search = Tuning(tmp_path, config(1), {})
    search.work(2)
    with pytest.raises(InputError, match="no trial came to its end; trial 1 failed: no such luck"):
        search.report()
    search.work(4)
    assert states(tmp_path) == ["PRUNED", "PRUNED", "COMPLETE", "COMPLETE"]
    reasons = [trial.user_attrs for trial in search.study().get_trials()]
    assert reasons == [{"failed": "no such luck"}, {"failed": "no such luck"}, {}, {}]
    assert search.report()["best"]["trial"] == 2


def test_search_whose_trials_are_all_impossible_says_why(tmp_path):
    space = write(tmp_path / "space.yaml", "batch_size: {choices: [300]}\n")
    search = Tuning(tmp_path / "x", config(1), space)
    search.work(2)
    with pytest.raises(InputError, match=r"no trial.*; trial 1 impossible: .*must divide.*512"):
        search.report()


def other_config(**changes):
    """Return the configuration of most tests with another task."""
    plain = config(1)
    return plain.model_copy(update={"task": plain.task.model_copy(update=changes)})


GAMMA = {"gamma": Range(choices=[0.9, 0.99])}


@pytest.mark.parametrize(
    ("other", "space", "named"),
    [
        (other_config(goal_radius=0.4), GAMMA, "task.goal_radius"),
        (other_config(map="elsewhere/b.yaml"), GAMMA, "task.map"),
        (config(1, algo="sac"), GAMMA, "train.algo"),
        (config(2), GAMMA, "train.steps"),
        (config(1, ppo={"n_envs": 32, "n_steps": 16, "batch_size": 512}), GAMMA, "train.ppo"),
        (config(1), {"gamma": Range(choices=[0.9])}, "space.gamma.choices"),
        (config(1), {}, "train.ppo.gamma, space.gamma"),
    ],
)
@pytest.mark.parametrize("database", [False, True])
def test_study_of_something_else_is_refused(tmp_path, other, space, named, database):
    url = f"sqlite:///{tmp_path}/x.db" if database else None
    Tuning(tmp_path, config(1), GAMMA, url).study()
    where = "storage = sqlite" if database else "out = "
    with pytest.raises(InputError, match=f"{where}.*other settings .*{named}"):
        Tuning(tmp_path, other, space, url).study()


def test_study_goes_on_with_what_does_not_matter(tmp_path):
    first = other_config(map="here/a.yaml")
    Tuning(tmp_path, first, GAMMA).study()
    train = first.train.model_copy(update={"seed": 7, "threads": 2, "track": "wandb"})
    task = first.task.model_copy(update={"map": "there/a.yaml"})
    Tuning(tmp_path, RunConfig(task=task, train=train), GAMMA).study()


def test_study_without_a_subject_gets_one(tmp_path):
    backend = optuna.storages.journal.JournalFileBackend(str(tmp_path / "study.journal"))
    storage = optuna.storages.JournalStorage(backend)
    optuna.create_study(storage=storage, study_name="pm01", direction="maximize")
    Tuning(tmp_path, config(1), GAMMA).study()
    with pytest.raises(InputError, match="other settings"):
        Tuning(tmp_path, config(2), GAMMA).study()


def first_rate(folder, worker=0):
    """Return the learning rate that a worker on the study in this folder draws first."""
    space = {"learning_rate": Range(low=1e-4, high=1e-2, log=True)}
    trial = Tuning(folder, config(1, seed=3), space, worker=worker).study().ask()
    return space["learning_rate"].suggest(trial, "learning_rate")


def test_seeded_search_is_repeated_and_its_workers_differ(tmp_path):
    one, again = first_rate(tmp_path / "one"), first_rate(tmp_path / "again")
    assert one == again
    assert first_rate(tmp_path / "two", worker=1) != one
    assert first_rate(tmp_path / "one") != one  # it goes on


def test_workers_are_numbered(monkeypatch):
    asked = []
    executor = LocalProcesses(1)
    monkeypatch.setattr("sys.argv", ["pm01", "tune", "--jobs", "2", "--out", "x"])
    monkeypatch.setattr("pm01_nav.cli.tune.run_pm01", asked.append)
    _employ(executor, 2)
    assert asked == [["tune", "--out", "x", "--worker", str(k)] for k in range(2)]


def states(folder):
    """Return how the trials of the study in this folder ended."""
    backend = optuna.storages.journal.JournalFileBackend(str(folder / "study.journal"))
    storage = optuna.storages.JournalStorage(backend)
    trials = optuna.load_study(study_name=None, storage=storage).get_trials()
    return [trial.state.name for trial in trials]


def test_interruption_ends_the_search_without_a_traceback(tmp_path, monkeypatch, caplog):
    pretended(monkeypatch, 0.5, interrupted=True)
    optuna.logging.enable_propagation()
    arguments = ["tune", "--task", "static", "--trials", "3", "--out", str(tmp_path / "x")]
    try:
        done = CliRunner().invoke(pm01, arguments)
    finally:
        optuna.logging.disable_propagation()
    assert done.exit_code == 1
    assert "the same command goes on" in done.stderr
    assert isinstance(done.exception, SystemExit)
    assert any("KeyboardInterrupt" in record.message for record in caplog.records)
    assert not any(record.exc_info for record in caplog.records)
    assert states(tmp_path / "x") == ["FAIL"]
    pretended(monkeypatch, 0.5)
    assert CliRunner().invoke(pm01, arguments).exit_code == 0
    assert states(tmp_path / "x") == ["FAIL", "COMPLETE", "COMPLETE", "COMPLETE"]


def test_unusable_storage_is_refused(tmp_path):
    search = Tuning(tmp_path / "x", config(1), {}, "nonsense://x")
    with pytest.raises(InputError, match="storage"):
        search.study()


def test_search_without_a_result_says_so(tmp_path):
    with pytest.raises(InputError, match="no trial"):
        Tuning(tmp_path / "x", config(1), {}).report()
