# SPDX-License-Identifier: Apache-2.0
"""Import heavy packages quickly."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def without_collecting() -> Iterator[None]:
    """Let no garbage collector look through what is imported, which is no garbage.

    torch and the rest make a million objects that stay; looking through them again and again takes
    a sixth of their import. Nor are they looked through later.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        if was_enabled:
            gc.enable()
