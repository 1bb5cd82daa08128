# SPDX-License-Identifier: Apache-2.0
"""A camera in Gazebo, and what it shows."""

from __future__ import annotations

from typing import Any
from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pm01_nav.backends.engine import View
from pm01_nav.backends.gazebo_model import add_cylinder, add_inertial, fill
from pm01_nav.errors import InputError
from pm01_nav.worlds.sdf_writer import paint, text_of

PICTURE = "/picture"
"""The camera's topic."""
FIELD_OF_VIEW = np.radians(45.0)
"""From top to bottom, as MuJoCo has it [rad]."""
NEAR, FAR = 0.05, 60.0
"""What is nearer or farther is not drawn [m]."""
GREEN = "0.18 0.68 0.36 1"


def camera_model(size: tuple[int, int], rate: float) -> str:
    """Return an SDF file's text with a camera that hangs in the air; ``rate`` in [Hz]."""
    root = Element("sdf", version="1.9")
    link = SubElement(SubElement(root, "model", name="camera"), "link", name="link")
    add_inertial(link, 1.0, (0, 0, 0), (1.0, 1.0, 1.0))
    fill(link, gravity="false")
    sensor = SubElement(link, "sensor", name="camera", type="camera")
    fill(sensor, topic=PICTURE, update_rate=text_of([rate]), always_on="true")
    camera = SubElement(sensor, "camera")
    width, height = size
    across = 2.0 * np.arctan(np.tan(FIELD_OF_VIEW / 2.0) * width / height)
    fill(camera, horizontal_fov=text_of([across]))
    fill(SubElement(camera, "image"), width=str(width), height=str(height), format="R8G8B8")
    fill(SubElement(camera, "clip"), near=str(NEAR), far=str(FAR))
    return tostring(root, encoding="unicode")


def goal_model(view: View) -> str:
    """Return an SDF file's text with a marker on the floor that nothing can touch."""
    root = Element("sdf", version="1.9")
    model = SubElement(root, "model", name="goal")
    fill(model, static="true", pose=text_of((*view.goal, 0.005, 0, 0, 0)))
    visual = SubElement(SubElement(model, "link", name="link"), "visual", name="goal")
    add_cylinder(visual, view.goal_radius, 0.01)
    paint(visual, GREEN)
    return tostring(root, encoding="unicode")


def towards(view: View) -> NDArray[np.float64]:
    """Return the direction of a camera that looks along x, as a quaternion x, y, z, w, (4,)."""
    x, y, z = np.subtract(view.target, view.eye)
    turn = Rotation.from_euler("ZYX", [np.arctan2(y, x), np.arctan2(-z, np.hypot(x, y)), 0.0])
    return turn.as_quat()


def pixels(image: Any) -> NDArray[np.uint8]:
    """Return what a camera's message shows, (height, width, 3).

    Raises:
        InputError: it is no picture of three colours.
    """
    size = image.height * image.width * 3
    if len(image.data) != size or not size:
        raise InputError(f"{PICTURE}: {len(image.data)} bytes, needs {size}")
    shape = (image.height, image.width, 3)
    return np.frombuffer(image.data, dtype=np.uint8).reshape(shape).copy()
