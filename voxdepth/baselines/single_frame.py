"""The base of all baselines, and those that correct every frame by itself.

The latter are the raw depth, a median, and OpenCV's inpainting.
"""

from abc import ABC, abstractmethod

import cv2
import numpy as np

from ..types import CorrectedDepth, FloatImage, Frame, Intrinsics

MEDIAN_PX = 5
"""Width of the window of the median."""
RADIUS_PX = 3.0
"""Neighbourhood of a pixel that is inpainted; a larger one is smoother and slower."""
NEAREST_M = 0.1
"""Depths below this count as this where they are spread: they set the finest step of everything else."""
FULL_SCALE = 65535
"""16-bit images are inpainted as they are; of float32 ones OpenCV rounds what it fills to integers."""
FARTHEST_M = np.finfo(np.float32).max / np.float32(FULL_SCALE + 1)
"""Depths beyond this count as this where they set the finest step: times `FULL_SCALE` it is a number of 32 bits."""


class Baseline(ABC):
    """A corrector whose source and confidence follow from the depth alone.

    Args:
        intrinsics: Intrinsics of the camera; None where frames may have any size, if the method allows that.
    """

    uses_gray = False

    def __init__(self, intrinsics: Intrinsics | None = None) -> None:
        self._intrinsics = intrinsics

    def process(self, frame: Frame) -> CorrectedDepth:
        """Correct a frame, see `CorrectedDepth.of`.

        Raises:
            FrameError: The frame has another size than the camera.
        """
        if self._intrinsics is not None:
            frame.require_shape(self._intrinsics.shape)
        return CorrectedDepth.of(frame, self._corrected(frame))

    def reset(self) -> None:  # noqa: B027
        """Forget earlier frames, if the method keeps any."""

    @abstractmethod
    def _corrected(self, frame: Frame) -> FloatImage:
        """Return the corrected depth [m], shape (H, W), in a new array; 0 = invalid."""


class Raw(Baseline):
    """Returns every frame unchanged."""

    def _corrected(self, frame: Frame) -> FloatImage:
        return frame.depth_m.copy()


class Median(Baseline):
    """Every pixel takes the median of its window: paper, Eq. median. Invalid pixels count as 0, borders repeat.

    Holes that fill less than half a window are closed, and depths that fill less than half of one are lost.
    """

    def _corrected(self, frame: Frame) -> FloatImage:
        return cv2.medianBlur(frame.depth_m, MEDIAN_PX)  # type: ignore[return-value]


class Telea(Baseline):
    """Fills every hole from its boundary inwards with weighted means: Telea 2004, DOI 10.1080/10867651.2004.10487596.

    Valid pixels stay, and so does an image without any.

    It works on the inverse of depth, in which stereo errors are alike at any range. The nearest depth of a frame is the
    largest of 16 bits: one step is 0.2 mm at 2 m and 11 mm at 15 m if that nearest depth is 0.3 m.
    """

    _method = cv2.INPAINT_TELEA

    def _corrected(self, frame: Frame) -> FloatImage:
        depth_m = frame.depth_m
        valid = depth_m > 0
        if valid.all() or not valid.any():
            return depth_m.copy()
        scale_m = np.float32(FULL_SCALE) * np.clip(depth_m[valid].min(), np.float32(NEAREST_M), FARTHEST_M)
        inverse = scale_m / np.where(valid, np.maximum(depth_m, np.float32(NEAREST_M)), np.float32(np.inf))
        holed = np.rint(np.clip(inverse, 1, FULL_SCALE)).astype(np.uint16)
        rows, columns = depth_m.shape
        twice = ((0, rows == 1), (0, columns == 1))  # Of a single row or column OpenCV reads beyond the image.
        mask = np.pad((~valid).astype(np.uint8), twice, mode="edge")
        whole = cv2.inpaint(np.pad(holed, twice, mode="edge"), mask, RADIUS_PX, self._method)[:rows, :columns]
        return np.where(valid, depth_m, scale_m / np.maximum(whole, 1).astype(np.float32))


class NavierStokes(Telea):
    """Continues lines of equal depth instead: Bertalmio et al. 2001, DOI 10.1109/CVPR.2001.990497."""

    _method = cv2.INPAINT_NS
