"""A corrector in a package of its own."""

import cv2
import numpy as np

from voxdepth import CorrectedDepth, DepthCorrector, Frame, Intrinsics


class WideMedian(DepthCorrector):
    """A median of 5x5 pixels, of each frame by itself."""

    uses_gray = False
    latency_s = 0.001  # The simulated time of a frame in missions.

    def __init__(self, intrinsics: Intrinsics) -> None: ...

    def process(self, frame: Frame) -> CorrectedDepth:
        """Correct one frame. Every fill gets the confidence 0.5; give probabilities if a drone is to fly by them."""
        return CorrectedDepth.of(frame, np.asarray(cv2.medianBlur(frame.depth_m, 5), np.float32))
