# SPDX-License-Identifier: Apache-2.0
"""What a run puts down about itself, and Weights & Biases without a network."""

from __future__ import annotations

import json
import sys

import pytest

from pm01_nav.errors import InputError
from tests.training.progress import Quiet
from tests.training.test_training import config, run


def test_every_session_of_a_run_is_put_down(tmp_path):
    run(config(), tmp_path / "x", Quiet(interrupt_after=2))
    first = json.loads((tmp_path / "x" / "run.json").read_text())
    run(config(), tmp_path / "x", resume=True)
    record = json.loads((tmp_path / "x" / "run.json").read_text())
    assert record["identity"] == first["identity"]
    assert record["identity"].startswith("x-")
    assert (record["seed"], record["algorithm"], record["task"]) == (0, "ppo", "static")
    assert len(record["sessions"]) == 2
    assert record["sessions"][0] == first["sessions"][0]
    for session in record["sessions"]:
        assert {"command", "git_revision", "versions", "machine"} <= set(session)


def test_wandb_offline_writes_to_the_folder_of_the_run(tmp_path, monkeypatch):
    pytest.importorskip("wandb")
    monkeypatch.setenv("WANDB_MODE", "offline")
    monkeypatch.setenv("WANDB_SILENT", "true")
    run(config(2, track="wandb"), tmp_path / "x")
    written = list((tmp_path / "x" / "wandb").glob("offline-run-*/*.wandb"))
    assert len(written) == 1
    content = written[0].read_bytes()
    assert b"train_episodes/success_rate" in content
    assert b"eval/success_rate" in content


def test_missing_wandb_is_said_with_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "wandb", None)
    with pytest.raises(InputError, match=r"pm01-nav\[wandb\]"):
        run(config(2, track="wandb"), tmp_path / "x")


def test_a_tensorboard_that_cannot_be_imported_says_why(tmp_path, monkeypatch):
    # As an old protobuf before it on the path does.
    monkeypatch.setitem(sys.modules, "torch.utils.tensorboard", None)
    with pytest.raises(InputError, match=r"tensorboard cannot be imported: .*PYTHONPATH"):
        run(config(), tmp_path / "x")
