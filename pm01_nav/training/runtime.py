# SPDX-License-Identifier: Apache-2.0
"""Settings of the process that decide how fast a learner runs on a CPU."""

from __future__ import annotations

import ctypes
import os
import platform
import time
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import torch

M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3
"""Names of glibc's ``mallopt`` parameters (malloc.h)."""
KEEP_BYTES = 1 << 30
CLEAR_GAIN = 1.25
"""More threads must be at least this much faster in a minibatch update, or one is used.

With the default network two threads on two cores gain 1.5 there and in the whole training, and
beside busy cores they lose 5 % against one (``benchmarks/results/learner.json``).
"""


@dataclass(frozen=True)
class ThreadChoice:
    """How many threads the learner uses, and why."""

    threads: int
    reason: str


def keep_freed_memory() -> None:
    """Let glibc keep freed memory instead of handing each large array back to the system.

    A minibatch allocates and frees dozens of arrays of about a megabyte; mapping them anew each
    time cost a quarter of the learner's time (measured). Elsewhere than on Linux this does nothing.
    """
    if platform.system() != "Linux":
        return
    try:
        libc = ctypes.CDLL("libc.so.6")
        libc.mallopt(M_MMAP_THRESHOLD, KEEP_BYTES)
        libc.mallopt(M_TRIM_THRESHOLD, KEEP_BYTES)
    except (OSError, AttributeError):
        return  # another C library: slower, nothing else


def choose_threads(
    requested: int, batch_size: int, observation_size: int, net_arch: tuple[int, ...]
) -> ThreadChoice:
    """Set and return the learner's number of threads; 0 asks for a measurement.

    Small networks gain little from threads, and lose much when another process keeps the cores
    busy, since every matrix product waits for the slowest thread.
    """
    available = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    if requested:
        torch.set_num_threads(requested)
        return ThreadChoice(requested, "as asked for")
    seconds = {}
    for threads in sorted({1, min(2, available or 1), min(4, available or 1)}):
        torch.set_num_threads(threads)
        seconds[threads] = _update_seconds(batch_size, [observation_size, *net_arch, 1])
    best = min(seconds, key=lambda n: seconds[n])
    chosen = best if seconds[1] > CLEAR_GAIN * seconds[best] else 1
    torch.set_num_threads(chosen)
    measured = ", ".join(f"{n}: {1e3 * s:.1f} ms" for n, s in seconds.items())
    return ThreadChoice(chosen, f"measured a minibatch update with {measured}")


def _update_seconds(batch_size: int, sizes: list[int], repeats: int = 5) -> float:
    """Return the median time of a forward and backward pass like the learner's [s]."""
    layers: list[torch.nn.Module] = []
    for n_in, n_out in pairwise(sizes):
        layers += [torch.nn.Linear(n_in, n_out), torch.nn.ReLU()]
    network = torch.nn.Sequential(*layers[:-1])
    # The generator is our own: measuring must not move the run's random numbers.
    inputs = torch.from_numpy(
        np.random.default_rng(0).normal(size=(batch_size, sizes[0])).astype(np.float32)
    )
    times = []
    for _ in range(repeats + 1):
        began = time.perf_counter()
        network(inputs).square().mean().backward()
        times.append(time.perf_counter() - began)
    return float(np.median(times[1:]))
