# SPDX-License-Identifier: Apache-2.0
"""Drives: what velocity commands mean to a base. Each kind is one file."""

from pm01_nav.drives.base import (
    BOX,
    DRIVES,
    ELLIPSE,
    AxisName,
    Drive,
    drive_from_dict,
    drive_to_dict,
)
from pm01_nav.drives.differential import DifferentialDrive
from pm01_nav.drives.omnidirectional import OmnidirectionalDrive

__all__ = [
    "BOX",
    "DRIVES",
    "ELLIPSE",
    "AxisName",
    "DifferentialDrive",
    "Drive",
    "OmnidirectionalDrive",
    "drive_from_dict",
    "drive_to_dict",
]
