"""Pixels that something moving has left, where a method that remembers may still show it."""

from collections import deque

import numpy as np

from voxdepth.types import FloatImage, MaskImage

FRAMES_LATER = 5
"""Ghosts are counted so many frames after a thing was last at a pixel: once for each time that it leaves the pixel."""


class Departures:
    """Follows the frames of a sequence and knows what was at each pixel when a thing was last there."""

    def __init__(self) -> None:
        self._past: deque[FloatImage] = deque(maxlen=FRAMES_LATER)

    def add(self, moving: MaskImage, truth_m: FloatImage) -> FloatImage:
        """Take in the next frame.

        Args:
            moving: Pixels of things that move, shape (H, W).
            truth_m: True depth [m], shape (H, W).

        Returns:
            True depth of the thing that was last at a pixel `FRAMES_LATER` frames ago [m], shape (H, W), float32; 0
            where none was, or where one was there since.
        """
        there_m = np.where(moving, truth_m, np.float32(0)).astype(np.float32)
        departed_m = np.zeros_like(there_m)
        if len(self._past) == FRAMES_LATER:
            first_m, *later_m = self._past
            departed_m = np.where(np.any([*later_m, there_m], axis=0), np.float32(0), first_m)
        self._past.append(there_m)
        return departed_m
