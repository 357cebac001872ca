"""Holes filled by OpenCV's inpainting, single-frame and without the gray image."""

from typing import Literal

import cv2
import numpy as np

from ..errors import ConfigError
from ..types import CorrectedDepth, FloatImage, Frame, Intrinsics
from .inferred import inferred

Method = Literal["telea", "navier_stokes"]

METHODS: dict[Method, int] = {"telea": cv2.INPAINT_TELEA, "navier_stokes": cv2.INPAINT_NS}
"""Telea 2004 (DOI 10.1080/10867651.2004.10487596) and Bertalmio et al. 2001 (DOI 10.1109/CVPR.2001.990497)."""

NEAREST_M = 0.1
"""Depths below this count as this where they are spread: they set the finest step of everything else."""
FULL_SCALE = 65535
"""16-bit images are inpainted as they are; of float32 ones OpenCV rounds what it fills to integers."""


class OpenCvInpaint:
    """Fills every hole from its rim; valid pixels stay.

    Works on the inverse of depth, in which stereo errors are alike at any range, with the nearest depth of a frame as
    the largest of 16 bits: one step is 0.2 mm at 2 m and 11 mm at 15 m if that nearest depth is 0.3 m.
    """

    uses_gray = False

    def __init__(self, intrinsics: Intrinsics, *, method: Method = "telea", radius_px: float = 3.0) -> None:
        """A filler for one camera.

        Args:
            intrinsics: Not needed: a baseline would only scale what is inpainted.
            method: `telea` marches inwards with weighted means, `navier_stokes` goes on along lines of equal depth.
            radius_px: Neighbourhood of a pixel that is filled; a larger one is smoother and slower.

        Raises:
            ConfigError: There is no such method, or the radius is not positive.
        """
        if method not in METHODS:
            raise ConfigError(f"expected one of the inpainting methods {', '.join(METHODS)}, got {method!r}")
        if not 0 < radius_px < np.inf:
            raise ConfigError(f"radius_px must be positive, got {radius_px}")
        self._method = METHODS[method]
        self._radius_px = radius_px

    def process(self, frame: Frame) -> CorrectedDepth:
        """The frame without holes; one without any valid pixel stays as it is."""
        return inferred(frame, self._filled(frame.depth_m))

    def reset(self) -> None:
        """Nothing is remembered."""

    def _filled(self, depth_m: FloatImage) -> FloatImage:
        """Depth [m], shape (H, W), of an image of its own."""
        valid = depth_m > 0
        if valid.all() or not valid.any():
            return depth_m.copy()
        scale_m = np.float32(FULL_SCALE) * max(depth_m[valid].min(), np.float32(NEAREST_M))
        inverse = np.where(valid, scale_m / np.maximum(depth_m, np.float32(NEAREST_M)), np.float32(0))
        holed = np.rint(np.clip(inverse, 1, FULL_SCALE)).astype(np.uint16)
        whole = cv2.inpaint(holed, (~valid).astype(np.uint8), self._radius_px, self._method)
        return np.where(valid, depth_m, scale_m / np.maximum(whole, 1).astype(np.float32))
