# SPDX-License-Identifier: Apache-2.0
"""The values of the algorithms' hyper-parameters, one YAML file an algorithm."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

from pm01_nav.documents import load_yaml


@cache
def stored_values(algorithm: str) -> dict[str, Any]:
    """Return the values that an algorithm is run with unless others are given; do not alter."""
    file = Path(__file__).with_name(f"{algorithm}.yaml")
    return load_yaml(file) if file.is_file() else {}
