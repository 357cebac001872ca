"""What the code published with the paper calls RealSense hole filling: a maximum of five neighbours, everywhere."""

import cv2
import numpy as np

from ..types import CorrectedDepth, FloatImage, Frame
from .inferred import inferred

MEDIAN_PX = 5
NEIGHBOURS = ((0, 1), (1, 0), (1, 1), (0, -1), (1, -1))
"""Shifts (rows, columns) that bring them here: left, above, above left, right, above right."""


class AuthorsMax:
    """The "RealSense" of the paper's authors, named so, for comparison with their figures. It is not librealsense's.

    Their `utils/realsenseHoleFilling.py` (repository Akanksha-Dixit/Voxdepthcode) takes a 5 x 5 median and then gives
    every pixel, measured or not, the maximum of its neighbours on the left, on the right and in the row above, its own
    value left out. librealsense looks below instead of to the right, only fills holes, and has no median. As there, the
    first row and column take their missing neighbours from the opposite side, and the last row and column, where the
    authors leave their marker of invalid pixels, are invalid.
    """

    uses_gray = False

    def process(self, frame: Frame) -> CorrectedDepth:
        """The filtered frame; a pixel that was a hole and is none now has source INPAINTED."""
        median_m: FloatImage = cv2.medianBlur(frame.depth_m, MEDIAN_PX)  # type: ignore[assignment]
        largest_m = np.zeros_like(median_m)
        for shift in NEIGHBOURS:
            np.maximum(largest_m, np.roll(median_m, shift, axis=(0, 1)), out=largest_m)
        largest_m[-1] = 0
        largest_m[:, -1] = 0
        return inferred(frame, largest_m)

    def reset(self) -> None:
        """Nothing is remembered."""
