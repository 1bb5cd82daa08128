# SPDX-License-Identifier: Apache-2.0
"""Make a robot's YAML from the URDF of a differential-drive robot."""

from pm01_nav.robot_import.importer import ImportedRobot, import_urdf
from pm01_nav.robot_import.notes import read_notes
from pm01_nav.robot_import.writer import new_robot_text, robot_text, write_robot

__all__ = [
    "ImportedRobot",
    "import_urdf",
    "new_robot_text",
    "read_notes",
    "robot_text",
    "write_robot",
]
