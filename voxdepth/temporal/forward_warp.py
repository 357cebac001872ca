"""Forward warping of a disparity image to another camera pose, with the values resampled backward."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import numpy.typing as npt

from ..devices import DeviceName
from ..geometry import inverse_rigid
from ..types import FloatArray, FloatImage, GrayImage
from .masks import above, below, copy_where, equal
from .working_resolution import MAX_DISPARITY_PX, WorkingResolution

if TYPE_CHECKING:
    from .forward_warp_gpu import GpuForwardWarp

FRACTION_BITS = 14
"""Fraction bits of a disparity in the z-buffer: with 24 bits in all it covers 1024 px in steps of 0.00006 px."""
WEIGHT_BITS = 8
MAX_RESAMPLING_CHANGE_PX = 0.6
"""A resampled value replaces the splatted one if it differs by less; otherwise it belongs to another surface."""
MIN_DEPTH_RATIO = np.float32(1e-3)
"""Points whose depth shrinks to a smaller fraction are taken to lie behind the camera."""
MAX_INVERSE_DEPTH_RATIO = 999.0
"""Bound that the inverse depth ratio of points behind the camera exceeds."""
BAND_PX = 2**15
"""Pixels per band of rows, so that the few buffers of a band fit into the cache of one core."""
HOLE_PX = -1e9
"""Disparity that stands for a hole while values are resampled: the smallest share of it makes a sample invalid."""
CRACK_KERNEL = np.ones((3, 3), np.uint8)
"""Neighbourhood that closes cracks of one pixel, which splatting leaves where a surface is magnified."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Warped:
    """A disparity image as another camera sees it, shape (H, W)."""

    disparity_px: FloatImage
    """Disparity, float32; 0 = no surface."""
    weight: GrayImage
    """Weight of each pixel, uint8; 0 = no surface."""
    source_x: FloatImage
    """Column in the source image that each pixel comes from."""
    source_y: FloatImage
    """Row in the source image that each pixel comes from."""


class ReprojectionMap:
    """The projective map of pixels with disparity: (u, v, D) moves to `H (u, v, 1) + e D`, divided by its last row.

    That divisor is the ratio of the depths after and before, so the new disparity is D divided by it as well. H is the
    infinite homography `K R K^-1`, shape (3, 3), and e is the epipole `K t / (f B)`, shape (3,), both float32.
    """

    def __init__(self, resolution: WorkingResolution, T_target_source: FloatArray) -> None:
        K = resolution.K
        self.H = (K @ T_target_source[:3, :3] @ np.linalg.inv(K)).astype(np.float32)
        self.e = (K @ T_target_source[:3, 3] / resolution.focal_baseline_px_m).astype(np.float32)
        self._cols = np.arange(resolution.width_px, dtype=np.float32)
        self._rows = np.arange(resolution.height_px, dtype=np.float32)[:, None]

    def numerator(self, axis: int, disparity_px: FloatImage, band: slice, out: FloatImage) -> None:
        """Write one row of `H (u, v, 1) + e D` for a band of rows of the image."""
        per_col, per_row, constant = self.H[axis]
        np.multiply(disparity_px, self.e[axis], out=out)
        out += per_col * self._cols + constant
        out += per_row * self._rows[band]

    def inverse_depth_ratio(self, disparity_px: FloatImage, band: slice, out: FloatImage) -> None:
        """Write the inverse of the divisor for a band of rows; 0 for points behind the camera."""
        self.numerator(2, disparity_px, band, out)
        np.maximum(out, MIN_DEPTH_RATIO, out=out)
        np.divide(np.float32(1), out, out=out)
        cv2.threshold(out, MAX_INVERSE_DEPTH_RATIO, 0, cv2.THRESH_TOZERO_INV, out)


class ForwardWarp:
    """Warps disparity images on the CPU; `GpuForwardWarp` is its twin.

    1. Each pixel is splatted to the nearest pixel of the target; a z-buffer keeps the nearest surface.
    2. Cracks of one pixel are closed.
    3. Each target pixel is traced back to the source image, and its value is resampled there with subpixel accuracy.

    All steps work on bands of rows that fit into the cache, which is three times as fast as whole images.
    """

    def __init__(self, resolution: WorkingResolution) -> None:
        self._resolution = resolution
        height, width = resolution.shape
        rows = max(1, BAND_PX // width)
        self._bands = [slice(start, min(start + rows, height)) for start in range(0, height, rows)]
        self._inverse, self._a, self._b = (np.empty((rows, width), np.float32) for _ in range(3))
        # Processors have vector instructions for conversions between floats and signed integers only.
        self._key, self._index = (np.empty((rows, width), np.int32) for _ in range(2))
        # A border of one pixel catches the points that fall outside of the image.
        self._z_buffer = np.empty((height + 2, width + 2), np.uint32)

    def warp(self, disparity_px: FloatImage, weight: GrayImage, T_target_source: FloatArray) -> Warped:
        """The image as the target camera sees it after a motion, shape (4, 4).

        Disparity and weight have shape (H, W); 0 = no surface. The larger weight wins between equal disparities.
        """
        forward = ReprojectionMap(self._resolution, T_target_source)
        backward = ReprojectionMap(self._resolution, inverse_rigid(T_target_source))
        self._z_buffer.fill(0)
        for band in self._bands:
            self._splat(forward, disparity_px[band], weight[band], band)
        splatted_px, weight = self._read_z_buffer()
        _close_cracks(splatted_px, weight)
        source_x, source_y = np.empty_like(splatted_px), np.empty_like(splatted_px)
        warped = Warped(disparity_px=splatted_px, weight=weight, source_x=source_x, source_y=source_y)
        marked_px = disparity_px.copy()
        copy_where(equal(disparity_px, 0), np.full_like(disparity_px, HOLE_PX), marked_px)
        for band in self._bands:
            self._resample(forward, backward, marked_px, warped, band)
        return warped

    def _splat(self, forward: ReprojectionMap, disparity_px: FloatImage, weight: GrayImage, band: slice) -> None:
        """Write a band to the z-buffer, whose keys are disparity first and weight second."""
        height, width = self._resolution.shape
        inverse, row, col, key, index = _rows_of(band, self._inverse, self._a, self._b, self._key, self._index)
        forward.inverse_depth_ratio(disparity_px, band, inverse)
        for axis, size_px, position in ((1, height, row), (0, width, col)):
            forward.numerator(axis, disparity_px, band, position)
            np.multiply(position, inverse, out=position)
            np.rint(position, out=position)
            np.clip(position, np.float32(-1), np.float32(size_px), out=position)
        row *= np.float32(width + 2)
        row += col
        row += np.float32(width + 3)
        np.copyto(index, row, casting="unsafe")
        target_px = np.multiply(disparity_px, inverse, out=inverse)
        cv2.threshold(target_px, MAX_DISPARITY_PX, 0, cv2.THRESH_TOZERO_INV, target_px)
        target_px *= np.float32(2**FRACTION_BITS)
        np.rint(target_px, out=target_px)  # truncation would move the memory away a little in every frame
        np.copyto(key, target_px, casting="unsafe")
        bits = key.view(np.uint32)
        bits <<= np.uint32(WEIGHT_BITS)
        bits |= weight
        np.maximum.at(self._z_buffer.ravel(), index.ravel(), bits.ravel())

    def _read_z_buffer(self) -> tuple[FloatImage, GrayImage]:
        keys = self._z_buffer[1:-1, 1:-1]
        splatted_px, weight = np.empty(keys.shape, np.float32), np.empty(keys.shape, np.uint8)
        for band in self._bands:
            (key,) = _rows_of(band, self._key)
            np.right_shift(keys[band], np.uint32(WEIGHT_BITS), out=key.view(np.uint32))
            np.copyto(splatted_px[band], key, casting="same_kind")
            splatted_px[band] *= np.float32(2.0**-FRACTION_BITS)
            np.copyto(weight[band], keys[band], casting="unsafe")
            weight[band] &= above(splatted_px[band], 0)
        return splatted_px, weight

    def _resample(
        self,
        forward: ReprojectionMap,
        backward: ReprojectionMap,
        marked_px: FloatImage,
        warped: Warped,
        band: slice,
    ) -> None:
        """Trace the pixels of a band back, and replace their disparity by samples of the same surface, if they are."""
        inverse, ratio, change_px = _rows_of(band, self._inverse, self._a, self._b)
        splatted_px, source_x, source_y = warped.disparity_px[band], warped.source_x[band], warped.source_y[band]
        backward.inverse_depth_ratio(splatted_px, band, inverse)
        for axis, source in enumerate((source_x, source_y)):
            backward.numerator(axis, splatted_px, band, source)
            np.multiply(source, inverse, out=source)
        sampled_px = cv2.remap(
            marked_px, source_x, source_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=HOLE_PX
        )
        # The position was computed with another disparity than the sample has; the depth ratio is corrected for it.
        np.multiply(splatted_px, inverse, out=ratio)
        np.subtract(sampled_px, ratio, out=ratio)
        ratio *= forward.e[2]
        ratio += inverse
        np.maximum(ratio, MIN_DEPTH_RATIO, out=ratio)
        resampled_px = np.divide(sampled_px, ratio, out=ratio)
        np.abs(np.subtract(resampled_px, splatted_px, out=change_px), out=change_px)
        copy_where(below(change_px, MAX_RESAMPLING_CHANGE_PX) & above(splatted_px, 0), resampled_px, splatted_px)


def create_forward_warp(resolution: WorkingResolution, device: DeviceName) -> "ForwardWarp | GpuForwardWarp":
    """The forward warp of a device.

    Raises:
        ConfigError: The device does not exist on this machine.
    """
    if device == "cpu":
        return ForwardWarp(resolution)
    from .forward_warp_gpu import GpuForwardWarp

    return GpuForwardWarp(resolution, device=device)


def _rows_of(band: slice, *buffers: npt.NDArray[Any]) -> list[npt.NDArray[Any]]:
    return [buffer[: band.stop - band.start] for buffer in buffers]


def _close_cracks(disparity_px: FloatImage, weight: GrayImage) -> None:
    """Fill gaps of one pixel in place by a morphological closing."""
    empty = equal(disparity_px, 0)
    closed_px = np.asarray(cv2.morphologyEx(disparity_px, cv2.MORPH_CLOSE, CRACK_KERNEL), np.float32)
    copy_where(empty, closed_px, disparity_px)
    copy_where(empty, np.asarray(cv2.morphologyEx(weight, cv2.MORPH_CLOSE, CRACK_KERNEL), np.uint8), weight)
