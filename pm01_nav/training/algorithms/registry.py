# SPDX-License-Identifier: Apache-2.0
"""The table of algorithms. One enters it under ``@algorithm``, in a file of its own."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from pm01_nav.training.algorithm_config import AlgorithmConfig

ALGORITHMS: dict[str, type[AlgorithmConfig]] = {}
Config = TypeVar("Config", bound=type[AlgorithmConfig])


def algorithm(name: str) -> Callable[[Config], Config]:
    """Enter hyper-parameters, which know what they are for, in the table."""

    def enter(config: Config) -> Config:
        config.name = name
        ALGORITHMS[name] = config
        return config

    return enter
