# SPDX-License-Identifier: Apache-2.0
"""Run compiled functions on an NVIDIA GPU; in numba's CUDA simulator if that is switched on."""

from __future__ import annotations

import importlib
import warnings
import weakref
from collections.abc import Callable
from functools import cache
from typing import Any

from numba import cuda
from numba.core import config as numba_config

from pm01_nav.compilation import KERNEL_SOURCES, kernel_cache, patched

SIMULATED = bool(getattr(numba_config, "ENABLE_CUDASIM", False))
"""Whether NUMBA_ENABLE_CUDASIM=1 lets the kernels run in Python on the CPU, for tests."""
THREADS = 16 if SIMULATED else 128
"""Threads of a block; numba's simulator starts a thread of the CPU for each."""


@cache
def compiled_for_gpu(function: Callable[..., None]) -> Any:
    """Return a kernel made of a function, which is compiled at its first call and then kept."""
    if SIMULATED:
        return _simulated(function)
    from pm01_nav.cuda_functions import teach

    teach()
    folder = kernel_cache((*KERNEL_SOURCES, "cuda*.py"))
    with patched(numba_config, "CACHE_DIR", folder):
        return cuda.jit(cache=True)(function)


def _simulated(function: Callable[..., None]) -> Any:
    """Return a kernel for numba's CUDA simulator.

    It takes its arguments as one tuple: arrays that stand alone would be handed over in a disguise
    which functions that are compiled for the CPU do not know.
    """
    body: Any = cuda.jit(device=True)(function)

    def run(arguments: tuple[Any, ...]) -> None:
        body(*arguments)

    return cuda.jit(run)


class BoundKernel:
    """A kernel with its arguments, which are looked at only once.

    At each call numba works out the types and the addresses of everything that a kernel is handed:
    a simulator's sixty arrays take longer than its step. So a launch is recorded once, and what
    was recorded is launched from then on.
    """

    def __init__(
        self, function: Callable[..., None], arguments: tuple[Any, ...], stream: Callable[[], int]
    ) -> None:
        """Compile ``function`` for ``arguments``: arrays on the device, named tuples, numbers.

        ``stream`` returns the handle of the stream to launch into.
        """
        self._kernel = compiled_for_gpu(function)
        self._arguments = arguments  # What was recorded refers to their memory.
        self._stream = stream
        if not SIMULATED:
            self._record()

    def __call__(self, threads: int) -> None:
        """Launch at least so many threads."""
        blocks = -(-threads // THREADS)
        if blocks == 0:
            return
        if SIMULATED:
            self._kernel[blocks, THREADS](self._arguments)
            return
        sizes = (blocks, 1, 1, THREADS, 1, 1, 0)
        stream = self._stream()
        checked(self._driver.cuLaunchKernel(self._function, *sizes, stream, self._parameters, 0))

    def _record(self) -> None:
        """Let a launch go into a graph instead of the GPU, and take its parameters from there."""
        driver: Any = importlib.import_module("cuda.bindings.driver")  # Comes with numba-cuda.
        self._driver = driver
        self._kernel.compile(tuple(self._kernel.typeof_pyval(a) for a in self._arguments))
        stream = checked(driver.cuStreamCreate(driver.CUstream_flags.CU_STREAM_NON_BLOCKING))
        relaxed = driver.CUstreamCaptureMode.CU_STREAM_CAPTURE_MODE_RELAXED
        checked(driver.cuStreamBeginCapture(stream, relaxed))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Of so few threads; but nothing is launched.
            self._kernel[1, THREADS, cuda.external_stream(int(stream))](*self._arguments)
        graph = checked(driver.cuStreamEndCapture(stream))
        weakref.finalize(self, driver.cuGraphDestroy, graph)
        (node,), _ = checked(driver.cuGraphGetNodes(graph, 1))
        node = checked(driver.cuGraphKernelNodeGetParams(node))
        # Newer versions of numba-cuda launch kernels that belong to no context.
        self._function = driver.CUfunction(int(node.func) or int(node.kern))
        self._parameters = node.kernelParams  # Their memory is the graph's.
        checked(driver.cuStreamDestroy(stream))


def checked(answer: tuple[Any, ...]) -> Any:
    """Return what the driver answered.

    Raises:
        RuntimeError: it answered with an error.
    """
    error, *values = answer
    if int(error) != 0:
        raise RuntimeError(f"CUDA driver: {error.name}")
    return values[0] if len(values) == 1 else tuple(values)
