# SPDX-License-Identifier: Apache-2.0
"""The ROS package ``pm01_rl`` without ROS: its versions, and what it says it needs."""

from __future__ import annotations

import ast
import re
from pathlib import Path

from defusedxml.ElementTree import parse

from pm01_nav import __version__

PACKAGE = Path(__file__).resolve().parents[2] / "src" / "pm01_rl"
OURS = {"pm01_nav", "pm01_rl", "numpy"}
PROVIDED_BY = {"tf2_ros": "tf2_ros_py"}


def test_versions_agree():
    found = parse(PACKAGE / "package.xml").getroot()
    assert found.findtext("version") == __version__
    assert f'version="{__version__}"' in (PACKAGE / "setup.py").read_text()


def test_package_xml_names_all_that_is_imported():
    import sys

    named = {e.text for e in parse(PACKAGE / "package.xml").getroot().iter("exec_depend")}
    imported = set()
    for path in [*PACKAGE.glob("pm01_rl/*.py"), *PACKAGE.glob("launch/*.py")]:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and node.module:
                imported.add(node.module.split(".")[0])
            elif isinstance(node, ast.Import):
                imported.update(name.name.split(".")[0] for name in node.names)
    imported -= set(sys.stdlib_module_names) | OURS
    assert {PROVIDED_BY.get(name, name) for name in imported} <= named


def test_every_executable_has_its_function():
    scripts = re.findall(r'"\w+ = pm01_rl\.(\w+):(\w+)"', (PACKAGE / "setup.py").read_text())
    assert len(scripts) == 5
    for module, function in scripts:
        tree = ast.parse((PACKAGE / "pm01_rl" / f"{module}.py").read_text())
        assert function in {n.name for n in tree.body if isinstance(n, ast.FunctionDef)}
