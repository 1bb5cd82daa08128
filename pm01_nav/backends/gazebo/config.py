# SPDX-License-Identifier: Apache-2.0
"""What a task says of Gazebo, and whether Gazebo Harmonic can be used from this Python."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.util import find_spec
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from pm01_nav.config import FrozenModel
from pm01_nav.errors import InputError

if TYPE_CHECKING:
    from pm01_nav.worlds.world import World

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
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9_/-]*$")]


class GazeboConfig(FrozenModel):
    """How robots know their place, and their names in a Gazebo that runs already.

    The names are those of ``pm01_gazebo``'s launch file.
    """

    localization: Literal["odometry", "ground_truth"] = "odometry"
    """How a robot of the backend ``gazebo`` knows its place: by its wheels, or as it is."""

    world: Name = ""
    """Name of the world; empty takes the one that runs."""
    model: Name = "pm01"
    """Name of the robot's model."""
    namespace: Name = ""
    """Before ``/scan``, ``/odom`` and ``/cmd_vel``, e.g. ``robot1`` for ``/robot1/scan``."""

    def topic(self, name: str) -> str:
        """Return the address of a topic."""
        return "/".join(("", *(part for part in (self.namespace.strip("/"), name) if part)))

    def require_running(self, worlds: Sequence[World], num_envs: int) -> None:
        """Refuse what a robot in a Gazebo that runs already cannot do.

        Raises:
            InputError: there are several robots or worlds, movers, or it shall know its place.
        """
        if self.localization != "odometry":
            raise InputError(
                f"task.gazebo.localization = {self.localization!r}: a robot of "
                "gazebo_transport knows its place by odometry only"
            )
        if num_envs != 1 or len(worlds) != 1:
            raise InputError(
                "backend = 'gazebo_transport': drives one robot in the one world that runs; give "
                "that world with --task map --map WORLD.sdf"
            )
        if worlds[0].movers:
            raise InputError("backend = 'gazebo_transport': cannot know where movers are")


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
