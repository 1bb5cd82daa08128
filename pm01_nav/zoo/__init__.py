# SPDX-License-Identifier: Apache-2.0
"""Trained policies that come with the package, each in a folder with its card.

``zoo:NAME`` stands for the file of one wherever a policy's file may stand.
"""

from __future__ import annotations

from pathlib import Path

from pm01_nav.errors import InputError

PREFIX = "zoo:"
FOLDER = Path(__file__).parent


def zoo_names() -> list[str]:
    """Return the names of the policies in the zoo."""
    return sorted(path.parent.name for path in FOLDER.glob("*/policy.onnx"))


def zoo_folder(name: str) -> Path:
    """Return the folder of a policy, which holds policy.onnx and card.yaml.

    Raises:
        InputError: there is no such policy.
    """
    if name not in zoo_names():
        raise InputError(f"zoo:{name}: no such policy; there are {', '.join(zoo_names())}")
    return FOLDER / name


def resolved(name: str | Path) -> Path:
    """Return the file that ``zoo:NAME`` stands for; any other path as it is.

    Raises:
        InputError: there is no such policy.
    """
    text = str(name)
    if not text.startswith(PREFIX):
        return Path(name)
    return zoo_folder(text.removeprefix(PREFIX)) / "policy.onnx"
