"""What makes a sparse projection dense, by interchangeable methods: the rivals of dilation in RQ3.

They stand here and not in the library, whose method dilates: nothing but this comparison uses them.
"""

from pathlib import Path

import cv2
import numpy as np

from voxdepth.networks import has_runtime, load
from voxdepth.paper.method import Inpaint, dilated
from voxdepth.types import FloatImage

WINDOW_PX, MULTIPLE_PX = 5, 32
"""Window of all methods, and what the sides of the network's images are multiples of."""
NETWORKS = Path(__file__).parents[2] / "data" / "networks"


def dilation(sparse_m: FloatImage) -> FloatImage:
    """Give every pixel, filled or not, the farthest depth of its window: the paper's choice."""
    return dilated(sparse_m, WINDOW_PX)


def erosion(sparse_m: FloatImage) -> FloatImage:
    """Give every pixel the nearest depth of its window: paper, Eq. erosion, over filled pixels.

    With the empty ones, as printed, the minimum of nearly every window of a sparse image would be 0.
    """
    largest = np.finfo(np.float32).max  # which OpenCV also assumes outside the image
    far_m = np.where(sparse_m > 0, sparse_m, largest)
    dense_m = cv2.erode(far_m, np.ones((WINDOW_PX, WINDOW_PX), np.uint8))
    return np.where(dense_m < largest, dense_m, np.float32(0))


def bilinear(sparse_m: FloatImage) -> FloatImage:
    """Give empty pixels the mean of the filled ones of their window, weighted by a tent in rows and in columns.

    On a lattice of filled pixels `WINDOW_PX // 2 + 1` apart this is bilinear interpolation.
    """
    reach = WINDOW_PX // 2
    tent = 1 - np.abs(np.arange(-reach, reach + 1, dtype=np.float32)) / (reach + 1)
    total_m, weight = (
        cv2.sepFilter2D(image, cv2.CV_32F, tent, tent, borderType=cv2.BORDER_CONSTANT)
        for image in (sparse_m, (sparse_m > 0).astype(np.float32))
    )
    mean_m = np.divide(total_m, weight, out=np.zeros_like(sparse_m), where=weight > 0)
    return np.where(sparse_m > 0, sparse_m, mean_m)


def convex(sparse_m: FloatImage) -> FloatImage:
    """Give every pixel a mean of the filled pixels of its window, whose weights a network predicts.

    This is the convex upsampling of Teed and Deng 2020, which the paper tries, for a sparse image in place of a coarse
    one. The network, which is ours, sees depth in units of the mean, so that a scene twice as far is filled twice as
    far.

    Raises:
        ConfigError: The network cannot be loaded, see `networks.load`.
    """
    network, filled = load("convex", NETWORKS), np.count_nonzero(sparse_m)
    if not filled:
        return sparse_m.copy()
    scale_m = np.float32(sparse_m.sum(dtype=np.float64) / filled)
    height, width = sparse_m.shape
    below, right = (-side % MULTIPLE_PX for side in sparse_m.shape)
    padded = np.pad(sparse_m / scale_m, ((0, below), (0, right)))
    (dense,) = network.run(padded[None, None])
    return np.ascontiguousarray(dense[0, 0, :height, :width] * scale_m)


_METHODS: dict[str, Inpaint] = {"dilation": dilation, "bilinear": bilinear, "convex": convex, "erosion": erosion}
INPAINTINGS = {name: method for name, method in _METHODS.items() if method is not convex or has_runtime()}
"""By the paper's name; `convex` needs the extra `learned`."""
