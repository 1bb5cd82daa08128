# SPDX-License-Identifier: Apache-2.0
"""The robot's description, expanded."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from xml.etree.ElementTree import Element

import pytest
from defusedxml.ElementTree import fromstring

PACKAGE = Path(__file__).parents[2] / "src" / "pm01_description"
Expand = Callable[..., str]


@pytest.fixture(scope="session")
def expand() -> Expand:
    """Return a function that expands the xacro with arguments into the text of a URDF."""
    xacro = pytest.importorskip("xacro", reason="needs xacro (extra dev)")

    def run(**arguments: str) -> str:
        path = str(PACKAGE / "urdf" / "pm01.urdf.xacro")
        return xacro.process_file(path, mappings=arguments).toxml()

    return run


@pytest.fixture(scope="session")
def robot(expand: Expand) -> Element:
    """The URDF without tags for Gazebo."""
    return fromstring(expand())
