# SPDX-License-Identifier: Apache-2.0
"""Algorithms: what their hyper-parameters mean, and how a learner is made of them.

Every module of this folder is imported, so that an algorithm is known as soon as its file is here.
None imports torch before its learner is built, since each second of a short training counts.
"""

from importlib import import_module
from pkgutil import iter_modules

from pm01_nav.training.algorithm_config import ALGORITHMS, algorithm

for _module in iter_modules(__path__):
    import_module(f"{__name__}.{_module.name}")

__all__ = ["ALGORITHMS", "algorithm"]
