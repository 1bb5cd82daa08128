# SPDX-License-Identifier: Apache-2.0
"""What is written as YAML can be read again."""

from __future__ import annotations

from pathlib import Path

from pm01_nav.config import to_yaml
from pm01_nav.documents import load_yaml


def test_what_stands_twice_is_written_twice(tmp_path: Path) -> None:
    corner = [1.0, 2.0]
    data = {"first": corner, "second": {"again": corner}}
    path = tmp_path / "a.yaml"
    path.write_text(to_yaml(data), encoding="utf-8")
    # With an alias, which PyYAML writes by default, the reader would refuse the file.
    assert load_yaml(path) == {"first": [1.0, 2.0], "second": {"again": [1.0, 2.0]}}
