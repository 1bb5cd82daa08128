# SPDX-License-Identifier: Apache-2.0
"""Compile numerical functions with numba and keep the result between runs."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, partial
from pathlib import Path
from types import ModuleType
from typing import Any

import numba
from numba.core import codegen, event
from numba.core import config as numba_config


def cache_folder() -> Path:
    """Return the folder for things worth keeping between runs (``$PM01_CACHE`` overrides)."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(os.environ.get("PM01_CACHE") or Path(base) / "pm01_nav")


KERNEL_SOURCES = ("compilation.py", "drives/base.py", "sim/*.py", "worlds/**/*.py")
"""Files whose functions the simulator's kernels may call."""
MISSING = object()
PLANNER_SOURCES = (*KERNEL_SOURCES, "planners/*.py")


@cache
def kernel_cache(sources: tuple[str, ...]) -> str:
    """Return a folder whose name changes whenever one of the sources does.

    Numba looks only at the file of the outermost function, so a kernel would otherwise go on
    using an older version of a function that it calls from another file.
    """
    package = Path(__file__).parent
    digest = hashlib.sha256()
    for source in sorted(file for pattern in sources for file in package.glob(pattern)):
        digest.update(source.read_bytes())
    return str(cache_folder() / "kernels" / digest.hexdigest()[:16])


def _use_wide_vectors() -> None:
    """Let numba use vectors of 512 bits in this process, which makes a step a third faster.

    LLVM by itself keeps to 256 bits, since the first processors with AVX-512 slowed down for it;
    those since Ice Lake and Zen 4 (AVX-512 VBMI2) do not. ``NUMBA_CPU_FEATURES`` overrides this.
    """
    chosen = getattr(numba_config, "CPU_FEATURES", None)  # numba sets its settings by their names
    features = codegen.get_host_cpu_features()
    if not chosen and "+avx512vbmi2" in features.split(","):
        setattr(numba_config, "CPU_FEATURES", f"{features},-prefer-256-bit")  # noqa: B010


_use_wide_vectors()


def compiled(
    function: Callable[..., Any] | None = None,
    *,
    parallel: bool = False,
    inline: bool = True,
    allocates: bool = False,
) -> Any:
    """Compile a function on its first call.

    ``parallel`` spreads its ``prange`` over threads. ``inline=False`` keeps rarely needed code
    out of its callers, where it would cost registers (measured: a third of the time of a step).
    ``allocates`` is for functions that make arrays or lists. All others go without numba's
    reference counts, which took more than half of a step: their arrays belong to the caller.
    """
    if function is None:
        return partial(compiled, parallel=parallel, inline=inline, allocates=allocates)
    options = {
        "cache": True,
        "error_model": "numpy",
        "parallel": parallel,
        "forceinline": inline and not parallel,
        "_nrt": allocates,
    }
    planner = function.__module__.startswith("pm01_nav.planners")
    folder = kernel_cache(PLANNER_SOURCES if planner else KERNEL_SOURCES)
    return _cached_in(folder, function, options)


@cache
def threadless(kernel: Any) -> Any:
    """Return a ``parallel`` function compiled to run in the calling thread, with the same results.

    OpenMP's threads do not survive a fork, and a forked process that asks for some is ended.
    """
    options = {name: kernel.targetoptions[name] for name in ("error_model", "_nrt")}
    # Numba's cache does not tell the two apart.
    folder = str(Path(kernel_cache(KERNEL_SOURCES)) / "threadless")
    return _cached_in(folder, kernel.py_func, options | {"cache": True})


def _cached_in(folder: str, function: Callable[..., Any], options: dict[str, Any]) -> Any:
    # The setting is read here and now; other users of numba in this process keep theirs.
    with patched(numba_config, "CACHE_DIR", folder):
        return numba.njit(**options)(function)


_COMPILING = event.TimingListener()
event.register("numba:compile", _COMPILING)


def seconds_compiling() -> float:
    """Return how long this process has compiled so far [s]; reading what was kept is no part."""
    return _COMPILING.duration if _COMPILING.done else 0.0


def bound(kernel: Any, *arguments: object) -> Callable[..., None]:
    """Return a compiled function as it is for the types of ``arguments``, without numba's dispatch.

    Numba looks at the type of everything it is handed at each call, and a simulator hands over some
    sixty arrays: that took a tenth of a step of a thousand robots. Nothing is checked here, so it
    may be called with arguments of exactly these types only.
    """
    signature = tuple(numba.typeof(argument) for argument in arguments)
    kernel.compile(signature)
    return kernel.overloads[signature].entry_point


@contextmanager
def patched(module: ModuleType, name: str, value: object) -> Iterator[None]:
    """Set an attribute of a module for a while."""
    before = getattr(module, name, MISSING)
    setattr(module, name, value)
    try:
        yield
    finally:
        if before is MISSING:
            delattr(module, name)
        else:
            setattr(module, name, before)
