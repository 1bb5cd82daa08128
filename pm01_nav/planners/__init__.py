# SPDX-License-Identifier: Apache-2.0
"""Classical planners, under the same protocol as a learned policy.

Every module of this folder is imported, so that a planner is known as soon as its file is here.
"""

from importlib import import_module
from pkgutil import iter_modules

from pm01_nav.planners.registry import PLANNERS, make_planner, planner, planner_params

for _module in iter_modules(__path__):
    import_module(f"{__name__}.{_module.name}")

__all__ = ["PLANNERS", "make_planner", "planner", "planner_params"]
