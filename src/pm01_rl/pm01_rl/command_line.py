# SPDX-License-Identifier: Apache-2.0
"""``ros2 run pm01_rl train`` and ``evaluate``, the same as ``pm01 train`` and ``evaluate``."""

from __future__ import annotations

import sys

from rclpy.utilities import remove_ros_args


def train() -> None:
    """Run ``pm01 train`` with the same arguments."""
    _run("train")


def evaluate() -> None:
    """Run ``pm01 evaluate`` with the same arguments."""
    _run("evaluate")


def _run(command: str) -> None:
    from pm01_nav.cli import main

    sys.argv = ["pm01", command, *remove_ros_args(sys.argv)[1:]]
    main()
