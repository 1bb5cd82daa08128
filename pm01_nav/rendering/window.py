# SPDX-License-Identifier: Apache-2.0
"""A window that shows frames while they are made."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pm01_nav.errors import InputError

if TYPE_CHECKING:
    import pygame

Frame = NDArray[np.uint8]

BORDER = (238, 241, 245)
"""Around a frame whose shape is not the window's."""


class Window:
    """Shows frames on the screen; whoever sits before it may resize or close it."""

    def __init__(self, title: str = "PM01 Navigation") -> None:
        """Prepare a window, which opens with its first frame.

        Raises:
            InputError: pygame is not installed.
        """
        os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
        try:
            import pygame
        except ImportError as error:
            raise InputError("a window needs: pip install 'pm01-nav[viz]'") from error
        self._pygame = pygame
        self._title = title
        self._clock = pygame.time.Clock()
        self._opened = False
        self._closed = False

    @property
    def is_open(self) -> bool:
        """False once somebody closed the window."""
        return not self._closed

    def show(self, frame: Frame, fps: float | None = None) -> bool:
        """Show an RGB frame (height, width, 3) and wait so that ``fps`` is not exceeded.

        Returns whether the window is still open; a frame for a closed one is dropped.

        Raises:
            InputError: there is no screen.
        """
        if self._closed:
            return False
        if not self._opened:
            self._open(frame)
        self._answer_events()
        # Asked for each time: after a resize it is as large as the window is now.
        screen = self._pygame.display.get_surface() if self.is_open else None
        if screen is None:
            return False
        self._paint(screen, self._pygame.surfarray.make_surface(frame.swapaxes(0, 1)))
        self._pygame.display.flip()
        if fps:
            self._clock.tick(fps)
        return True

    def close(self) -> None:
        """Close the window; a second call does nothing."""
        if self._opened and not self._closed:
            self._pygame.display.quit()
        self._closed = True

    def _open(self, frame: Frame) -> None:
        try:
            self._pygame.display.init()
            height, width = frame.shape[:2]
            self._pygame.display.set_mode((width, height), self._pygame.RESIZABLE)
        except self._pygame.error as error:
            raise InputError(f"no screen for a window ({error}); write a video instead") from error
        self._pygame.display.set_caption(self._title)
        self._opened = True

    def _answer_events(self) -> None:
        for event in self._pygame.event.get():
            escape = event.type == self._pygame.KEYDOWN and event.key == self._pygame.K_ESCAPE
            if escape or event.type in (self._pygame.QUIT, self._pygame.WINDOWCLOSE):
                self.close()
                return

    def _paint(self, screen: pygame.Surface, picture: pygame.Surface) -> None:
        """Fit the picture into the window, whatever size that has now, and keep its shape."""
        width, height = screen.get_size()
        scale = min(width / picture.get_width(), height / picture.get_height())
        size = (max(int(picture.get_width() * scale), 1), max(int(picture.get_height() * scale), 1))
        if size != picture.get_size():
            picture = self._pygame.transform.smoothscale(picture, size)
        screen.fill(BORDER)
        screen.blit(picture, ((width - size[0]) // 2, (height - size[1]) // 2))
