# SPDX-License-Identifier: Apache-2.0
"""What the policy node counts of itself."""

from __future__ import annotations

import pytest

pytestmark = pytest.mark.ros
pytest.importorskip("rclpy", reason="ROS 2's rclpy is not installed")


def test_a_step_is_late_by_more_than_half_a_period() -> None:
    from pm01_rl.diagnostics import Timing

    timing = Timing(0.1)
    # Half a period late, as near as floats can say it: 12.45 - 12.30 is more than 1.5 times 0.1.
    for now in (12.2, 12.3, 12.45, 12.6, 12.75):
        timing.note(now, 0.001)
    assert (timing.steps, timing.late) == (5, 0)
    timing.note(12.92, 0.001)
    assert timing.late == 1
