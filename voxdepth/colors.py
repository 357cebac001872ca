"""Depth as false colours: near red, far blue, holes black, the same in all pictures, pages and recordings."""

import cv2
import numpy as np
import numpy.typing as npt

from .types import FloatImage

FAR_M = 25.0
"""Depth at the blue end of the colours."""
FAR_INDEX = 25
"""Index of the farthest depth in the colour map; lower ones look like the black of holes."""


def colored(depth_m: FloatImage, far_m: float = FAR_M) -> npt.NDArray[np.uint8]:
    """Return depth in colours, near red, `far_m` > 0 and beyond blue, holes black; shape (H, W, 3), BGR.

    The depth [m] has the shape (H, W) and is infinite where there is no surface.
    """
    scaled = FAR_INDEX + (255 - FAR_INDEX) * (1 - np.sqrt(np.minimum(depth_m, far_m) / far_m))
    image = cv2.applyColorMap(scaled.astype(np.uint8), cv2.COLORMAP_TURBO).astype(np.uint8)
    image[depth_m <= 0] = 0
    return image
