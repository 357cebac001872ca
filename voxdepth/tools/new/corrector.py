"""A depth corrector of your own.

Compare it with others on a recording: voxdepth evaluate --data RECORDING --methods raw,temporal,NAME:Corrector
Fly by it in the testbed: voxdepth run city --drones 3 --corrector NAME:Corrector
"""

import cv2
import numpy as np

from voxdepth import CorrectedDepth, DepthCorrector, Frame, Intrinsics


class Corrector(DepthCorrector):
    """Fills small holes with the median of what is around them."""

    uses_gray = False  # True for one that looks at frame.gray.
    latency_s = 0.001  # The simulated seconds that a frame takes in flight.

    def __init__(self, intrinsics: Intrinsics) -> None: ...

    def process(self, frame: Frame) -> CorrectedDepth:
        """Correct one frame: `frame.depth_m` is float32 [m] of shape (H, W), where 0 is a hole."""
        around_m = cv2.medianBlur(frame.depth_m, 5)
        filled_m = np.where(frame.depth_m > 0, frame.depth_m, around_m)  # Your method.
        return CorrectedDepth.of(frame, np.asarray(filled_m, np.float32))
