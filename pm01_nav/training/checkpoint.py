# SPDX-License-Identifier: Apache-2.0
"""Save and load all that a run needs to go on as if it had never stopped.

A checkpoint holds tensors, numbers and strings only and is read with ``weights_only``, so that
loading one can never run code.
"""

from __future__ import annotations

import os
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch

from pm01_nav.errors import InputError
from pm01_nav.training.algorithm_config import Algorithm
from pm01_nav.training.environment import environment_state, restore_environment
from pm01_nav.training.remote_batch import Batch

FORMAT = 2


def save_checkpoint(
    path: Path, model: Any, algorithm: Algorithm, batch: Batch, extra: dict[str, Any]
) -> None:
    """Write all that a run needs to go on."""
    original = getattr(model, "_last_original_obs", None)
    _write(
        path,
        _weights(model)
        | {
            "learner": algorithm.state(model),
            "n_updates": model._n_updates,
            "last_obs": _of_parts(_to_tensor, model._last_obs),
            "last_original_obs": _of_parts(_to_tensor, original),
            "batch": {name: _to_tensor(array) for name, array in batch.state_dict().items()},
            "random": _random_state(),
            "extra": extra,
        },
    )


def save_weights(path: Path, model: Any) -> None:
    """Write what it takes to export the policy, and no more."""
    _write(path, _weights(model))


def _weights(model: Any) -> dict[str, Any]:
    return {
        "format": FORMAT,
        "policy": model.policy.state_dict(),
        "environment": environment_state(getattr(model, "env", None)),
        "num_timesteps": model.num_timesteps,
    }


def _write(path: Path, data: dict[str, Any]) -> None:
    """Write a checkpoint under a temporary name and rename it."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    torch.save(data, temporary)
    temporary.replace(path)


def load_checkpoint(path: Path) -> dict[str, Any]:
    """Read a checkpoint.

    Raises:
        InputError: it is missing, broken, or of another version.
    """
    if not path.is_file():
        raise InputError(f"{path}: no checkpoint there yet; start the run anew")
    try:
        data = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # torch raises many kinds for a broken file
        raise InputError(f"{path}: is not a readable checkpoint") from error
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise InputError(f"{path}: was written by another version")
    return data


def restore(
    data: dict[str, Any], path: Path, model: Any, algorithm: Algorithm, batch: Batch
) -> None:
    """Bring learner, environments and random numbers to where the checkpoint was taken.

    Raises:
        InputError: it belongs to another task, algorithm, network or number of robots.
    """
    try:
        model.policy.load_state_dict(data["policy"])
        algorithm.restore(model, data["learner"])
        restore_environment(getattr(model, "env", None), data["environment"])
        batch.load_state_dict({name: _to_array(t) for name, t in data["batch"].items()})
    except (RuntimeError, ValueError, KeyError) as error:
        reason = " ".join(str(error).split())[:160]
        raise InputError(f"{path}: does not belong to this task and network: {reason}") from error
    model.num_timesteps = data["num_timesteps"]
    model._n_updates = data["n_updates"]
    model._last_obs = _of_parts(_to_array, data["last_obs"])
    if data["last_original_obs"] is not None:
        model._last_original_obs = _of_parts(_to_array, data["last_original_obs"])
    _restore_random(data["random"])


def _random_state() -> dict[str, Any]:
    # SB3 draws from torch (actions) and from numpy's global generator (minibatches).
    name, keys, position, has_gauss, gauss = np.random.get_state(legacy=True)
    version, internal, gauss_next = random.getstate()
    return {
        "torch": torch.get_rng_state(),
        "numpy": [name, _signed(np.asarray(keys)), position, has_gauss, gauss],
        "python": [version, list(internal), gauss_next],
    }


def _restore_random(state: dict[str, Any]) -> None:
    torch.set_rng_state(state["torch"])
    name, keys, position, has_gauss, gauss = state["numpy"]
    np.random.set_state((name, keys.numpy().view(np.uint32), position, has_gauss, gauss))
    version, internal, gauss_next = state["python"]
    random.setstate((version, tuple(internal), gauss_next))


def _signed(keys: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(np.array(keys).view(np.int32))


def _of_parts(convert: Callable[[Any], Any], observation: Any) -> Any:
    """Convert an observation, or each part of one; None stays None."""
    if isinstance(observation, dict):
        return {name: convert(part) for name, part in observation.items()}
    return None if observation is None else convert(observation)


def _to_tensor(array: np.ndarray) -> torch.Tensor:
    # torch has few operations on unsigned 64-bit numbers; the bits are kept as they are.
    return torch.from_numpy(np.array(array.view(np.int64) if array.dtype == np.uint64 else array))


def _to_array(tensor: torch.Tensor) -> np.ndarray:
    return tensor.numpy()
