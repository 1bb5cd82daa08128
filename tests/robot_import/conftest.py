# SPDX-License-Identifier: Apache-2.0
"""A URDF made of pieces, so that a test can change one."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

INERTIAL = (
    '<inertial><mass value="0.2"/><inertia ixx="1e-3" ixy="0" ixz="0" iyy="2e-3" iyz="0" '
    'izz="1e-3"/></inertial>'
)
WHEEL = (
    '<collision><origin rpy="1.5708 0 0"/><geometry><cylinder radius="0.04" length="0.02"/>'
    "</geometry></collision>"
)
BODY = '<collision><geometry><box size="0.3 0.2 0.1"/></geometry></collision>'


def wheel(side: str, y: float, inertial: str, solid: str, limit: str = "", x: float = 0.0) -> str:
    return (
        f'<link name="{side}_wheel">{inertial}{solid}</link>'
        f'<joint name="{side}_joint" type="continuous"><parent link="base_link"/>'
        f'<child link="{side}_wheel"/><origin xyz="{x} {y} 0"/><axis xyz="0 1 0"/>{limit}</joint>'
    )


def robot(
    body: str = BODY,
    inertial: str = INERTIAL,
    solid: str = WHEEL,
    more: str = "",
    limit: str = "",
    x: float = 0.0,
) -> str:
    """A robot whose wheels stand at y = +-0.12 m."""
    return (
        '<?xml version="1.0"?>\n<robot name="Test Bot">'
        f'<link name="base_link">{body}</link>'
        f"{wheel('left', 0.12, inertial, solid, limit, x)}"
        f"{wheel('right', -0.12, inertial, solid, limit, x)}{more}</robot>"
    )


Write = Callable[..., Path]


@pytest.fixture
def urdf(tmp_path: Path) -> Write:
    """Return a function that writes a URDF, changed by its arguments, and returns its path."""

    def write(text: str | None = None, **pieces: str) -> Path:
        path = tmp_path / "bot.urdf"
        path.write_text(robot(**pieces) if text is None else text)
        return path

    return write
