# SPDX-License-Identifier: Apache-2.0
"""What a task says of Gazebo."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from pm01_nav.config import FrozenModel

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
