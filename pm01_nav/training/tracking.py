# SPDX-License-Identifier: Apache-2.0
"""Where a run's metrics go beside TensorBoard, and what is put down about the run itself."""

from __future__ import annotations

import json
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from stable_baselines3.common.logger import KVWriter, Logger, TensorBoardOutputFormat

from pm01_nav.config import write_atomically
from pm01_nav.documents import load_json
from pm01_nav.errors import InputError
from pm01_nav.provenance import provenance
from pm01_nav.task.given_files import stored_task
from pm01_nav.training.config import RunConfig
from pm01_nav.training.run_folder import RunFolder

PROJECT = "pm01-nav"
"""Name of the project on Weights & Biases."""


class WandbWriter(KVWriter):
    """Send what is logged to Weights & Biases, or write it for later (``WANDB_MODE=offline``)."""

    def __init__(self, config: RunConfig, folder: RunFolder) -> None:
        """Begin a run there, or go on with the one of this folder.

        Raises:
            InputError: it cannot begin.
        """
        import wandb
        from wandb.errors import Error

        shared = config.model_copy(update={"task": stored_task(config.task, folder.path)})
        try:
            self._run = wandb.init(
                project=PROJECT,
                name=folder.path.name,
                id=_identity(folder),
                resume="allow",
                dir=str(folder.path),
                config=shared.model_dump(mode="json"),
                # Nothing of who runs it where, nor of the machine beyond what run.json has.
                settings=wandb.Settings(
                    x_disable_meta=True,
                    x_disable_machine_info=True,
                    disable_git=True,
                    disable_code=True,
                    host="localhost",
                ),
            )
        except Error as error:
            reason = " ".join(str(error).split())[:200]
            raise InputError(
                f"track = 'wandb': {reason}; WANDB_MODE=offline writes to the run's folder"
            ) from error

    def write(
        self,
        key_values: dict[str, Any],
        key_excluded: dict[str, tuple[str, ...]],
        step: int = 0,
    ) -> None:
        """Send the numbers of one point of the log."""
        numbers = {n: v for n, v in key_values.items() if not isinstance(v, str)}
        self._run.log(numbers | {"steps": step})

    def close(self) -> None:
        """End the run there."""
        self._run.finish()


def _identity(folder: RunFolder) -> str:
    """Return the name by which a resumed run is known again."""
    record = load_json(folder.record)
    return str(record["identity"])


def check_tracking(config: RunConfig) -> None:
    """Make sure that what a run's settings ask for is installed.

    Raises:
        InputError: it cannot be imported.
    """
    try:
        # SB3 hides why it cannot: a protobuf of Gazebo's or ROS's that is older, for example.
        import torch.utils.tensorboard  # noqa: F401
    except ImportError as error:
        raise InputError(
            f"tensorboard cannot be imported: {error}; pip install 'pm01-nav[train]', and let "
            "nothing older come before it on PYTHONPATH"
        ) from error
    if config.train.track == "wandb":
        try:
            import wandb  # noqa: F401
        except ImportError as error:
            raise InputError("track = 'wandb': pip install 'pm01-nav[wandb]'") from error


def make_logger(config: RunConfig, folder: RunFolder) -> Logger:
    """Return what writes metrics where the run's settings say; see ``check_tracking``.

    Raises:
        InputError: Weights & Biases cannot begin.
    """
    with _host_unnamed():
        writers: list[KVWriter] = [TensorBoardOutputFormat(str(folder.tensorboard))]
    if config.train.track == "wandb":
        writers.append(WandbWriter(config, folder))
    return Logger(str(folder.tensorboard), writers)


@contextmanager
def _host_unnamed() -> Iterator[None]:
    """Keep the machine's name from tensorboard, which makes it a part of its file's name."""
    known, socket.gethostname = socket.gethostname, lambda: "localhost"
    try:
        yield
    finally:
        socket.gethostname = known


def record_session(config: RunConfig, folder: RunFolder) -> None:
    """Put down command, revision, versions and machine in run.json, for each time it is run."""
    session = provenance()
    name = f"{folder.path.resolve().name}-{session['created'][:19].replace(':', '')}"
    record: dict[str, Any] = {"identity": name, "sessions": []}
    if folder.record.is_file():
        record = load_json(folder.record)
    about = {"seed": config.train.seed, "algorithm": config.train.algo, "task": config.task.name}
    record |= about | {"sessions": [*record["sessions"], session]}
    write_atomically(folder.record, json.dumps(record, indent=2) + "\n")
