# SPDX-License-Identifier: Apache-2.0
"""Which robot in which Gazebo, where one runs already."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from pm01_nav.config import FrozenModel

Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9_/-]*$")]


class GazeboAddress(FrozenModel):
    """Names of a world, a model and topics; they are those of ``pm01_gazebo``'s launch file."""

    world: Name = ""
    """Name of the world; empty takes the one that runs."""
    model: Name = "pm01"
    """Name of the robot's model."""
    namespace: Name = ""
    """Before ``/scan``, ``/odom`` and ``/cmd_vel``, e.g. ``robot1`` for ``/robot1/scan``."""

    def topic(self, name: str) -> str:
        """Return the address of a topic."""
        return "/".join(("", *(part for part in (self.namespace.strip("/"), name) if part)))
