# SPDX-License-Identifier: Apache-2.0
"""Where a batch keeps its arrays: numpy's on the CPU, or another library's on a device."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Device = Literal["cpu", "cuda"]
DEVICES: tuple[Device, ...] = ("cpu", "cuda")


@dataclass(frozen=True)
class Arrays:
    """A library of arrays on one device; the simulator and the task see it through this alone."""

    device: Device
    xp: Any
    """Namespace of the array API standard."""
    place: Any
    """What the namespace's functions take as ``device``."""
    from_numpy: Callable[[NDArray[Any]], Any]
    """Copies an array to the device; there unsigned numbers of 64 bits are kept as signed ones."""
    to_numpy: Callable[[Any], NDArray[Any]]
    """Copies an array from the device."""
    for_kernel: Callable[[Any], Any]
    """Returns an array as compiled kernels take it, not copied."""
    stream: Callable[[], int]
    """Returns the handle of the stream of work that the library uses at the moment."""
    free_bytes: Callable[[], float]
    """Returns how much memory is free on the device."""


def _as_it_is(array: Any) -> Any:
    return array


NUMPY = Arrays(
    device="cpu",
    xp=np,
    place="cpu",
    from_numpy=_as_it_is,
    to_numpy=_as_it_is,
    for_kernel=_as_it_is,
    stream=lambda: 0,
    free_bytes=lambda: math.inf,
)


_NAMESPACES: dict[type, Any] = {}


def register(kind: type, namespace: Any) -> None:
    """Say what the namespace of a kind of arrays is that does not say so itself, as torch's."""
    _NAMESPACES[kind] = namespace


def array_namespace(array: Any) -> Any:
    """Return the namespace of the array API standard to which an array belongs."""
    namespace = _NAMESPACES.get(type(array))
    return array.__array_namespace__() if namespace is None else namespace
