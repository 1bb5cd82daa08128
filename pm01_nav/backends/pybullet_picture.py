# SPDX-License-Identifier: Apache-2.0
"""Pictures of PyBullet's robots, drawn by its own software renderer: no screen, no OpenGL."""

from __future__ import annotations

import numpy as np
import pybullet as bullet
from numpy.typing import NDArray

from pm01_nav.backends.engine import View

FIELD_OF_VIEW = 45.0
"""From top to bottom [deg], as MuJoCo has it."""
NEAR, FAR = 0.05, 60.0
"""What is nearer or farther is not drawn [m]."""
GOAL = (0.18, 0.68, 0.36, 1.0)


def draw(client: int, origin: NDArray[np.float64], view: View) -> NDArray[np.uint8]:
    """Return a picture (height, width, 3) of the world that begins at ``origin`` (3,) [m]."""
    width, height = view.size
    marker = bullet.createMultiBody(
        0,
        -1,
        bullet.createVisualShape(
            bullet.GEOM_CYLINDER,
            radius=view.goal_radius,
            length=0.01,
            rgbaColor=GOAL,
            physicsClientId=client,
        ),
        np.add(origin, [*view.goal, 0.005]).tolist(),
        physicsClientId=client,
    )
    try:
        camera = bullet.computeViewMatrix(
            (origin + view.eye).tolist(), (origin + view.target).tolist(), (0, 0, 1)
        )
        lens = bullet.computeProjectionMatrixFOV(FIELD_OF_VIEW, width / height, NEAR, FAR)
        drawn = bullet.getCameraImage(
            width,
            height,
            camera,
            lens,
            lightDirection=(-1.0, -2.0, 4.0),
            renderer=bullet.ER_TINY_RENDERER,
            physicsClientId=client,
        )
    finally:
        bullet.removeBody(marker, physicsClientId=client)
    return np.array(drawn[2], dtype=np.uint8).reshape(height, width, 4)[..., :3].copy()
