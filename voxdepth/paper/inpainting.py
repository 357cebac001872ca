"""Densifying the sparse projection of the fused cloud, by interchangeable methods (paper, RQ3)."""

from collections.abc import Callable, Mapping
from typing import Literal

import cv2
import numpy as np
from pydantic import field_validator, model_validator

from ..geometry import fill_from_nearest
from ..model import Model
from ..networks import load
from ..types import FloatImage

InpaintingName = Literal["dilation", "erosion", "median", "bilinear", "nearest", "convex"]
CONVEX_WINDOW_PX, CONVEX_MULTIPLE_PX = 5, 32
"""Window of the network of `convex`; the sides of its images are multiples of the other number."""


class Inpainting(Model):
    """A method with a square window around each pixel. A pixel stays empty (0) if its whole window is empty."""

    method: InpaintingName = "dilation"
    """`dilation`, the paper's choice, takes the farthest depth of the window, and `erosion` the nearest; `median` and
    `nearest` are filters, `bilinear` interpolates, and `convex` is a network, which needs the extra `learned`."""
    size_px: int = 5
    """Width of the window; odd. A larger one closes wider gaps and blurs more."""

    @field_validator("size_px")
    @classmethod
    def _odd(cls, size_px: int) -> int:
        if size_px < 1 or size_px % 2 == 0:
            raise ValueError("the window must be odd and at least 1 pixel wide")
        return size_px

    @model_validator(mode="after")
    def _window_of_the_network(self) -> "Inpainting":
        if self.method == "convex" and self.size_px != CONVEX_WINDOW_PX:
            raise ValueError(f"the network of convex has a window of {CONVEX_WINDOW_PX} pixels, got {self.size_px}")
        return self

    def prepare(self) -> None:
        """Load what the method needs, or raise a `ConfigError`, see `networks.load`."""
        if self.method == "convex":
            load("convex")

    def fill(self, sparse_m: FloatImage) -> FloatImage:
        """Dense depth [m] of sparse depth [m], both of shape (H, W); 0 = unknown."""
        return _METHODS[self.method](sparse_m, self.size_px)


def dilation(sparse_m: FloatImage, size_px: int) -> FloatImage:
    """Every pixel, filled or not, takes the maximum of its window: paper, Eq. dilate.

    It moves every depth edge by half the window, the far side over the near one.
    """
    dense: FloatImage = cv2.dilate(sparse_m, np.ones((size_px, size_px), np.uint8))  # type: ignore[assignment]
    return dense


def erosion(sparse_m: FloatImage, size_px: int) -> FloatImage:
    """Every pixel takes the minimum of its window: paper, Eq. erosion, over filled pixels.

    With the empty ones, as printed, the minimum of nearly every window of a sparse image would be 0.
    """
    largest = np.finfo(np.float32).max  # which OpenCV also assumes outside the image
    far_m = np.where(sparse_m > 0, sparse_m, largest)
    dense_m = cv2.erode(far_m, np.ones((size_px, size_px), np.uint8))
    return np.where(dense_m < largest, dense_m, np.float32(0))


def median(sparse_m: FloatImage, size_px: int) -> FloatImage:
    """Every pixel takes the lower median of the filled pixels of its window."""
    height, width = sparse_m.shape
    far_m = np.where(sparse_m > 0, sparse_m, np.float32(np.inf))
    padded_m = np.pad(far_m, size_px // 2, constant_values=np.inf)
    dense_m = np.empty_like(sparse_m)
    for row in range(height):  # by rows, for the windows of a whole image would be 25 images
        windows_m = np.lib.stride_tricks.sliding_window_view(padded_m[row : row + size_px], size_px, axis=1)
        sorted_m = np.sort(windows_m.transpose(1, 0, 2).reshape(width, -1), axis=1)
        middle = np.maximum(np.isfinite(sorted_m).sum(axis=1) - 1, 0) // 2
        dense_m[row] = sorted_m[np.arange(width), middle]
    dense_m[np.isinf(dense_m)] = 0
    return dense_m


def bilinear(sparse_m: FloatImage, size_px: int) -> FloatImage:
    """Empty pixels take the mean of the filled ones of their window, weighted by a tent in rows and in columns.

    On a lattice of filled pixels `size_px // 2 + 1` apart this is bilinear interpolation.
    """
    reach = size_px // 2
    tent = 1 - np.abs(np.arange(-reach, reach + 1, dtype=np.float32)) / (reach + 1)
    total = [
        cv2.sepFilter2D(image, cv2.CV_32F, tent, tent, borderType=cv2.BORDER_CONSTANT)
        for image in (sparse_m, (sparse_m > 0).astype(np.float32))
    ]
    mean_m = np.divide(total[0], total[1], out=np.zeros_like(sparse_m), where=total[1] > 0)
    return np.where(sparse_m > 0, sparse_m, mean_m)


def nearest(sparse_m: FloatImage, size_px: int) -> FloatImage:
    """Empty pixels take the nearest filled pixel within half the window."""
    return fill_from_nearest(sparse_m, size_px // 2)


def convex(sparse_m: FloatImage, size_px: int) -> FloatImage:
    """Every pixel takes a mean of the filled pixels of its window, whose weights a network predicts.

    This is the convex upsampling of Teed and Deng 2020, which the paper tries, for a sparse image in place of a coarse
    one. The window is always `CONVEX_WINDOW_PX` wide, which `Inpainting` requires of the size. The network sees depth
    in units of the mean, so that a scene twice as far is filled twice as far.

    Raises:
        ConfigError: The network cannot be loaded, see `networks.load`.
    """
    network, filled = load("convex"), np.count_nonzero(sparse_m)
    if not filled:
        return sparse_m.copy()
    scale_m = np.float32(sparse_m.sum(dtype=np.float64) / filled)
    height, width = sparse_m.shape
    below, right = (-side % CONVEX_MULTIPLE_PX for side in sparse_m.shape)
    padded = np.pad(sparse_m / scale_m, ((0, below), (0, right)))
    (dense,) = network.run(padded[None, None])
    return np.ascontiguousarray(dense[0, 0, :height, :width] * scale_m)


_METHODS: Mapping[InpaintingName, Callable[[FloatImage, int], FloatImage]] = {
    "dilation": dilation, "erosion": erosion, "median": median, "bilinear": bilinear, "nearest": nearest,
    "convex": convex,
}  # fmt: skip
