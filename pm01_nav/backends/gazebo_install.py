# SPDX-License-Identifier: Apache-2.0
"""Whether Gazebo Harmonic can be used from this Python, and what to do if not."""

from __future__ import annotations

import sys
from importlib.util import find_spec

from pm01_nav.errors import InputError

MODULES = ("gz.sim8", "gz.transport13", "gz.msgs10", "gz.math7")
"""Python bindings of Gazebo Harmonic that the backend needs."""
OTHER_RELEASES = {"gz.sim7": "Garden", "gz.sim9": "Ionic", "gz.sim10": "Jetty"}
GUIDE = "docs/guide/gazebo.md"
PACKAGES = "gz-harmonic python3-gz-sim8 python3-gz-transport13 python3-gz-msgs10 python3-gz-math7"
INSTALL = {
    "22.04": f"Ubuntu 22.04: add the apt repository of Gazebo ({GUIDE}), then "
    f"sudo apt install {PACKAGES}; the virtual environment needs Python 3.10 and "
    "--system-site-packages",
    "24.04": "Ubuntu 24.04: sudo apt install ros-jazzy-ros-gz and source "
    f"/opt/ros/jazzy/setup.bash, or as on 22.04 with Python 3.12 ({GUIDE})",
}


def has_module(name: str) -> bool:
    """Tell whether a module can be found; its parent package may be missing."""
    try:
        return find_spec(name) is not None
    except ModuleNotFoundError:
        return False


def what_is_missing() -> str | None:
    """Return in a few words what stands between this Python and Gazebo; None if nothing does."""
    missing = [name for name in MODULES if not has_module(name)]
    if not missing:
        return None
    others = [release for name, release in OTHER_RELEASES.items() if has_module(name)]
    if "gz.sim8" in missing and others:
        return f"Gazebo {others[0]} is installed, but Harmonic (gz-sim 8) is needed"
    version = ".".join(map(str, sys.version_info[:2]))
    return f"Python {version} has no {', '.join(missing)}"


def how_to_install() -> str:
    """Return what to type on Ubuntu 22.04 and on 24.04."""
    return "; ".join(INSTALL.values())


def require_gazebo(backend: str) -> None:
    """Do nothing where Gazebo Harmonic is installed.

    Raises:
        InputError: something is missing; the text tells how to install it.
    """
    missing = what_is_missing()
    if missing is not None:
        raise InputError(f"backend = {backend!r}: {missing}. {how_to_install()}")
