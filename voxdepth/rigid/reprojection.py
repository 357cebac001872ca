"""Moving an image of disparity to another pose: forward for what is seen, backward for its value."""

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from ..geometry import inverse_rigid
from ..types import FloatArray, FloatImage, GrayImage
from .scale import LARGEST_PX, Scale

FRACTION_BITS = 14
"""Of a disparity in the depth buffer: 24 bits hold up to 1024 px in steps of 0.00006 px."""
WEIGHT_BITS = 8
SAME_SURFACE_PX = 0.6
"""A value sampled in the source image counts if it moves to within so much of the disparity that was seen."""
LEAST_RATIO = 0.75
"""And if it is not farther than the surface that was seen by more than this: beside nothing, samples are mixed with 0."""
NEAREST = np.float32(1e-3)
"""Points nearer than this part of their former depth are behind the camera, or as good as."""
CRACK = np.ones((3, 3), np.uint8)
"""Gaps of one pixel between splatted pixels are closed: magnification tears surfaces open."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Moved:
    """An image of disparity as another camera sees it."""

    disparity_px: FloatImage
    """Shape (H, W); 0 = nothing."""
    weight: GrayImage
    """Of each pixel, shape (H, W), uint8; 0 = nothing."""
    source_x: FloatImage
    """Column in the source image that each pixel came from, shape (H, W)."""
    source_y: FloatImage
    """Row in the source image."""


class Reprojection:
    """Moves images of one camera. A point (u, v) of disparity D moves to `A (u, v, 1) + e D`, divided by its last row.

    That last row is also the ratio of the depths, so the new disparity is D over it: no point is ever back-projected.
    """

    def __init__(self, scale: Scale) -> None:
        self._scale = scale
        height, width = scale.shape
        self._cols = np.arange(width, dtype=np.float32)
        self._rows = np.arange(height, dtype=np.float32)[:, None]
        self._a, self._b, self._c = (np.empty(scale.shape, np.float32) for _ in range(3))
        self._index = np.empty(scale.shape, np.intp)
        self._buffer = np.empty((height + 2, width + 2), np.uint32)

    def move(self, disparity_px: FloatImage, weight: GrayImage, T_target_source: FloatArray) -> Moved:
        """What the target camera sees of an image.

        Args:
            disparity_px: Of the source image, shape (H, W); 0 = nothing.
            weight: Of its pixels, shape (H, W), uint8; 0 = nothing. Breaks ties between equal disparities.
            T_target_source: Motion, shape (4, 4).
        """
        splatted_px, weight = self._forward(disparity_px, weight, T_target_source)
        self._close_cracks(splatted_px, weight)
        return self._backward(disparity_px, splatted_px, weight, T_target_source)

    def _forward(
        self, disparity_px: FloatImage, weight: GrayImage, T_target_source: FloatArray
    ) -> tuple[FloatImage, GrayImage]:
        """Splat to whole pixels; of several the nearest surface stays, whatever their order."""
        height, width = self._scale.shape
        A, e = self._coefficients(T_target_source)
        inverse = self._linear(A, e, 2, disparity_px, self._a)
        np.maximum(inverse, NEAREST, out=inverse)
        np.divide(np.float32(1), inverse, out=inverse)
        # The buffer has a border of one pixel that catches what falls outside.
        index = self._projected(A, e, 1, disparity_px, inverse, self._b, height)
        index += 1
        index *= np.float32(width + 2)
        index += self._projected(A, e, 0, disparity_px, inverse, self._c, width)
        index += 1
        np.copyto(self._index, index, casting="unsafe")
        moved_px = np.multiply(disparity_px, inverse, out=inverse)
        cv2.threshold(moved_px, LARGEST_PX, 0, cv2.THRESH_TOZERO_INV, moved_px)
        moved_px *= np.float32(2**FRACTION_BITS)
        key = moved_px.astype(np.uint32)
        key <<= WEIGHT_BITS
        key |= weight
        self._buffer.fill(0)
        np.maximum.at(self._buffer.ravel(), self._index.ravel(), key.ravel())
        seen = self._buffer[1:-1, 1:-1]
        seen_px = (seen >> np.uint32(WEIGHT_BITS)).astype(np.float32)
        seen_px *= np.float32(2.0**-FRACTION_BITS)
        return seen_px, seen.astype(np.uint8)

    def _close_cracks(self, disparity_px: FloatImage, weight: GrayImage) -> None:
        """Give gaps of one pixel what is around them, in place."""
        empty = cv2.compare(disparity_px, 0, cv2.CMP_EQ)
        cv2.copyTo(cv2.morphologyEx(disparity_px, cv2.MORPH_CLOSE, CRACK), empty, disparity_px)
        cv2.copyTo(cv2.morphologyEx(weight, cv2.MORPH_CLOSE, CRACK), empty, weight)

    def _backward(
        self, disparity_px: FloatImage, seen_px: FloatImage, weight: GrayImage, T_target_source: FloatArray
    ) -> Moved:
        """Sample the source between its pixels, where each target pixel came from, in place of rounded positions."""
        B, f = self._coefficients(inverse_rigid(T_target_source))
        inverse = self._linear(B, f, 2, seen_px, self._a)
        np.maximum(inverse, NEAREST, out=inverse)
        np.divide(np.float32(1), inverse, out=inverse)
        source_x, source_y = (np.empty(self._scale.shape, np.float32) for _ in range(2))
        for axis, source in enumerate((source_x, source_y)):
            self._linear(B, f, axis, seen_px, source)
            source *= inverse
        sampled_px = cv2.remap(disparity_px, source_x, source_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
        # Where D differs from the disparity that the position was computed with, so does the ratio of the depths.
        ratio = np.multiply(seen_px, inverse, out=self._b)
        np.subtract(sampled_px, ratio, out=ratio)
        ratio *= self._coefficients(T_target_source)[1][2]
        ratio += inverse
        np.maximum(ratio, NEAREST, out=ratio)
        value_px = np.divide(sampled_px, ratio, out=ratio)
        cv2.absdiff(value_px, seen_px, self._a)
        close = cv2.compare(self._a, SAME_SURFACE_PX, cv2.CMP_LT)
        least_px = np.multiply(seen_px, np.float32(LEAST_RATIO), out=self._a)
        cv2.copyTo(value_px, cv2.bitwise_and(close, cv2.compare(value_px, least_px, cv2.CMP_GT)), seen_px)
        return Moved(disparity_px=seen_px, weight=weight, source_x=source_x, source_y=source_y)

    def _coefficients(self, T_target_source: FloatArray) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
        """`A = K R K^-1` and `e = K t / (f B)`, shapes (3, 3) and (3,)."""
        K = self._scale.K
        A = K @ T_target_source[:3, :3] @ np.linalg.inv(K)
        e = K @ T_target_source[:3, 3] / self._scale.focal_baseline_px_m
        return A.astype(np.float32), e.astype(np.float32)

    def _linear(
        self, A: npt.NDArray[np.float32], e: npt.NDArray[np.float32], axis: int, disparity_px: FloatImage, out: FloatImage
    ) -> FloatImage:
        """One row of `A (u, v, 1) + e D` in all pixels."""
        np.multiply(disparity_px, e[axis], out=out)
        out += A[axis, 0] * self._cols + A[axis, 2]
        out += A[axis, 1] * self._rows
        return out

    def _projected(
        self,
        A: npt.NDArray[np.float32],
        e: npt.NDArray[np.float32],
        axis: int,
        disparity_px: FloatImage,
        inverse: FloatImage,
        out: FloatImage,
        size_px: int,
    ) -> FloatImage:
        """Whole column (axis 0) or row (axis 1) of all pixels; -1 and `size_px` stand for all beyond."""
        self._linear(A, e, axis, disparity_px, out)
        out *= inverse
        np.rint(out, out=out)
        np.clip(out, np.float32(-1), np.float32(size_px), out=out)
        return out
