# SPDX-License-Identifier: Apache-2.0
"""Training: the budget, the files of a run, and resuming as if never stopped."""

from __future__ import annotations

import json
import os
import sys
import time

import pytest
import torch

from pm01_nav.errors import InputError
from pm01_nav.task.tasks import task_config
from pm01_nav.training.config import RunConfig, TrainConfig
from pm01_nav.training.run_folder import RunFolder
from pm01_nav.training.trainer import export_best, train
from tests.training.progress import Quiet

SAMPLES = 32 * 16  # one iteration


def config(iterations: int = 6, **changes) -> RunConfig:
    task = task_config("static").model_copy(update={"num_worlds": 4})
    settings = {
        "steps": iterations * SAMPLES,
        "eval_every": 2 * SAMPLES,
        "eval_episodes": 4,
        "threads": 1,
        "ppo": {"n_envs": 32, "n_steps": 16, "batch_size": 256, "n_epochs": 2},
    }
    return RunConfig(task=task, train=TrainConfig.model_validate(settings | changes))


def run(config, folder, progress=None, **options):
    started = time.perf_counter()
    return train(config, RunFolder(folder), progress or Quiet(), started_at=started, **options)


def parameters(folder):
    return torch.load(folder / "last.pt", weights_only=True)["policy"]


def curve(folder):
    history = json.loads((folder / "history.json").read_text())
    return {name: values for name, values in history.items() if "seconds" not in name}


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory):
    """A run of six iterations."""
    folder = tmp_path_factory.mktemp("runs") / "whole"
    return folder, run(config(), folder)


def test_run_ends_at_its_steps_and_leaves_its_files(uninterrupted):
    folder, result = uninterrupted
    assert result.steps == 6 * SAMPLES
    assert not result.interrupted
    names = {path.name for path in folder.iterdir()}
    assert {"config.yaml", "last.pt", "best.pt", "history.json", "policy.onnx"} <= names
    assert not [name for name in names if name.endswith(".tmp")]
    assert RunFolder(folder).load_config() == config()


def test_same_seed_gives_the_same_curve_and_another_seed_another(uninterrupted, tmp_path):
    folder, _ = uninterrupted
    run(config(), tmp_path / "again")
    assert curve(tmp_path / "again") == curve(folder)
    run(config(seed=1), tmp_path / "other")
    assert curve(tmp_path / "other")["return"] != curve(folder)["return"]


def test_interrupted_and_resumed_run_equals_the_uninterrupted_one(uninterrupted, tmp_path):
    folder, _ = uninterrupted
    stopped = run(config(), tmp_path / "x", Quiet(interrupt_after=3))
    assert stopped.interrupted
    assert stopped.steps == 3 * SAMPLES
    resumed = run(config(), tmp_path / "x", resume=True)
    assert resumed.steps == 6 * SAMPLES
    whole, parts = parameters(folder), parameters(tmp_path / "x")
    assert all(torch.equal(whole[name], parts[name]) for name in whole)
    assert curve(tmp_path / "x") == curve(folder)


def test_finished_run_says_so_and_goes_on_with_more_steps(uninterrupted, tmp_path):
    run(config(2), tmp_path / "x")
    with pytest.raises(InputError, match="is finished"):
        run(config(2), tmp_path / "x", resume=True)
    assert run(config(3), tmp_path / "x", resume=True).steps == 3 * SAMPLES


def test_time_budget_ends_a_run(tmp_path):
    result = run(config(steps=None, time_budget=1.0), tmp_path / "x")
    # The iteration under way when the second is over is finished, then evaluated and saved.
    assert 1.0 <= result.seconds < 20.0
    assert result.steps % SAMPLES == 0


def test_checkpoint_of_another_network_is_refused(uninterrupted, tmp_path):
    run(config(2), tmp_path / "x")
    other = {"n_envs": 32, "n_steps": 16, "batch_size": 256, "net_arch": [8]}
    before = (tmp_path / "x" / "config.yaml").read_bytes()
    with pytest.raises(InputError, match="does not belong"):
        run(config(4, ppo=other), tmp_path / "x", resume=True)
    assert (tmp_path / "x" / "config.yaml").read_bytes() == before


def test_export_says_when_checkpoint_and_configuration_differ(tmp_path):
    run(config(2), tmp_path / "x")
    folder = RunFolder(tmp_path / "x")
    other = {"n_envs": 32, "n_steps": 16, "batch_size": 256, "net_arch": [8]}
    with pytest.raises(InputError, match="does not belong"):
        export_best(folder, config(2, ppo=other))


def test_a_former_run_is_kept_if_the_new_one_cannot_begin(tmp_path, monkeypatch):
    run(config(2), tmp_path / "x")
    monkeypatch.setitem(sys.modules, "wandb", None)
    with pytest.raises(InputError, match="wandb"):
        run(config(3, track="wandb"), tmp_path / "x", force=True)
    assert RunFolder(tmp_path / "x").load_config() == config(2)


def test_a_short_run_begins_with_the_whole_learning_rate(tmp_path):
    # Start-up takes a part of the seconds, but none of the schedule.
    started = time.perf_counter() - 50.0
    settings = config(steps=None, time_budget=51.0, checkpoint_every=1000.0)
    train(settings, RunFolder(tmp_path / "x"), Quiet(), started_at=started)
    rates = logged(tmp_path / "x", "train/learning_rate")
    assert rates[0] == pytest.approx(settings.train.ppo.learning_rate, rel=0.2)


def logged(folder, name: str) -> list[float]:
    """Return the values of a metric in TensorBoard's files."""
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    events = EventAccumulator(str(folder / "tensorboard"))
    events.Reload()
    return [point.value for point in events.Scalars(name)]


@pytest.mark.parametrize("content", [b"", b"not a checkpoint"])
def test_broken_checkpoint_is_refused(tmp_path, content):
    folder = RunFolder(tmp_path / "x")
    folder.create(config())
    folder.last.write_bytes(content)
    with pytest.raises(InputError, match=r"last\.pt"):
        run(config(), tmp_path / "x", resume=True)


def test_checkpoint_that_would_run_code_is_refused(tmp_path):
    class Malicious:
        def __reduce__(self):
            return (os.mkdir, (str(tmp_path / "proof"),))

    folder = RunFolder(tmp_path / "x")
    folder.create(config())
    torch.save({"format": Malicious()}, folder.last)
    with pytest.raises(InputError, match="not a readable checkpoint"):
        run(config(), tmp_path / "x", resume=True)
    assert not (tmp_path / "proof").exists()


def test_existing_folder_is_kept_unless_forced(uninterrupted, tmp_path):
    run(config(2), tmp_path / "x")
    before = (tmp_path / "x" / "config.yaml").read_bytes()
    with pytest.raises(InputError, match="--force"):
        run(config(3), tmp_path / "x")
    assert (tmp_path / "x" / "config.yaml").read_bytes() == before
    assert run(config(3), tmp_path / "x", force=True).steps == 3 * SAMPLES


def test_force_never_removes_what_is_no_run(tmp_path):
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(InputError, match="no run"):
        run(config(2), tmp_path, force=True)
    assert (tmp_path / "thesis.tex").exists()


def test_unusable_worlds_leave_no_folder(tmp_path):
    broken = config().model_copy(update={"task": task_config("map")})
    with pytest.raises(InputError, match="--map"):
        run(broken, tmp_path / "x")
    assert not (tmp_path / "x").exists()


def test_batch_size_must_divide_the_rollout():
    with pytest.raises(ValueError, match=r"512.*300"):
        config(ppo={"n_envs": 32, "n_steps": 16, "batch_size": 300})


@pytest.mark.parametrize("algo", ["ppo", "ppo_lstm"])
def test_minibatches_of_one_sample_are_refused(algo):
    with pytest.raises(ValueError, match=f"{algo}.batch_size\n.*greater than or equal to 2"):
        TrainConfig.model_validate({"steps": 1, "algo": algo, algo: {"batch_size": 1}})


CURRICULA = {
    # The first stage is passed soon: its goals lie within a few steps.
    "staged": {
        "staged": {
            "stages": [{"goal_distance": [0.3, 0.4]}, {"goal_distance": [1.0, 2.0]}, {}],
            "threshold": 0.2,
            "window": 16,
        }
    },
    "automatic": {"automatic": {"top": 2, "rate": 0.3}},
}


@pytest.mark.parametrize("name", CURRICULA)
def test_curriculum_is_logged_repeated_and_resumed(name, tmp_path):
    settings = config(4, eval_every=100 * SAMPLES, curriculum=name, **CURRICULA[name])
    run(settings, tmp_path / "whole")
    whole = curve(tmp_path / "whole")
    logged = [key for key in whole if key.startswith("curriculum/")]
    assert "curriculum/effective_worlds" in logged
    assert all(len(whole[key]) == 4 for key in logged)
    if name == "staged":
        # The run is stopped below amid a later stage than the first.
        assert whole["curriculum/stage"][2] > 0.0
    assert run(settings, tmp_path / "x", Quiet(interrupt_after=3)).interrupted
    run(settings, tmp_path / "x", resume=True)
    assert curve(tmp_path / "x") == whole
    first, second = parameters(tmp_path / "whole"), parameters(tmp_path / "x")
    assert all(torch.equal(first[key], second[key]) for key in first)


def test_curriculum_leaves_the_evaluation_alone(uninterrupted, tmp_path):
    folder, _ = uninterrupted
    # One stage that is the task itself: the same training, with a curriculum's bookkeeping.
    run(config(curriculum="staged", staged={"stages": [{}]}), tmp_path / "x")
    ours, plain = curve(tmp_path / "x"), curve(folder)
    assert {key: ours[key] for key in plain} == plain
    assert "curriculum/stage" in ours
    assert not [key for key in plain if key.startswith("curriculum/")]


def test_resuming_with_another_curriculum_is_refused(uninterrupted, tmp_path):
    run(config(2), tmp_path / "x")
    with pytest.raises(InputError, match=r"train\.curriculum = 'automatic': .*another"):
        run(config(4, curriculum="automatic"), tmp_path / "x", resume=True)


@pytest.mark.parametrize(
    "changes",
    [
        {"curriculum": "magic"},
        {"staged": {"threshold": 1.1}},
        {"staged": {"window": 0}},
        {"staged": {"stages": []}},
        {"staged": {"stages": [{"goal_distance": [3.0, 1.0]}]}},
        {"staged": {"stages": [{"worlds": {"rooms": 0.0}}]}},
        {"staged": {"stages": [{"world": {"rooms": 1.0}}]}},
        {"automatic": {"share": -0.1}},
        {"automatic": {"rate": 0.0}},
        {"automatic": {"top": 0}},
    ],
)
def test_impossible_curriculum_is_refused(changes):
    key = next(iter(changes))
    with pytest.raises(ValueError, match=key):
        config(**changes)


def test_stage_of_unknown_worlds_leaves_no_folder(tmp_path):
    stages = {"stages": [{"worlds": {"rooms": 1.0}}]}
    with pytest.raises(InputError, match=r"train\.staged\.stages\.0\.worlds\.rooms: .*static"):
        run(config(curriculum="staged", staged=stages), tmp_path / "x")
    assert not (tmp_path / "x").exists()
