"""What a comparator without a template of its own returns: source and confidence follow from the depth alone."""

import numpy as np

from ..types import CorrectedDepth, FloatImage, Frame, Source

CONFIDENCE_INPAINTED = 0.5
"""Trust in a depth that the sensor did not see: between a measured one (1) and none (0)."""


def inferred(frame: Frame, depth_m: FloatImage) -> CorrectedDepth:
    """A result whose pixels come from the sensor where the frame had a depth, and are filled in elsewhere.

    Args:
        frame: What was corrected.
        depth_m: The corrected depth [m], shape (H, W), float32, 0 = invalid; kept, so not the frame's own array.

    Returns:
        Source SENSOR and confidence 1 where both have a depth, INPAINTED and 0.5 where only the result has one, INVALID
        and 0 elsewhere, also where a filter took the frame's depth away.
    """
    seen, valid = frame.depth_m > 0, depth_m > 0
    source = np.where(seen, np.uint8(Source.SENSOR), np.uint8(Source.INPAINTED))
    confidence = np.where(seen, np.float32(1), np.float32(CONFIDENCE_INPAINTED))
    source *= valid
    confidence *= valid
    return CorrectedDepth(depth_m=depth_m, source=source, confidence=confidence)
