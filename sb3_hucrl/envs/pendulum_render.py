"""Renders the pendulum in a window or as an array."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pygame

SIZE = 480
WHITE, GREY, BLACK, RED, BLUE = (255, 255, 255), (200, 200, 200), (30, 30, 30), (204, 77, 77), (60, 110, 200)


class PendulumRenderer:
    """
    Draws frames for both render modes. A window opens at the first call of :meth:`show`.

    :param fps: frames per second of the window
    """

    def __init__(self, fps: int) -> None:
        self._fps = fps
        self._surface = pygame.Surface((SIZE, SIZE))
        self._window: pygame.Surface | None = None
        self._clock = pygame.time.Clock()

    def _draw(self, theta: float, torque: float) -> None:
        centre, length = SIZE // 2, 0.36 * SIZE
        tip = (centre + length * math.sin(theta), centre - length * math.cos(theta))
        self._surface.fill(WHITE)
        pygame.draw.circle(self._surface, GREY, (centre, centre), int(length), width=1)
        pygame.draw.line(self._surface, RED, (centre, centre), tip, width=14)
        pygame.draw.circle(self._surface, RED, tip, 20)
        pygame.draw.circle(self._surface, BLACK, (centre, centre), 8)
        # A bar at the bottom shows the torque; positive is clockwise, and to the right.
        bar = pygame.Rect(0, SIZE - 24, int(abs(torque) * SIZE / 2), 12)
        bar.left = centre if torque > 0 else centre - bar.width
        pygame.draw.rect(self._surface, BLUE, bar)
        pygame.draw.line(self._surface, BLACK, (centre, SIZE - 28), (centre, SIZE - 8))

    def frame(self, theta: float, torque: float) -> npt.NDArray[np.uint8]:
        """
        :param theta: angle from upright, in rad
        :param torque: in [-1, 1]
        :return: RGB image, shape (480, 480, 3)
        """
        self._draw(theta, torque)
        return np.ascontiguousarray(pygame.surfarray.array3d(self._surface).swapaxes(0, 1))

    def show(self, theta: float, torque: float) -> None:
        """
        Draw in the window and wait until the next frame is due.

        :param theta: angle from upright, in rad
        :param torque: in [-1, 1]
        """
        if self._window is None:
            pygame.display.init()
            pygame.display.set_caption("HUCRL-Pendulum-v0")
            self._window = pygame.display.set_mode((SIZE, SIZE))
        self._draw(theta, torque)
        self._window.blit(self._surface, (0, 0))
        pygame.event.pump()
        pygame.display.flip()
        self._clock.tick(self._fps)

    def close(self) -> None:
        """Close the window if it is open."""
        if self._window is not None:
            pygame.display.quit()
            self._window = None
