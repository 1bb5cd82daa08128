# SPDX-License-Identifier: Apache-2.0
"""Classical planners, under the same protocol as a learned policy."""

from __future__ import annotations

from collections.abc import Callable

from pm01_nav.planners.goal_seeking import GoalSeeking
from pm01_nav.policy.protocol import Policy
from pm01_nav.robot import RobotSpec

PLANNERS: dict[str, Callable[[RobotSpec], Policy]] = {"goal_seeking": GoalSeeking}
"""Name -> planner; each is built from the robot's description."""
