# SPDX-License-Identifier: Apache-2.0
"""A run that is killed, whenever that is, loses seconds: it goes on as if nothing had happened."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from importlib.util import find_spec

import pytest
import torch

from pm01_nav.errors import InputError
from pm01_nav.policy import OnnxPolicy
from pm01_nav.training import checkpoint, trainer
from pm01_nav.training.pace import Pace
from tests.training import test_algorithms, test_rsl_ppo, test_training
from tests.training.progress import Quiet
from tests.training.test_algorithms import same

RARELY = {"checkpoint_every": 1000.0, "eval_every": 10**9}
NEEDS_RSL_RL = pytest.mark.skipif(find_spec("rsl_rl") is None, reason="needs the extra `gpu`")
CASES = [
    ("ppo", lambda: test_training.config(4, **RARELY)),
    ("workers", lambda: test_training.config(4, workers=2, **RARELY)),
    pytest.param("rsl_rl", lambda: test_rsl_ppo.config(4, **RARELY), marks=NEEDS_RSL_RL),
    ("ppo_lstm", lambda: rarely(test_algorithms.config("ppo_lstm", "flat"))),
    ("sac", lambda: rarely(test_algorithms.config("sac", "flat"))),
]
KILLED_IN_SECOND_ITERATION = """
import os, pathlib, signal, sys
from tests.training import test_training
from tests.training.progress import Quiet
class Killed(Quiet):
    def iteration(self, *arguments):
        super().iteration(*arguments)
        if self.iterations == 2:
            os.kill(os.getpid(), signal.SIGKILL)
settings = test_training.config(4, checkpoint_every=1000.0, eval_every=10**9)
test_training.run(settings, pathlib.Path(sys.argv[1]), Killed())
"""


class KillError(BaseException):
    """Ends a run at once; nothing is written after it, as after a kill."""


class Killed(Quiet):
    """Ends the run in an iteration, or in an evaluation."""

    def __init__(self, iteration: int = 0, evaluation: int = 0):
        super().__init__()
        self.last = (iteration, evaluation)
        self.evaluations, self.said = 0, []

    def started(self, message):
        self.said.append(message)

    def iteration(self, *arguments):
        super().iteration(*arguments)
        if self.iterations == self.last[0]:
            raise KillError

    def evaluated(self, *arguments):
        self.evaluations += 1
        if self.evaluations == self.last[1]:
            raise KillError


def rarely(config):
    return config.model_copy(update={"train": config.train.model_copy(update=RARELY)})


def run(config, folder, progress=None, **options):
    return test_training.run(config, folder, progress, **options)


def steps_of(folder) -> int:
    return torch.load(folder / "last.pt", weights_only=True)["num_timesteps"]


def assert_same(one, other):
    mine, theirs = (torch.load(f / "last.pt", weights_only=True) for f in (one, other))
    for part in ("policy", "learner", "batch", "last_obs", "random", "num_timesteps"):
        assert same(mine[part], theirs[part]), part
    assert test_training.curve(one) == test_training.curve(other)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A run of four iterations that nothing happened to."""
    folder = tmp_path_factory.mktemp("runs") / "whole"
    run(test_training.config(4, **RARELY), folder)
    return folder


@pytest.mark.parametrize(("name", "make"), CASES)
def test_first_iteration_is_kept_whatever_learns(name, make, tmp_path):
    config = make()
    run(config, tmp_path / "whole")
    with pytest.raises(KillError):
        run(config, tmp_path / "x", Killed(iteration=2))
    # Four iterations in all; the checkpoint is of the first.
    assert 4 * steps_of(tmp_path / "x") == steps_of(tmp_path / "whole")
    run(config, tmp_path / "x", resume=True)
    assert_same(tmp_path / "x", tmp_path / "whole")


def test_sigkill_leaves_a_whole_checkpoint(whole, tmp_path):
    done = subprocess.run([sys.executable, "-c", KILLED_IN_SECOND_ITERATION, str(tmp_path / "x")])
    assert done.returncode == -signal.SIGKILL
    config = test_training.config(4, **RARELY)
    assert steps_of(tmp_path / "x") == test_training.SAMPLES
    run(config, tmp_path / "x", resume=True)
    assert_same(tmp_path / "x", whole)
    assert (tmp_path / "x" / "policy.onnx").is_file()


def test_killed_while_a_checkpoint_is_written_keeps_the_one_before(whole, tmp_path, monkeypatch):
    config = test_training.config(4, checkpoint_every=1e-6, eval_every=10**9)
    saved = []

    def save(data, path):
        saved.append(path)
        if len(saved) < 3:
            return torch_save(data, path)
        path.write_bytes(b"half of a checkpoint")
        raise KillError

    torch_save = torch.save
    monkeypatch.setattr(checkpoint.torch, "save", save)
    # Saving is not to be put off for taking its time.
    monkeypatch.setattr("pm01_nav.training.pace.SHARE", 1e9)
    with pytest.raises(KillError):
        run(config, tmp_path / "x")
    monkeypatch.undo()
    assert steps_of(tmp_path / "x") == 2 * test_training.SAMPLES
    assert [path.name for path in (tmp_path / "x").glob(".*.tmp")] == [saved[-1].name]
    run(config, tmp_path / "x", resume=True)
    assert list((tmp_path / "x").glob(".*.tmp")) == []
    assert_same(tmp_path / "x", whole)


def test_killed_before_the_first_checkpoint_begins_anew_and_says_so(whole, tmp_path):
    config = test_training.config(4, **RARELY)
    with pytest.raises(KillError):
        run(config, tmp_path / "x", Killed(iteration=1))
    assert not (tmp_path / "x" / "last.pt").exists()
    progress = Killed()
    run(config, tmp_path / "x", progress, resume=True)
    assert [text for text in progress.said if "begins anew" in text] == [
        f"{tmp_path / 'x'}: has no checkpoint yet; the same run begins anew"
    ]
    assert_same(tmp_path / "x", whole)
    record = json.loads((tmp_path / "x" / "run.json").read_text())
    assert len(record["sessions"]) == 2


def test_killed_in_an_evaluation_keeps_what_was_learned_before_it(tmp_path):
    config = test_training.config(4, checkpoint_every=1000.0)
    # Evaluated after two and four iterations, 512 steps each.
    with pytest.raises(KillError):
        run(config, tmp_path / "x", Killed(evaluation=1))
    assert steps_of(tmp_path / "x") == 2 * test_training.SAMPLES
    run(config, tmp_path / "x", resume=True)
    run(config, tmp_path / "whole")
    assert_same(tmp_path / "x", tmp_path / "whole")


def test_killed_before_its_policy_was_exported_is_finished_by_resuming(tmp_path, monkeypatch):
    config = test_training.config(2)

    def killed(*_):
        raise KillError

    monkeypatch.setattr(trainer, "export_best", killed)
    with pytest.raises(KillError):
        run(config, tmp_path / "x")
    assert steps_of(tmp_path / "x") == 2 * test_training.SAMPLES
    evaluations = test_training.curve(tmp_path / "x")["eval_success_rate"]
    monkeypatch.undo()
    result = run(config, tmp_path / "x", resume=True)
    assert result.steps == 2 * test_training.SAMPLES
    metadata = OnnxPolicy(tmp_path / "x" / "policy.onnx").metadata
    assert metadata["training_steps"] == 2 * test_training.SAMPLES
    # What was measured is not measured again.
    assert test_training.curve(tmp_path / "x")["eval_success_rate"] == evaluations
    with pytest.raises(InputError, match="is finished"):
        run(config, tmp_path / "x", resume=True)


def test_lists_of_earlier_versions_are_read(tmp_path):
    config = test_training.config(4, **RARELY)
    with pytest.raises(KillError):
        run(config, tmp_path / "x", Killed(iteration=3))
    file = tmp_path / "x" / "last.pt"
    data = torch.load(file, weights_only=True)
    history = data["extra"]["history"]
    data["extra"]["history"] = {
        "columns": {name: values.tolist() for name, values in history["columns"].items()},
        "recent": history["recent"].tolist(),
    }
    del data["extra"]["evaluated_at"]
    torch.save(data, file)
    run(config, tmp_path / "x", resume=True)
    assert test_training.curve(tmp_path / "x")["steps"] == [512, 1024, 1536, 2048]


def test_saving_is_due_every_so_often_and_less_often_where_it_is_slow(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(time, "perf_counter", lambda: now[0])
    pace = Pace(10.0)
    assert pace.due()
    with pace.spent():
        now[0] += 0.05
    # 0.05 s are less than a hundredth of 10 s.
    now[0] += 8.5
    assert not pace.due()
    # The next occasion is after an iteration of 2 s: later than 10 s from the last.
    assert pace.due(2.0)
    with pace.spent():
        now[0] += 0.3
    # 0.3 s are a hundredth of 30 s.
    now[0] += 29.0
    assert not pace.due()
    now[0] += 1.0
    assert pace.due()
