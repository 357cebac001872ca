"""Depth and sources as colours, the same in all pictures, pages and recordings: near red, far blue, holes black."""

from collections.abc import Iterable

import cv2
import numpy as np
import numpy.typing as npt

from .types import FloatImage, Source

FAR_M = 25.0
"""Depth at the blue end of the colours where nothing is known of the scene."""
FAR_ENDS_M = (1.0, 2.0, 5.0, 10.0, FAR_M)
"""Depths that the blue end of the colours may stand for: few, so that pictures can be compared by eye."""
BEYOND_SHARE = 0.02
"""Largest share of the depths beyond the blue end: some pixels are always wrong by far."""
FAR_INDEX = 25
"""Index of the farthest depth in the colour map; lower ones look like the black of holes."""
ERROR_END = 0.1
"""Relative error at the ends of its colours."""
ERROR_STEP = 0.02
"""Step of the relative error from one colour to the next."""
UNKNOWN_GRAY = 160
"""Gray value where the error is unknown."""
SOURCE_COLORS = {
    Source.INVALID: (0, 0, 0),
    Source.SENSOR: (190, 190, 190),
    Source.MEMORY: (30, 120, 200),
    Source.INPAINTED: (240, 160, 40),
}
"""Colour of a pixel by its source, RGB: black, gray, blue, orange."""


def far_end_m(depths_m: Iterable[FloatImage], beyond_share: float = BEYOND_SHARE) -> float:
    """Return the least of `FAR_ENDS_M` that nearly all depths of a scene are within, or the largest; `FAR_M` for none.

    The depths [m] are images of the shape (H, W), 0 where invalid and infinite where there is no surface. A share of
    them may lie beyond.
    """
    n, beyond = 0, np.zeros(len(FAR_ENDS_M))
    for depth_m in depths_m:
        known_m = depth_m[(depth_m > 0) & np.isfinite(depth_m)]
        n += known_m.size
        beyond += [np.count_nonzero(known_m > end_m) for end_m in FAR_ENDS_M]
    fitting = [end_m for end_m, count in zip(FAR_ENDS_M, beyond, strict=True) if n and count <= beyond_share * n]
    return min(fitting, default=FAR_M)


def colored(depth_m: FloatImage, far_m: float = FAR_M) -> npt.NDArray[np.uint8]:
    """Return depth in colours, near red, `far_m` > 0 and beyond blue, holes black; shape (H, W, 3), BGR.

    The depth [m] has the shape (H, W) and is infinite where there is no surface.
    """
    scaled = FAR_INDEX + (255 - FAR_INDEX) * (1 - np.sqrt(np.minimum(depth_m, far_m) / far_m))
    image = cv2.applyColorMap(scaled.astype(np.uint8), cv2.COLORMAP_TURBO).astype(np.uint8)
    image[depth_m <= 0] = 0
    return image


def error_colored(depth_m: FloatImage, reference_m: FloatImage) -> npt.NDArray[np.uint8]:
    """Return the relative error of depth in colours, too near red, too far blue; shape (H, W, 3), BGR.

    Correct pixels are white, those that are `ERROR_END` or more off have the full colour, those without depth are
    black, and those without a reference gray. Both depths [m] have the shape (H, W), 0 where they are unknown.
    """
    known = (reference_m > 0) & np.isfinite(reference_m)
    ratio = np.divide(depth_m, reference_m, out=np.ones_like(reference_m), where=known)
    error = np.clip(np.rint((ratio - 1) / ERROR_STEP) * ERROR_STEP / ERROR_END, -1, 1)
    removed = np.stack([np.maximum(-error, 0), np.abs(error), np.maximum(error, 0)], axis=-1)
    image: npt.NDArray[np.uint8] = np.rint(255 * (1 - removed)).astype(np.uint8)
    image[depth_m <= 0] = 0
    image[~known] = UNKNOWN_GRAY
    return image
