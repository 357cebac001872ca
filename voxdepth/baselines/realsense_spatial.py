"""librealsense's spatial filter on disparity: recursive smoothing along rows and columns that stops at edges.

It is the recursive filter of the domain transform (Gastal and Oliveira 2011, DOI 10.1145/2010324.1964964) with an edge
threshold instead of a weight by distance. Parameters and rounding are those of librealsense 2.59
(`src/proc/spatial-filter`), which the tests compare with bit by bit.
"""

import cv2
import numpy as np
import warp as wp
from pydantic import Field

from ..model import Model
from ..paper import kernels
from ..types import FloatImage
from . import realsense_kernels


class SpatialFilter(Model):
    """Smooths every row to the right and to the left, then every column down and up, and all of it again."""

    alpha: float = Field(0.5, ge=0.25, le=1)
    """Weight of a pixel against what came before it. 1 changes nothing, less smooths more."""
    delta: int = Field(20, ge=1, le=50)
    """Step between neighbours that is an edge, in 1/32 px of disparity. More smooths over larger steps."""
    iterations: int = Field(2, ge=1, le=5)
    """How often rows and columns are gone through. More smooths wider."""

    def smooth(self, disparity: FloatImage) -> FloatImage:
        """A smoothed copy of disparity [1/32 px], shape (H, W); holes (0) stay, and nothing is mixed across them."""
        rows = np.array(disparity, order="C")
        cols = np.empty(rows.shape[::-1], np.float32)
        for _ in range(self.iterations):
            smooth_rows_warp(rows, alpha=self.alpha, delta=self.delta)
            cv2.transpose(rows, dst=cols)
            smooth_rows_warp(cols, alpha=self.alpha, delta=self.delta)
            cv2.transpose(cols, dst=rows)
        return rows


def smooth_rows_warp(image: FloatImage, *, alpha: float, delta: float) -> None:
    """Smooth each row of a contiguous image to the right and then to the left, in place, by the Warp kernel."""
    wp.launch(
        realsense_kernels.smooth_rows,
        len(image),
        inputs=[alpha, delta],
        outputs=[kernels.view(image, wp.float32)],
        device="cpu",
    )


def smooth_rows_numpy(image: FloatImage, *, alpha: float, delta: float) -> None:
    """Smooth each row of an image to the right and then to the left, in place: the twin of `smooth_rows_warp`."""
    weight = np.float32(alpha)
    for cols in (image.T, image.T[::-1]):
        state = before = cols[0].copy()
        for col in cols[1:]:
            value = col.copy()
            near = (before > 0) & (value > 0) & (np.abs(before - value) < delta)
            state = np.where(near, value * weight + state * (np.float32(1) - weight), value)
            col[:] = state
            before = value
