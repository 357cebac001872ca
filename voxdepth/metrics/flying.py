"""Flying pixels: depth that hangs in empty space between the near and the far side of a depth edge."""

import cv2
import numpy as np

from ..types import FloatImage
from .moving import Share
from .pixels import require_same_shape

WINDOW_SHARE = 1 / 32
"""Side of the window around a pixel, in widths of the image."""
EDGE, SAME = 1.1, 0.05
"""Ratio of the farthest to the nearest depth of a window from which it holds an edge, and the relative difference up to
which a depth is of a surface."""
NOWHERE_M = 1e9
"""Depth that stands for no surface."""
CHUNK = 4096
STRIDE_PX = 3
"""Stride of the rows and columns whose pixels are judged, because each is compared with all of its window."""


def flying_share(depth_m: FloatImage, reference_m: FloatImage) -> Share:
    """Pixels that hang in empty space, among all pixels with a depth beside a depth edge.

    A pixel hangs if it is between the nearest and the farthest reference depth of the window around it, and not within
    5 % of any of them.

    Args:
        depth_m: Depth under test [m], shape (H, W); 0 = invalid, which is not counted.
        reference_m: True or measured depth [m], same shape; 0, NaN and infinite are unknown.

    Raises:
        FrameError: The shapes differ.
    """
    require_same_shape(depth_m=depth_m, reference_m=reference_m)
    known = (reference_m > 0) & np.isfinite(reference_m)
    radius = max(1, round(WINDOW_SHARE * depth_m.shape[1] / 2))
    window = np.ones((2 * radius + 1,) * 2, np.uint8)
    known_m = np.where(known, reference_m, np.float32(0))
    far_m = np.asarray(cv2.dilate(known_m, window))
    near_m = np.minimum(cv2.erode(np.where(known, reference_m, np.float32(NOWHERE_M)), window), np.float32(NOWHERE_M))
    sampled = np.zeros(depth_m.shape, np.bool_)
    sampled[::STRIDE_PX, ::STRIDE_PX] = True
    beside = sampled & (depth_m > 0) & (far_m > np.float32(EDGE) * near_m)
    between = beside & (depth_m > np.float32(1 + SAME) * near_m) & (depth_m < np.float32(1 - SAME) * far_m)
    padded_m = np.pad(known_m, radius)
    around_m = np.lib.stride_tricks.sliding_window_view(padded_m, window.shape)
    row, col = np.nonzero(between)
    hits = 0
    for first in range(0, len(row), CHUNK):
        place = row[first : first + CHUNK], col[first : first + CHUNK]
        own_m = depth_m[place][:, None, None]
        hits += int(np.count_nonzero((np.abs(around_m[place] - own_m) > np.float32(SAME) * own_m).all(axis=(1, 2))))
    return Share(hits=hits, of=int(np.count_nonzero(beside)))
