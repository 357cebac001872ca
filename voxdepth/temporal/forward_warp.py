"""Moving an image of disparity to another pose: forward for what is seen, backward for its value."""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from ..geometry import inverse_rigid
from ..types import FloatArray, FloatImage, GrayImage
from .masks import above, below, both, equal, put
from .working_resolution import LARGEST_PX, Scale

FRACTION_BITS = 14
"""Of a disparity in the depth buffer: 24 bits hold up to 1024 px in steps of 0.00006 px."""
WEIGHT_BITS = 8
SAME_SURFACE_PX = 0.6
"""A value sampled in the source image counts if it moves to within so much of the disparity that was seen."""
NEAREST = np.float32(1e-3)
"""Points nearer than this part of their former depth are behind the camera, or as good as."""
LARGEST_RATIO = 999.0
"""Of depths before and after: what that leaves is larger."""
BAND_PX = 2**15
"""Pixels per band: a few images of them fit into the cache of one core."""
NOTHING_PX = -1e9
"""Stands for nothing where values are sampled between pixels: mixed with the least part of it, they are of no
surface."""
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


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """A point (u, v) of disparity D moves to `A (u, v, 1) + e D`, divided by its last row."""

    A: npt.NDArray[np.float32]
    """`K R K^-1`, shape (3, 3)."""
    e: npt.NDArray[np.float32]
    """`K t / (f B)`, shape (3,)."""

    @classmethod
    def of(cls, scale: Scale, T_target_source: FloatArray) -> "Motion":
        """For images of a scale and a motion of shape (4, 4)."""
        A = scale.K @ T_target_source[:3, :3] @ np.linalg.inv(scale.K)
        e = scale.K @ T_target_source[:3, 3] / scale.focal_baseline_px_m
        return cls(A=A.astype(np.float32), e=e.astype(np.float32))


class Reprojection:
    """Moves images of one camera by a projective map of column, row and disparity.

    The divisor of that map is also the ratio of the depths, so the new disparity is D over it, and no point is ever
    back-projected. Works on bands of rows that fit into the processor's cache, which is three times as fast.
    """

    def __init__(self, scale: Scale) -> None:
        self._scale = scale
        height, width = scale.shape
        rows = max(1, BAND_PX // width)
        self._bands = [slice(start, min(start + rows, height)) for start in range(0, height, rows)]
        self._cols = np.arange(width, dtype=np.float32)
        self._rows = np.arange(height, dtype=np.float32)[:, None]
        self._inverse, self._a, self._b = (np.empty((rows, width), np.float32) for _ in range(3))
        # Processors convert floats to and from 32 bits with a sign many at a time, others one by one.
        self._key, self._index = (np.empty((rows, width), np.int32) for _ in range(2))
        # A border of one pixel catches what falls outside.
        self._buffer = np.empty((height + 2, width + 2), np.uint32)

    def move(self, disparity_px: FloatImage, weight: GrayImage, T_target_source: FloatArray) -> Moved:
        """What the target camera sees of an image.

        Args:
            disparity_px: Of the source image, shape (H, W); 0 = nothing.
            weight: Of its pixels, shape (H, W), uint8; 0 = nothing. Breaks ties between equal disparities.
            T_target_source: Motion, shape (4, 4).
        """
        motion = Motion.of(self._scale, T_target_source)
        back = Motion.of(self._scale, inverse_rigid(T_target_source))
        self._buffer.fill(0)
        for band in self._bands:
            self._splat(motion, disparity_px[band], weight[band], band)
        seen_px, weight = self._seen()
        _close_cracks(seen_px, weight)
        source_x, source_y = np.empty_like(seen_px), np.empty_like(seen_px)
        moved = Moved(disparity_px=seen_px, weight=weight, source_x=source_x, source_y=source_y)
        marked_px = disparity_px.copy()
        put(np.full_like(disparity_px, NOTHING_PX), equal(disparity_px, 0), marked_px)
        for band in self._bands:
            self._trace_back(back, moved, band)
            self._sample(motion, marked_px, moved, band)
        return moved

    def _splat(self, motion: Motion, disparity_px: FloatImage, weight: GrayImage, band: slice) -> None:
        """Round to whole pixels; of several surfaces the nearest stays, whatever their order."""
        height, width = self._scale.shape
        inverse, row, col = self._room(band, self._inverse, self._a, self._b)
        key, index = self._room(band, self._key, self._index)
        self._divisor(motion, disparity_px, inverse, band)
        self._projected(motion, 1, disparity_px, inverse, height, row, band)
        self._projected(motion, 0, disparity_px, inverse, width, col, band)
        row *= np.float32(width + 2)
        row += col
        row += np.float32(width + 3)
        np.copyto(index, row, casting="unsafe")
        moved_px = np.multiply(disparity_px, inverse, out=inverse)
        cv2.threshold(moved_px, LARGEST_PX, 0, cv2.THRESH_TOZERO_INV, moved_px)
        moved_px *= np.float32(2**FRACTION_BITS)
        np.rint(moved_px, out=moved_px)  # cut off, a memory would recede a little in every frame
        np.copyto(key, moved_px, casting="unsafe")
        bits = key.view(np.uint32)
        bits <<= np.uint32(WEIGHT_BITS)
        bits |= weight
        np.maximum.at(self._buffer.ravel(), index.ravel(), bits.ravel())

    def _seen(self) -> tuple[FloatImage, GrayImage]:
        """Disparity and weight of what was splatted."""
        seen = self._buffer[1:-1, 1:-1]
        seen_px, weight = np.empty(seen.shape, np.float32), np.empty(seen.shape, np.uint8)
        for band in self._bands:
            (key,) = self._room(band, self._key)
            np.right_shift(seen[band], np.uint32(WEIGHT_BITS), out=key.view(np.uint32))
            np.copyto(seen_px[band], key, casting="same_kind")
            seen_px[band] *= np.float32(2.0**-FRACTION_BITS)
            np.copyto(weight[band], seen[band], casting="unsafe")
            weight[band] &= above(seen_px[band], 0)
        return seen_px, weight

    def _trace_back(self, back: Motion, moved: Moved, band: slice) -> None:
        """Where in the source image each pixel of the target came from; leaves the inverse divisors behind."""
        (inverse,) = self._room(band, self._inverse)
        seen_px = moved.disparity_px[band]
        self._divisor(back, seen_px, inverse, band)
        for axis, source in enumerate((moved.source_x[band], moved.source_y[band])):
            self._linear(back, axis, seen_px, source, band)
            np.multiply(source, inverse, out=source)

    def _sample(self, motion: Motion, disparity_px: FloatImage, moved: Moved, band: slice) -> None:
        """Take the source's value between its pixels in place of the splatted one, where it is of the same surface."""
        inverse, ratio, scratch = self._room(band, self._inverse, self._a, self._b)
        seen_px = moved.disparity_px[band]
        source = moved.source_x[band], moved.source_y[band]
        sampled_px = cv2.remap(
            disparity_px, *source, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=NOTHING_PX
        )
        # Where D differs from the disparity that the position was computed with, so does the ratio of the depths.
        np.multiply(seen_px, inverse, out=ratio)
        np.subtract(sampled_px, ratio, out=ratio)
        ratio *= motion.e[2]
        ratio += inverse
        np.maximum(ratio, NEAREST, out=ratio)
        value_px = np.divide(sampled_px, ratio, out=ratio)
        np.abs(np.subtract(value_px, seen_px, out=scratch), out=scratch)
        put(value_px, both(below(scratch, SAME_SURFACE_PX), above(seen_px, 0)), seen_px)

    def _room(self, band: slice, *buffers: npt.NDArray[Any]) -> list[npt.NDArray[Any]]:
        """Buffers for a band."""
        return [buffer[: band.stop - band.start] for buffer in buffers]

    def _divisor(self, motion: Motion, disparity_px: FloatImage, out: FloatImage, band: slice) -> None:
        """The inverse of the last row of the map; 0 for points behind the camera."""
        self._linear(motion, 2, disparity_px, out, band)
        np.maximum(out, NEAREST, out=out)
        np.divide(np.float32(1), out, out=out)
        cv2.threshold(out, LARGEST_RATIO, 0, cv2.THRESH_TOZERO_INV, out)

    def _linear(self, motion: Motion, axis: int, disparity_px: FloatImage, out: FloatImage, band: slice) -> None:
        """One row of `A (u, v, 1) + e D`."""
        along, down, constant = motion.A[axis]
        np.multiply(disparity_px, motion.e[axis], out=out)
        out += along * self._cols + constant
        out += down * self._rows[band]

    def _projected(
        self,
        motion: Motion,
        axis: int,
        disparity_px: FloatImage,
        inverse: FloatImage,
        size_px: int,
        out: FloatImage,
        band: slice,
    ) -> FloatImage:
        """Whole column (axis 0) or row (axis 1); -1 and `size_px` stand for all beyond."""
        self._linear(motion, axis, disparity_px, out, band)
        out *= inverse
        np.rint(out, out=out)
        np.clip(out, np.float32(-1), np.float32(size_px), out=out)
        return out


def _close_cracks(disparity_px: FloatImage, weight: GrayImage) -> None:
    """Give gaps of one pixel what is around them, in place."""
    empty = equal(disparity_px, 0)
    put(np.asarray(cv2.morphologyEx(disparity_px, cv2.MORPH_CLOSE, CRACK), np.float32), empty, disparity_px)
    put(np.asarray(cv2.morphologyEx(weight, cv2.MORPH_CLOSE, CRACK), np.uint8), empty, weight)
