# SPDX-License-Identifier: Apache-2.0
"""SDF worlds as short texts, for the tests of their readers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pm01_nav.worlds.reading import Reading
from pm01_nav.worlds.sdf import read_sdf

CRATE = "<box><size>1 1 1</size></box>"


def solid(shape: str = CRATE, pose: str = "0 0 0 0 0 0") -> str:
    """A collision."""
    return f"<collision name='c'><pose>{pose}</pose><geometry>{shape}</geometry></collision>"


def model(content: str, pose: str = "0 0 0.5 0 0 0", name: str = "m") -> str:
    """A model with one link, whose content is given."""
    link = f"<link name='link'>{content}</link>"
    return f"<model name='{name}'><pose>{pose}</pose>{link}</model>"


def sdf(*content: str, version: str = "1.9") -> str:
    """A world."""
    return f"<sdf version='{version}'><world name='hall'>{''.join(content)}</world></sdf>"


def read(folder: Path, text: str, **options: Any) -> Reading:
    """Write ``hall.sdf`` and read it."""
    (folder / "hall.sdf").write_text(text)
    return read_sdf(folder / "hall.sdf", **options)


def centres(reading: Reading) -> list[list[float]]:
    """The means of the polygons' corners, sorted, to a micrometre."""
    return sorted((p.mean(axis=0).round(6) + 0.0).tolist() for p in reading.world.polygons)
