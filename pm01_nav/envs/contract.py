# SPDX-License-Identifier: Apache-2.0
"""What people hand to environments, checked: actions, seeds, modes and masks."""

from __future__ import annotations

import operator
from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from pm01_nav.arrays import NUMPY, Arrays
from pm01_nav.errors import InputError

Seeds = list[int | None]
MAX_SEED = 1 << 64
"""Seeds are taken modulo this."""


def checked_actions(actions: Any, shape: tuple[int, ...], arrays: Arrays = NUMPY) -> Any:
    """Return actions as a float64 array of the shape that they must have; lists will do.

    Raises:
        InputError: they have another shape, or are no numbers.
    """
    xp = arrays.xp
    try:
        given = actions if hasattr(actions, "shape") else np.asarray(actions, dtype=np.float64)
        array = xp.asarray(given, dtype=xp.float64, device=arrays.place)
    except (TypeError, ValueError) as error:
        raise InputError(f"actions: not an array of numbers; needs shape {shape}") from error
    if tuple(array.shape) != shape:
        raise InputError(f"actions: shape {tuple(array.shape)}, needs {shape}")
    return array


def one_each(seed: int | Sequence[int | None] | None, num_envs: int) -> Seeds:
    """Return a seed for each environment: s, s + 1, ... of an int; None goes on with what was.

    Raises:
        InputError: a list has another length, or a seed is no whole number from 0 on.
    """
    if seed is None:
        return [None] * num_envs
    if isinstance(seed, list | tuple | np.ndarray):
        if len(seed) != num_envs:
            raise InputError(f"seed: a list of {len(seed)}, needs one for each of {num_envs}")
        return [None if s is None else _whole(s) for s in seed]
    first = _whole(seed)
    return [first + i for i in range(num_envs)]


def _whole(seed: Any) -> int:
    try:
        number = operator.index(seed)
    except TypeError:
        number = -1
    if number < 0:
        raise InputError(f"seed = {seed!r}: must be a whole number of at least 0")
    return number


def stream_numbers(seeds: Sequence[int]) -> NDArray[np.uint64]:
    """Return seeds as the simulator takes them."""
    return np.array([seed % MAX_SEED for seed in seeds], dtype=np.uint64)


def autoreset_mode_of(mode: str | AutoresetMode) -> AutoresetMode:
    """Return a mode by its name or value.

    Raises:
        InputError: there is none of that name.
    """
    known = {m.value: m for m in AutoresetMode} | {m.name: m for m in AutoresetMode}
    if isinstance(mode, AutoresetMode):
        return mode
    if mode not in known:
        allowed = ", ".join(m.value for m in AutoresetMode)
        raise InputError(f"autoreset_mode = {mode!r}: allowed: {allowed}")
    return known[mode]


def checked_mask(
    options: dict[str, Any] | None, num_envs: int, arrays: Arrays = NUMPY
) -> NDArray[np.bool_] | None:
    """Return ``reset_mask`` of the options of a reset; None resets all.

    Raises:
        InputError: it is no mask of all environments, or nothing is set in it.
    """
    given = (options or {}).get("reset_mask")
    if given is None:
        return None
    mask = np.asarray(given if isinstance(given, list) else arrays.to_numpy(given))
    if mask.dtype != np.bool_ or mask.shape != (num_envs,):
        raise InputError(
            f"options['reset_mask']: {mask.dtype} of shape {mask.shape}, needs bool ({num_envs},)"
        )
    if not mask.any():
        raise InputError("options['reset_mask']: must be True somewhere")
    return mask
