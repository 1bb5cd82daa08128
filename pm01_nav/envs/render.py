# SPDX-License-Identifier: Apache-2.0
"""Pictures of an environment, for Gymnasium's ``render_mode``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pm01_nav.errors import InputError
from pm01_nav.task.navigation import NavigationBatch

if TYPE_CHECKING:
    from pm01_nav.rendering.window import Window

RENDER_MODES = ("human", "rgb_array")


class BatchRenderer:
    """Draw one robot of a batch: its world, beams, goal and the way it has come."""

    def __init__(self, batch: NavigationBatch, mode: str, index: int = 0) -> None:
        """Prepare to draw; nothing is loaded before the first picture.

        Raises:
            InputError: the mode is unknown.
        """
        if mode not in RENDER_MODES:
            raise InputError(f"render_mode = {mode!r}: allowed: {', '.join(RENDER_MODES)}")
        self.mode = mode
        self._batch = batch
        self._index = index
        self._trail: list[NDArray[np.float64]] = []
        self._canvas: Any = None
        self._world = -1
        self._window: Window | None = None

    def update(self, *, begin: bool = False) -> None:
        """Note the robot's place, as the first of an episode or the next; show it if asked to."""
        if begin:
            self._trail = []
        self._trail.append(self._batch.simulator.state.pose[self._index, :2].copy())
        if self.mode == "human":
            self._show()

    def frame(self) -> NDArray[np.uint8]:
        """Return a picture (height, width, 3)."""
        from pm01_nav.rendering.canvas import Canvas
        from pm01_nav.rendering.scene import Scene

        simulator, i = self._batch.simulator, self._index
        world = int(simulator.state.world[i])
        if self._canvas is None or world != self._world:
            self._world = world
            self._canvas = Canvas(simulator.pool.worlds[world], simulator.robot)
        distance = simulator.state.goal_polar[i, 0]
        scene = Scene(
            pose=simulator.state.pose[i].copy(),
            goal=simulator.state.goal[i].copy(),
            goal_radius=self._batch.config.goal_radius,
            scan=simulator.scan[i].copy(),
            trail=np.array(self._trail).reshape(-1, 2),
            movers=simulator.movers(i),
            caption=f"{self._batch.config.name}   {distance:.1f} m to the goal",
        )
        return self._canvas.draw(scene)

    def _show(self) -> None:
        from pm01_nav.rendering.window import Window

        if self._window is None:
            self._window = Window()
        self._window.show(self.frame(), fps=1.0 / self._batch.config.control_dt)

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._window is not None:
            self._window.close()
            self._window = None
