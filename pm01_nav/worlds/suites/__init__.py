# SPDX-License-Identifier: Apache-2.0
"""Where worlds come from: generators, which draw a world from random numbers, and files.

Every module of this folder is imported, so that a source is known as soon as its file is here.
Nothing here checks that a world can be crossed: ``pool.draw_world`` draws again until it can.
"""

from importlib import import_module
from pkgutil import iter_modules

from pm01_nav.worlds.suites.registry import (
    SOURCES,
    Generator,
    Wanted,
    WorldSource,
    suite,
    suites,
    world_source,
    world_source_of,
)

for _module in iter_modules(__path__):
    import_module(f"{__name__}.{_module.name}")

__all__ = [
    "SOURCES",
    "Generator",
    "Wanted",
    "WorldSource",
    "suite",
    "suites",
    "world_source",
    "world_source_of",
]
