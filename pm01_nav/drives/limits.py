# SPDX-License-Identifier: Apache-2.0
"""How a robot's description gives its drive's limits; a policy on a robot does not need it."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from pm01_nav.config import FrozenModel

Positive = Annotated[float, Field(gt=0.0)]


class Limits(FrozenModel):
    """What a base can do; the simulator enforces it and a policy's commands stay within."""

    linear_min: Annotated[float, Field(le=0.0)]
    """Fastest speed backwards [m/s], zero or negative."""
    linear_max: Positive
    """Fastest speed forwards [m/s]."""
    angular_max: Positive
    """Fastest turn to either side [rad/s]."""
    linear_acceleration: Positive
    """[m/s^2]"""
    angular_acceleration: Positive
    """[rad/s^2]"""


class OmnidirectionalLimits(Limits):
    """What a base can do that goes sideways, too."""

    lateral_max: Positive
    """Fastest speed to either side [m/s]."""
    lateral_acceleration: Positive
    """[m/s^2]"""
    shape: Literal["box", "ellipse"] = "ellipse"
    """Whether both speeds can be had at once (box), or slantwise less of each (ellipse)."""


LIMITS: dict[str, type[Limits]] = {
    "differential": Limits,
    "omnidirectional": OmnidirectionalLimits,
}
"""By the name of the drive."""
