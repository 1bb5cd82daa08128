# SPDX-License-Identifier: Apache-2.0
"""What learned policies and classical planners have in common."""

from __future__ import annotations

import inspect
from typing import Protocol, TypeGuard

import numpy as np
from numpy.typing import ArrayLike, NDArray


class Policy(Protocol):
    """Drive one robot, or many at once when every argument has a leading batch dimension."""

    def act(self, scan: ArrayLike, goal: ArrayLike, velocity: ArrayLike) -> NDArray[np.float64]:
        """Return the next command (..., axes): v and w, or vx, vy and w [m/s, rad/s].

        ``scan`` (..., num_beams): ranges as the lidar gives them [m]. ``goal`` (..., 2): x forward
        and y left in base_link [m]. ``velocity`` (..., axes): as measured [m/s, rad/s].
        """
        ...

    def reset(self) -> None:
        """Forget the past before a new episode."""
        ...

    def keep(self, robots: NDArray[np.int64]) -> None:
        """Go on with these of the robots, numbered as in the last ``act``; the rest are done."""
        ...


class TimedPolicy(Policy, Protocol):
    """A policy with a memory that can be told what went on since the last call."""

    def act(
        self,
        scan: ArrayLike,
        goal: ArrayLike,
        velocity: ArrayLike,
        *,
        now: float | None = None,
        applied: ArrayLike | None = None,
        pose: ArrayLike | None = None,
    ) -> NDArray[np.float64]:
        """Return the next command, as ``Policy.act`` does.

        ``now`` [s]: the time, by any clock that does not jump. ``applied`` (..., axes): the command
        that the robot was given last [m/s, rad/s]. ``pose`` (..., 3): by odometry [m, m, rad].
        """
        ...


def is_timed(policy: Policy) -> TypeGuard[TimedPolicy]:
    """Tell whether ``act`` takes what a ``TimedPolicy``'s does; it need not."""
    return {"now", "applied", "pose"} <= inspect.signature(policy.act).parameters.keys()
