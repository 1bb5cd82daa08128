# SPDX-License-Identifier: Apache-2.0
"""Where a result comes from: command, code revision, versions and machine.

Results are shown to strangers, so that they name no folder outside the working folder, no user and
no host.
"""

from __future__ import annotations

import os
import platform
import re
import shlex
import socket
import subprocess
import sys
from collections.abc import Iterable
from datetime import datetime, timezone
from importlib import metadata
from pathlib import Path
from typing import Any

PACKAGES = ("numpy", "numba", "gymnasium", "stable-baselines3", "torch", "onnxruntime")
BEGIN = r"(?<![^\s=:,;'\"`(\[{<])"
"""Where a path may begin within a text: at its start, and after what sets values apart."""
OUTSIDE = re.compile(
    # An address, of which passwords and machines are parts: its kind and the last name stay.
    rf"{BEGIN}(?P<kind>[A-Za-z][\w+.-]*://)[^\s,'\"`)\]}}>]*"
    # A path in quotation marks, which may have spaces.
    r"|(?<=')[/~][^'\n]*(?=')|(?<=\")[/~][^\"\n]*(?=\")"
    rf"|{BEGIN}(?:~[\w.-]*/|(?:[\w.-]+/)*\.\.(?=/)|/)[^\s,;:'\"`)\]}}>]*"
)
"""What names something beyond the working folder."""


def provenance() -> dict[str, Any]:
    """Return plain data that lets somebody else repeat a result."""
    return {
        "command": shown_command("pm01", sys.argv[1:]),
        "created": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "git_revision": git_revision(),
        "versions": versions(),
        "machine": machine(),
    }


def shown_command(program: str, arguments: Iterable[str]) -> str:
    """Return a command as one may type it; of paths outside the working folder the names stay."""
    return shlex.join([program, *map(_shown_argument, arguments)])


def shown_path(path: str | Path) -> str:
    """Return a path relative to the working folder, or its name if it lies outside."""
    if str(path).startswith("~"):
        return Path(path).name
    here, home = Path.cwd(), Path.home()
    for absolute in (Path(os.path.abspath(path)), Path(path).resolve()):
        # Seen from above the home folder, a path in it would still name the user.
        through_home = absolute.is_relative_to(home) and not here.is_relative_to(home)
        if absolute.is_relative_to(here) and not through_home:
            return absolute.relative_to(here).as_posix()
    return Path(path).name or "/"


def shown(data: Any) -> Any:
    """Return plain data with each path outside the working folder reduced to its name."""
    if isinstance(data, dict):
        return {key: shown(value) for key, value in data.items()}
    if isinstance(data, list):
        return [shown(value) for value in data]
    if not isinstance(data, str):
        return data
    text = re.sub(rf"\b{re.escape(socket.gethostname())}(?=:\d)", "localhost", data)
    return OUTSIDE.sub(_shown_match, text)


def _shown_argument(argument: str) -> str:
    """Return an argument, which may be a path with spaces, alone or after a ``=``."""
    name, equals, value = argument.rpartition("=")
    found = OUTSIDE.match(value)
    if found and not found["kind"]:
        return name + equals + _shown_outside(value)
    return shown(argument)


def _shown_match(found: re.Match[str]) -> str:
    if found["kind"]:
        return found["kind"] + found.group().rpartition("/")[2]
    return _shown_outside(found.group())


def _shown_outside(path: str) -> str:
    # A single name is ROS's, such as /scan, unless there is such a file.
    if path.count("/") == 1 and path.startswith("/") and not os.path.exists(path):
        return path
    return shown_path(path)


def versions() -> dict[str, str]:
    """Return the versions of Python, this package and those that decide its results."""
    found = {"python": platform.python_version()}
    for package in ("pm01-nav", *PACKAGES):
        version = installed_version(package)
        if version is not None:
            found[package] = version
    return found


def installed_version(package: str) -> str | None:
    """Return a package's version, None where it is not installed."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def machine() -> dict[str, Any]:
    """Return what decides the speed of this machine."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return {"system": platform.platform(), "processor": _processor(), "cores": cores}


def git_revision() -> str | None:
    """Return the commit of the code in use, with ``-dirty`` if it was changed; None outside git."""
    folder = Path(__file__).parent
    try:
        described = subprocess.run(
            ["git", "-C", str(folder), "describe", "--always", "--dirty", "--abbrev=12"],
            capture_output=True,
            text=True,
            timeout=10,
            check=True,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return described.stdout.strip() or None


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()
