# SPDX-License-Identifier: Apache-2.0
"""Two driven wheels side by side: forwards and backwards, and turns, on the spot too."""

from __future__ import annotations

from dataclasses import dataclass

from pm01_nav.drives.base import Drive, drive


@drive
@dataclass(frozen=True)
class DifferentialDrive(Drive):
    """Commands are v and w [m/s, rad/s]."""

    name = "differential"
    axes = ("x", "yaw")
    has_wheels = True
    identified_by = "wheel pair"
