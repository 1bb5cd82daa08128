# SPDX-License-Identifier: Apache-2.0
"""Arrays on the device that a person asks for."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pm01_nav.arrays import DEVICES, NUMPY, Arrays, register
from pm01_nav.errors import InputError


def arrays_on(device: str) -> Arrays:
    """Return numpy's arrays for ``cpu``, and torch's on the GPU for ``cuda``.

    Raises:
        InputError: the device is unknown, or there is no usable GPU.
    """
    if device == "cpu":
        return NUMPY
    if device != "cuda":
        raise InputError(f"device = {device!r}: allowed: {', '.join(DEVICES)}")
    try:
        import array_api_compat.torch
        import torch
        from numba import cuda

        from pm01_nav.cuda import SIMULATED
    except ImportError as error:
        raise InputError(
            f"device = 'cuda': {error.name} is missing; pip install 'pm01-nav[train,gpu]'"
        ) from error
    if not SIMULATED:
        _check_gpu(torch, cuda)
    namespace = TorchNamespace(array_api_compat.torch)
    register(torch.Tensor, namespace)
    return _torch_arrays(torch, cuda, namespace, SIMULATED)


class TorchNamespace:
    """torch's functions by the names of the array API standard.

    ``array-api-compat`` copies a number to the GPU, and waits for it, wherever one is compared
    with an array; torch can take it along as it is.
    """

    def __init__(self, functions: Any) -> None:
        """Wrap ``array_api_compat.torch``."""
        self._functions = functions

    def __getattr__(self, name: str) -> Any:
        """Return what is no different from the wrapped namespace."""
        value = getattr(self._functions, name)
        setattr(self, name, value)
        return value

    def minimum(self, a: Any, b: Any) -> Any:
        """Return the lesser of an array and an array or a number, element by element."""
        return a.clamp_max(b)

    def maximum(self, a: Any, b: Any) -> Any:
        """Return the greater of an array and an array or a number, element by element."""
        return a.clamp_min(b)

    def where(self, condition: Any, a: Any, b: Any) -> Any:
        """Choose from two arrays or numbers, element by element."""
        return self._functions.torch.where(condition, a, b)  # Takes numbers, too.


def _torch_arrays(torch: Any, cuda: Any, namespace: Any, simulated: bool) -> Arrays:
    place = torch.device("cpu" if simulated else "cuda")

    def from_numpy(array: NDArray[Any]) -> Any:
        signed = array.view(np.int64) if array.dtype == np.uint64 else array
        return torch.from_numpy(np.array(signed)).to(place)

    def to_numpy(array: Any) -> NDArray[Any]:
        return array if isinstance(array, np.ndarray) else array.numpy(force=True)

    def for_kernel(array: Any) -> Any:
        return array.numpy() if simulated else cuda.as_cuda_array(array, sync=False)

    def stream() -> int:
        return 0 if simulated else torch.cuda.current_stream().cuda_stream

    def free_bytes() -> float:
        return math.inf if simulated else torch.cuda.mem_get_info()[0]

    return Arrays(
        device="cuda",
        xp=namespace,
        place=place,
        from_numpy=from_numpy,
        to_numpy=to_numpy,
        for_kernel=for_kernel,
        stream=stream,
        free_bytes=free_bytes,
    )


def _check_gpu(torch: Any, cuda: Any) -> None:
    """Look whether both libraries can use the GPU.

    Raises:
        InputError: one of them cannot; it says why.
    """
    try:
        torch.cuda.init()  # Says what is wrong, for example that the driver is too old.
    except (RuntimeError, AssertionError) as error:
        reason = " ".join(str(error).split())[:200]
        raise InputError(f"device = 'cuda': {reason}; see nvidia-smi, or use cpu") from error
    if not cuda.is_available():
        raise InputError("device = 'cuda': numba finds no CUDA driver; see nvidia-smi, or use cpu")
