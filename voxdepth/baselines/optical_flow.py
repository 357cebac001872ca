"""Dense optical flow by inverse search of patches, and what lies where the pixels flow to."""

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from ..types import GrayImage

FlowImage = npt.NDArray[np.float32]

SMALLEST_PX = 96
"""Smaller images get a border: OpenCV refuses those below 12 pixels, and crashes on some that are long and narrow."""
LAST_PX = 32767
"""Columns and rows are given to OpenCV in 16 bits."""


class Dis:
    """Inverse search of patches, then variational refinement: Kroeger et al. 2016, DOI 10.1007/978-3-319-46493-0_29.

    The result depends a little on OpenCV's number of threads.
    """

    def __init__(self) -> None:
        self._dis = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_FAST)

    def between(self, start: GrayImage, end: GrayImage) -> FlowImage:
        """Where each pixel of the start is in the end, relative to itself: columns and rows [px].

        The result is finite, of shape (H, W, 2) and float32. The images of shape (H, W) are not changed.
        """
        height, width = start.shape
        flow_px: Any = self._dis.calc(_padded(start), _padded(end), None)  # type: ignore[call-overload]
        return np.ascontiguousarray(flow_px[:height, :width])


def _padded(gray: GrayImage) -> GrayImage:
    """Pad to the minimum size of DIS by repeating the last row and column."""
    below, right = (max(SMALLEST_PX - side, 0) for side in gray.shape)
    return np.pad(gray, ((0, below), (0, right)), mode="edge") if below or right else gray


def landing_of(flow_px: FlowImage) -> npt.NDArray[np.int16]:
    """Column and row of the pixel that each pixel flows to, shape (H, W, 2); outside the image if it leaves it."""
    height, width = flow_px.shape[:2]
    landing = flow_px.copy()
    landing[..., 0] += np.arange(width, dtype=np.float32)
    landing[..., 1] += np.arange(height, dtype=np.float32)[:, None]
    return np.rint(np.clip(landing, -1, np.float32(LAST_PX), out=landing), out=landing).astype(np.int16)


def taken(image: Any, landing: npt.NDArray[np.int16]) -> Any:
    """The pixels of an image at the targets, without interpolation; 0 outside of it."""
    return cv2.remap(image, landing, None, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT)  # type: ignore[call-overload]
