# SPDX-License-Identifier: Apache-2.0
"""Expand the macros of a xacro file, if the package ``xacro`` is there."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from xml.etree.ElementTree import Element

from pm01_nav.documents import MAX_BYTES, parse_xml_text
from pm01_nav.errors import InputError
from pm01_nav.robot_import import xacro_worker
from pm01_nav.robot_import.packages import Packages

TIMEOUT_S = 60.0
UNDEFINED = "Undefined substitution argument "


def has_macros(root: Element) -> bool:
    """Tell whether a file is a template and no robot yet."""
    return any(
        "/xacro}" in str(element.tag) or any("$" in value for value in element.attrib.values())
        for element in root.iter()
    )


def expand(path: Path, packages: Packages, arguments: Mapping[str, str]) -> Element:
    """Return the root of a xacro file with its macros expanded.

    ``arguments`` are those of the file (``xacro:arg``).

    Raises:
        InputError: xacro is not installed, refuses the file, or takes too long.
    """
    request = {
        "path": str(path.absolute()),
        "mappings": dict(arguments),
        "packages": {name: str(folder) for name, folder in packages.found.items()},
    }
    answer = _ask(request, path)
    if "missing" in answer:
        raise InputError(
            f"{path}: holds xacro macros, and {answer['missing']} is missing: pip install xacro; "
            f"or expand it first: xacro {path.name} > robot.urdf"
        )
    text = answer.get("text", "")
    if not text:
        reason = " ".join(answer.get("error", "").split())[:300]
        if reason.startswith(UNDEFINED):
            name = reason.removeprefix(UNDEFINED).split()[0]
            reason += f": give {name}:=VALUE"
        raise InputError(f"{path}: xacro: {reason}")
    if len(text) > MAX_BYTES:
        raise InputError(f"{path}: xacro: expands to more than {MAX_BYTES} bytes")
    return parse_xml_text(text, path)


def _ask(request: dict[str, object], path: Path) -> dict[str, str]:
    try:
        done = subprocess.run(
            [sys.executable, xacro_worker.__file__],
            input=json.dumps(request),
            capture_output=True,
            text=True,
            timeout=TIMEOUT_S,
            check=False,
        )
        answer = json.loads(done.stdout)
    except subprocess.TimeoutExpired:
        raise InputError(f"{path}: xacro: takes more than {TIMEOUT_S:g} s") from None
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: xacro: ended without an answer") from error
    return answer
