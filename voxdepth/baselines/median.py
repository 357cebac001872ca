"""The paper's filter against flicker alone, without a template: a median of the raw depth."""

from typing import Literal

import cv2

from ..errors import ConfigError
from ..types import CorrectedDepth, FloatImage, Frame
from .inferred import inferred

SIZES_PX = (3, 5)


class Median:
    """Every pixel takes the median of its window: paper, Eq. median. Invalid pixels count as 0, borders repeat.

    Holes that fill less than half a window are closed, and depths that fill less than half of one are lost.

    Args:
        size_px: Width of the window, 3 or 5. More smooths more.

    Raises:
        ConfigError: The window has another width.
    """

    uses_gray = False

    def __init__(self, *, size_px: Literal[3, 5] = 5) -> None:
        if size_px not in SIZES_PX:
            raise ConfigError(f"the median's size_px must be 3 or 5, got {size_px}")
        self._size_px = size_px

    def process(self, frame: Frame) -> CorrectedDepth:
        """The filtered frame; a pixel that was a hole and is none now has source INPAINTED."""
        depth_m: FloatImage = cv2.medianBlur(frame.depth_m, self._size_px)  # type: ignore[assignment]
        return inferred(frame, depth_m)

    def reset(self) -> None:
        """Nothing is remembered."""
