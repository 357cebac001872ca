"""Obstacles that are not there: near depth on the sky, and phantoms that stay long enough to be avoided."""

import cv2
import numpy as np
import numpy.typing as npt

from ..types import FloatImage
from .moving import Share
from .pixels import judged_pixels, require_depth, require_same_shape

PHANTOM_SHARE = 0.5
"""A pixel belongs to a phantom obstacle if its depth is below this share of the true depth."""
PHANTOM_PX = 30
"""Smallest number of connected pixels of a phantom obstacle."""
PHANTOM_FRAMES = 5
"""Number of consecutive frames that a phantom obstacle stays for."""


def near_share(depth_m: FloatImage, truth_m: FloatImage, range_m: float) -> Share:
    """Pixels of the sky that are given a depth below a range, among all pixels of the sky.

    Args:
        depth_m: Depth under test [m], shape (H, W); 0 = invalid, which is not near.
        truth_m: True depth [m]; +inf is the sky, and all else is not counted.
        range_m: The range [m].

    Raises:
        FrameError: The shapes differ, or the depth of the sky is negative, NaN or infinite.
    """
    require_same_shape(depth_m=depth_m, truth_m=truth_m)
    shown_m = depth_m[np.isposinf(truth_m)]
    require_depth(shown_m)
    return Share(hits=int(np.count_nonzero((shown_m > 0) & (shown_m < range_m))), of=shown_m.size)


class Phantoms:
    """Counts phantom obstacles in the frames of a camera that hardly moves.

    A blob is a set of at least `PHANTOM_PX` pixels, connected by sides or corners, that are nearer than half the true
    depth. It continues the blobs of the frame before that it overlaps, and is counted once, when it has stayed for
    `PHANTOM_FRAMES` frames. Blobs that part or join after that are not counted again.
    """

    def __init__(self) -> None:
        self.count = 0
        """Number of phantom obstacles so far."""
        self._ages: npt.NDArray[np.int32] | None = None
        """Number of frames that the blob at each pixel has stayed for, shape (H, W); 0 where there is none."""

    def add(self, depth_m: FloatImage, truth_m: FloatImage) -> None:
        """Add depth and true depth [m] of the next frame, shape (H, W).

        Args:
            depth_m: Depth under test; 0 = invalid, which is no obstacle.
            truth_m: True depth; pixels that are 0, NaN or infinite do not count.

        Raises:
            FrameError: The shapes differ, or the depth of a pixel with a true surface is negative, NaN or infinite.
        """
        before = np.zeros(depth_m.shape, np.int32) if self._ages is None else self._ages
        require_same_shape(depth_m=depth_m, truth_m=truth_m, before=before)
        known = judged_pixels(truth_m, np.ones(truth_m.shape, np.bool_))
        require_depth(depth_m[known])
        near = known & (depth_m > 0) & (depth_m < np.float32(PHANTOM_SHARE) * truth_m)
        n, found, facts, _ = cv2.connectedComponentsWithStats(near.astype(np.uint8), connectivity=8)
        labels = found.astype(np.intp)
        oldest = np.zeros(n, np.int32)
        np.maximum.at(oldest, labels.ravel(), before.ravel())
        ages = np.where(facts[:, cv2.CC_STAT_AREA] >= PHANTOM_PX, oldest + 1, 0).astype(np.int32)
        ages[0] = 0
        self.count += int(np.count_nonzero(ages == PHANTOM_FRAMES))
        self._ages = ages[labels]
