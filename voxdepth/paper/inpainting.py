"""Densifying the sparse projection of the fused cloud, by interchangeable methods (paper, RQ3)."""

from typing import Annotated, Literal

import cv2
import numpy as np
from pydantic import Field, field_validator

from ..geometry import fill_from_nearest
from ..model import Model
from ..types import FloatImage


class _Window(Model):
    """A method with a square window around each pixel. A pixel stays empty (0) if its whole window is empty."""

    size_px: int = 5
    """Width of the window; odd. A larger one closes wider gaps and blurs more."""

    @field_validator("size_px")
    @classmethod
    def _odd(cls, size_px: int) -> int:
        if size_px < 1 or size_px % 2 == 0:
            raise ValueError("the window must be odd and at least 1 pixel wide")
        return size_px

    @property
    def _reach_px(self) -> int:
        return self.size_px // 2


class Dilation(_Window):
    """Every pixel, filled or not, takes the maximum of its window: paper, Eq. dilate, and its choice.

    Moves every depth edge by half the window, the far side over the near one.
    """

    method: Literal["dilation"] = "dilation"

    def fill(self, sparse_m: FloatImage) -> FloatImage:
        """Dense depth [m] of sparse depth [m], both of shape (H, W); 0 = unknown."""
        dense: FloatImage = cv2.dilate(sparse_m, np.ones((self.size_px, self.size_px), np.uint8))  # type: ignore[assignment]
        return dense


class Erosion(_Window):
    """Every pixel takes the minimum of its window: paper, Eq. erosion, over filled pixels.

    With the empty ones, as printed, the minimum of nearly every window of a sparse image would be 0.
    """

    method: Literal["erosion"] = "erosion"

    def fill(self, sparse_m: FloatImage) -> FloatImage:
        """Dense depth [m] of sparse depth [m], both of shape (H, W); 0 = unknown."""
        largest = np.finfo(np.float32).max  # which OpenCV also assumes outside the image
        far_m = np.where(sparse_m > 0, sparse_m, largest)
        dense_m = cv2.erode(far_m, np.ones((self.size_px, self.size_px), np.uint8))
        return np.where(dense_m < largest, dense_m, np.float32(0))


class Median(_Window):
    """Every pixel takes the lower median of the filled pixels of its window."""

    method: Literal["median"] = "median"

    def fill(self, sparse_m: FloatImage) -> FloatImage:
        """Dense depth [m] of sparse depth [m], both of shape (H, W); 0 = unknown."""
        height, width = sparse_m.shape
        far_m = np.where(sparse_m > 0, sparse_m, np.float32(np.inf))
        padded_m = np.pad(far_m, self._reach_px, constant_values=np.inf)
        dense_m = np.empty_like(sparse_m)
        for row in range(height):  # by rows, for the windows of a whole image would be 25 images
            windows_m = np.lib.stride_tricks.sliding_window_view(
                padded_m[row : row + self.size_px], self.size_px, axis=1
            )
            sorted_m = np.sort(windows_m.transpose(1, 0, 2).reshape(width, -1), axis=1)
            middle = np.maximum(np.isfinite(sorted_m).sum(axis=1) - 1, 0) // 2
            dense_m[row] = sorted_m[np.arange(width), middle]
        dense_m[np.isinf(dense_m)] = 0
        return dense_m


class Bilinear(_Window):
    """Empty pixels take the mean of the filled ones of their window, weighted by a tent in rows and in columns.

    On a lattice of filled pixels `size_px // 2 + 1` apart this is bilinear interpolation.
    """

    method: Literal["bilinear"] = "bilinear"

    def fill(self, sparse_m: FloatImage) -> FloatImage:
        """Dense depth [m] of sparse depth [m], both of shape (H, W); 0 = unknown."""
        reach = self._reach_px
        tent = 1 - np.abs(np.arange(-reach, reach + 1, dtype=np.float32)) / (reach + 1)
        total = [
            cv2.sepFilter2D(image, cv2.CV_32F, tent, tent, borderType=cv2.BORDER_CONSTANT)
            for image in (sparse_m, (sparse_m > 0).astype(np.float32))
        ]
        mean_m = np.divide(total[0], total[1], out=np.zeros_like(sparse_m), where=total[1] > 0)
        return np.where(sparse_m > 0, sparse_m, mean_m)


class Nearest(_Window):
    """Empty pixels take the nearest filled pixel within half the window."""

    method: Literal["nearest"] = "nearest"

    def fill(self, sparse_m: FloatImage) -> FloatImage:
        """Dense depth [m] of sparse depth [m], both of shape (H, W); 0 = unknown."""
        return fill_from_nearest(sparse_m, self._reach_px)


Inpainting = Annotated[Dilation | Erosion | Median | Bilinear | Nearest, Field(discriminator="method")]
"""Any of the methods; in a configuration file its `method` names it."""
