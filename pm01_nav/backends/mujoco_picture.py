# SPDX-License-Identifier: Apache-2.0
"""Pictures of MuJoCo's robots, drawn without a screen."""

from __future__ import annotations

from typing import Any

import mujoco as mujoco_package
import numpy as np
from numpy.typing import NDArray

from pm01_nav.backends.engine import View
from pm01_nav.errors import InputError

mujoco: Any = mujoco_package
"""Type checkers see nothing of what is compiled."""

GOAL = (0.18, 0.68, 0.36, 0.6)
"""Red, green, blue and opacity of the goal's disc."""
MOST_GEOMS = 20_000


def draw(model: Any, data: Any, view: View) -> NDArray[np.uint8]:
    """Return a picture of a model in the state of ``data``, (height, width, 3).

    Raises:
        InputError: OpenGL cannot be had without a screen.
    """
    width, height = view.size
    mujoco.mj_forward(model, data)
    try:
        renderer = mujoco.Renderer(model, height, width, max_geom=MOST_GEOMS)
    except Exception as error:  # whatever the platform's OpenGL may raise
        raise InputError(
            "render: MuJoCo finds no OpenGL to draw with; install EGL (Debian: libegl1, "
            "libgl1-mesa-dri) and set MUJOCO_GL=egl"
        ) from error
    with renderer:
        renderer.update_scene(data, _camera(view), _options())
        _add_goal(renderer.scene, view)
        return renderer.render().copy()


def _camera(view: View) -> Any:
    camera = mujoco.MjvCamera()
    offset = np.array(view.eye) - np.array(view.target)
    camera.lookat[:] = view.target
    camera.distance = float(np.linalg.norm(offset))
    # Where the camera looks to, not where it stands.
    camera.azimuth = float(np.degrees(np.arctan2(-offset[1], -offset[0])))
    camera.elevation = -float(np.degrees(np.arcsin(offset[2] / camera.distance)))
    return camera


def _options() -> Any:
    options = mujoco.MjvOption()
    options.geomgroup[:] = 1
    return options


def _add_goal(scene: Any, view: View) -> None:
    geom = scene.geoms[scene.ngeom]
    mujoco.mjv_initGeom(
        geom,
        mujoco.mjtGeom.mjGEOM_CYLINDER,
        np.array([view.goal_radius, 0.005, 0.0]),
        np.array([*view.goal, 0.005]),
        np.eye(3).ravel(),
        np.array(GOAL, dtype=np.float32),
    )
    scene.ngeom += 1
