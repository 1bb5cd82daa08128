# SPDX-License-Identifier: Apache-2.0
"""Read the comments of a robot's YAML: where each figure came from."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import yaml

from pm01_nav.documents import read_text


class Notes(NamedTuple):
    """What a file says beside its figures."""

    by_key: dict[str, str]
    """The comment behind a figure, by its key such as ``wheels.radius``."""
    head: tuple[str, ...]
    """The lines of the comment at the head."""


def read_notes(path: Path) -> Notes:
    """Return the comments of a file that ``load_yaml`` has read.

    Raises:
        InputError: it cannot be read.
    """
    text = read_text(path)
    lines = text.splitlines()
    head = []
    for line in lines:
        if not line.startswith("#"):
            break
        head.append(line.lstrip("#").strip())
    root = yaml.compose(text, Loader=yaml.SafeLoader)
    return Notes(dict(_comments(root, "", lines)), tuple(head))


def _comments(node: yaml.Node | None, prefix: str, lines: list[str]) -> Iterator[tuple[str, str]]:
    if not isinstance(node, yaml.MappingNode):
        return
    for key, value in node.value:
        name = f"{prefix}{key.value}"
        # A block's comment stands behind its key; all else ends where its value does.
        nested = isinstance(value, yaml.CollectionNode) and not value.flow_style
        end = key.end_mark if nested else value.end_mark
        rest = lines[end.line][end.column :] if end.line < len(lines) else ""
        _, sign, comment = rest.partition("#")
        if sign:
            yield name, comment.strip()
        yield from _comments(value, f"{name}.", lines)
