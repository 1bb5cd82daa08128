# SPDX-License-Identifier: Apache-2.0
"""The folder of a run: where each file lies, and how it is made, found and checked."""

from __future__ import annotations

import shutil
from pathlib import Path

from pm01_nav.config import to_yaml, validate, write_atomically
from pm01_nav.documents import load_yaml
from pm01_nav.errors import InputError
from pm01_nav.task.given_files import copy_given, located, stored_task
from pm01_nav.training.config import RunConfig


class RunFolder:
    """Paths inside a run's folder."""

    def __init__(self, path: str | Path) -> None:
        """Name the files below ``path``; nothing is read or written."""
        self.path = Path(path)
        self.config = self.path / "config.yaml"
        self.last = self.path / "last.pt"
        self.best = self.path / "best.pt"
        self.policy = self.path / "policy.onnx"
        self.history = self.path / "history.json"
        self.record = self.path / "run.json"
        self.metrics = self.path / "metrics.json"
        self.plot = self.path / "training.png"
        self.tensorboard = self.path / "tensorboard"

    def check_free(self, *, force: bool = False) -> None:
        """Make sure that a new run may be written here; ``force`` allows a former run to go.

        Raises:
            InputError: something else is in the way.
        """
        if not self.path.exists():
            return
        if not self.path.is_dir():
            raise InputError(f"out = {self.path}: exists and is not a folder")
        if any(self.path.iterdir()):
            if not force:
                raise InputError(f"out = {self.path}: exists and is not empty; --force replaces it")
            if not self.config.exists():
                raise InputError(
                    f"out = {self.path}: is not empty and no run; --force leaves it alone"
                )

    def create(self, config: RunConfig, *, force: bool = False) -> None:
        """Make the folder, without what a former run left, and store the configuration in it.

        Raises:
            InputError: something else is in the way, or the folder cannot be made.
        """
        self.check_free(force=force)
        try:
            if self.path.exists():
                shutil.rmtree(self.path)
            self.path.mkdir(parents=True)
        except OSError as error:
            raise InputError(f"out = {self.path}: cannot be made: {error.strerror}") from error
        self.store(config)

    def reopen(self, config: RunConfig) -> None:
        """Store the configuration of a run that goes on, without what a kill left of it.

        Raises:
            InputError: the robot or the map cannot be copied.
        """
        for half_written in self.path.glob(".*.tmp"):
            half_written.unlink()
        if not self.last.exists():
            # Of an attempt from which nothing else is left.
            self.best.unlink(missing_ok=True)
        self.store(config)

    def is_exported(self) -> bool:
        """Tell whether the policy was exported since the last checkpoint."""
        policy = self.policy.stat().st_mtime_ns if self.policy.is_file() else -1
        return policy >= self.last.stat().st_mtime_ns

    def store(self, config: RunConfig) -> None:
        """Write the effective configuration.

        Raises:
            InputError: the robot or the map cannot be copied.
        """
        shown = config.model_copy(update={"task": stored_task(config.task, self.path)})
        write_atomically(self.config, to_yaml(shown.model_dump(mode="json")))
        copy_given(config.task, self.path)

    def load_config(self) -> RunConfig:
        """Read the stored configuration.

        Raises:
            InputError: the folder is no run, or its configuration is unusable.
        """
        if not self.config.is_file():
            raise InputError(f"{self.path}: is no run folder (it has no config.yaml)")
        data = load_yaml(self.config)
        if isinstance(data.get("task"), dict):
            data["task"] = located(data["task"], self.path)
        return validate(RunConfig, data, str(self.config))
