"""Forward warping of a disparity image to another camera pose, with the values resampled backward."""

from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
from numba import float32, float64, int32, int64, uint8, uint32, void

from ..arithmetic import matmul
from ..compiled import BYTE_IMAGE, FLOAT_IMAGE, FLOAT_ROW, compiled, compiled_part, named_tuple
from ..geometry import interpolate, inverse_rigid
from ..types import FloatArray, FloatImage, GrayImage
from .working_resolution import MAX_DISPARITY_PX, WorkingResolution

UNITS_PER_PX = np.float32(2**14)
"""Steps of a disparity in the z-buffer: with 24 bits in all it covers 1024 px in steps of 0.00006 px."""
WEIGHT_BITS = np.uint32(8)
"""The lower bits of a key of the z-buffer are the weight."""
WEIGHT_MASK = np.uint32(255)
"""These bits."""
MAX_RESAMPLING_CHANGE_PX = np.float32(0.6)
"""A resampled value replaces the splatted one if it differs by less; otherwise it belongs to another surface."""
MIN_DEPTH_RATIO = np.float32(1e-3)
"""Points whose depth shrinks to this fraction, or a smaller one, are taken to lie behind the camera."""
HOLE_PX = np.float32(-1e9)
"""Disparity that stands for a hole while values are resampled: the smallest share of it makes a sample invalid."""
MOTION_STRIDE_PX = 4
"""Stride of the rows and columns that the motion of the image is measured at."""
CRACK_KERNEL = np.ones((3, 3), np.uint8)
"""Neighbourhood that closes cracks of one pixel, which splatting leaves where a surface is magnified."""


class Warped(NamedTuple):
    """A disparity image as another camera sees it, shape (H, W)."""

    disparity_px: FloatImage
    """Disparity, float32; 0 = no surface."""
    weight: GrayImage
    """Weight of each pixel, uint8; 0 = no surface."""
    source_x: FloatImage
    """Column in the source image that each pixel comes from."""
    source_y: FloatImage
    """Row in the source image that each pixel comes from."""


class Reprojection(NamedTuple):
    """The projective map `(H | e)` of pixels with disparity for a motion of the camera, float32.

    (u, v, D) moves to `H (u, v, 1) + e D`, divided by its last row. That divisor is the ratio of the depths after and
    before, so the new disparity is D divided by it as well. H is the infinite homography `K R K^-1`, shape (3, 3), and
    e is the epipole `K t / (f B)`, shape (3,).
    """

    of_col: FloatImage
    """What each column adds, `H (u, 0, 1)`, shape (3, W)."""
    of_row: FloatImage
    """What each row adds, `H (0, v, 0)`, shape (3, H)."""
    epipole: FloatImage
    """Shape (3,)."""

    @classmethod
    def of(cls, resolution: WorkingResolution, T_target_source: FloatArray) -> "Reprojection":
        """Return the map for a motion of the camera, shape (4, 4)."""
        K_R = matmul(resolution.K, T_target_source[:3])
        H = matmul(K_R[:, :3], resolution.K_inverse).astype(np.float32)
        epipole = (K_R[:, 3] / resolution.focal_baseline_px_m).astype(np.float32)
        v, u = (np.arange(side, dtype=np.float32) for side in resolution.shape)
        return cls(H[:, :1] * u + H[:, 2:], H[:, 1:2] * v, epipole)


WARPED_TYPE = named_tuple(Warped, FLOAT_IMAGE, BYTE_IMAGE, FLOAT_IMAGE, FLOAT_IMAGE)
REPROJECTION_TYPE = named_tuple(Reprojection, FLOAT_IMAGE, FLOAT_IMAGE, FLOAT_ROW)


class ForwardWarp:
    """Warps disparity images to the pose of another camera.

    1. Each pixel is splatted to the nearest pixel of the target; a z-buffer keeps the nearest surface.
    2. Cracks of one pixel are closed.
    3. Each target pixel is traced back to the source image, and its value is resampled there with subpixel accuracy.
    """

    def __init__(self, resolution: WorkingResolution) -> None:
        self._resolution = resolution
        height, width = resolution.shape
        # A margin of one pixel catches the points that fall outside of the image.
        self._keys = np.empty((height + 2, width + 2), np.uint32)
        self._marked_px, self._sampled_px = np.empty((2, height, width), np.float32)

    def warp(self, disparity_px: FloatImage, weight: GrayImage, T_target_source: FloatArray) -> Warped:
        """Return the image as the target camera sees it after a motion, shape (4, 4).

        Disparity and weight have shape (H, W); 0 = no surface. The larger weight wins between equal disparities.
        """
        forward, backward = (
            Reprojection.of(self._resolution, T) for T in (T_target_source, inverse_rigid(T_target_source))
        )
        kinds = np.float32, np.uint8, np.float32, np.float32
        warped = Warped(*(np.empty(disparity_px.shape, kind) for kind in kinds))
        self._keys.fill(0)
        _splat(disparity_px, weight, forward, self._keys, self._marked_px)
        _read_keys(self._keys, warped.disparity_px, warped.weight)
        closed_px = np.asarray(cv2.morphologyEx(warped.disparity_px, cv2.MORPH_CLOSE, CRACK_KERNEL), np.float32)
        closed_weight = np.asarray(cv2.morphologyEx(warped.weight, cv2.MORPH_CLOSE, CRACK_KERNEL), np.uint8)
        _trace_back(closed_px, closed_weight, backward, warped)
        interpolate(self._marked_px, warped.source_x, warped.source_y, float(HOLE_PX), self._sampled_px)
        _resample(self._sampled_px, backward, warped.disparity_px)
        return warped

    def motion_px2(self, warped: Warped) -> float:
        """Return the mean squared distance by which the surfaces of the image have moved, in its pixels; 0 without."""
        return _mean_motion_px2(warped)


@compiled_part(void(FLOAT_ROW, REPROJECTION_TYPE, int64, FLOAT_ROW))
def _find_inverse_ratios(
    disparity_px: FloatImage,
    reprojection: Reprojection,
    row: int,
    # output
    inverse: FloatImage,
) -> None:
    """Find the inverse of the last row of the map for the pixels of a row; 0 for points behind the camera.

    Args:
        disparity_px: Disparity of the row, shape (w,).
        reprojection: The map to the other camera.
        row: Index of the row.
        inverse: Depth before by depth after the motion, shape (w,); written.
    """
    of_col, of_row, epipole = reprojection.of_col[2], reprojection.of_row[2, row], reprojection.epipole[2]
    for col in range(len(inverse)):
        ratio = epipole * disparity_px[col] + of_col[col] + of_row
        per_ratio = float32(1) / ratio
        inverse[col] = per_ratio if ratio > MIN_DEPTH_RATIO else float32(0)


@compiled_part(void(FLOAT_ROW, FLOAT_ROW, REPROJECTION_TYPE, int64, int64, FLOAT_ROW))
def _move(
    disparity_px: FloatImage,
    inverse: FloatImage,
    reprojection: Reprojection,
    axis: int,
    row: int,
    # output
    position_px: FloatImage,
) -> None:
    """Find the column or the row that the pixels of a row move to.

    Args:
        disparity_px: Disparity of the row, shape (w,).
        inverse: What `_find_inverse_ratios` found for it, shape (w,).
        reprojection: The map to the other camera.
        axis: 0 for the column, 1 for the row.
        row: Index of the row.
        position_px: The position in the other image, shape (w,); written.
    """
    of_col, of_row, epipole = reprojection.of_col[axis], reprojection.of_row[axis, row], reprojection.epipole[axis]
    for col in range(len(position_px)):
        position_px[col] = (epipole * disparity_px[col] + of_col[col] + of_row) * inverse[col]


@compiled_part(void(FLOAT_ROW, int64, int32[::1]))
def _round(
    position_px: FloatImage,
    side: int,
    # output
    nearest: npt.NDArray[np.int32],
) -> None:
    """Find the nearest pixel along a side of the image, and -1 or the length of the side beyond it."""
    last = float32(side)
    for col in range(len(nearest)):
        nearest[col] = int32(min(max(np.rint(position_px[col]), float32(-1)), last))


@compiled(void(FLOAT_IMAGE, BYTE_IMAGE, REPROJECTION_TYPE, uint32[:, ::1], FLOAT_IMAGE))
def _splat(
    disparity_px: FloatImage,
    weight: GrayImage,
    forward: Reprojection,
    # output
    keys: npt.NDArray[np.uint32],
    marked_px: FloatImage,
) -> None:
    """Write each pixel to the z-buffer, whose keys are disparity first and weight second.

    The positions and keys of a row are known before any of them is written.

    Args:
        disparity_px: Disparity in the source camera, shape (h, w); 0 = no surface.
        weight: Weight, shape (h, w); the larger one wins between equal disparities.
        forward: The map from the source to the target camera.
        keys: The z-buffer with a margin of one pixel, shape (h + 2, w + 2), zeros before; changed in place.
        marked_px: The disparity with `HOLE_PX` in holes, shape (h, w); written.
    """
    height, width = disparity_px.shape
    inverse, position_px = np.empty(width, np.float32), np.empty(width, np.float32)
    target_row, target_col, key = np.empty(width, np.int32), np.empty(width, np.int32), np.empty(width, np.uint32)
    for row in range(height):
        row_px, row_weight, marked = disparity_px[row], weight[row], marked_px[row]
        for col in range(width):
            pixel_px = row_px[col]
            marked[col] = pixel_px if pixel_px > 0 else HOLE_PX
        _find_inverse_ratios(row_px, forward, row, inverse)
        _move(row_px, inverse, forward, 1, row, position_px)
        _round(position_px, height, target_row)
        _move(row_px, inverse, forward, 0, row, position_px)
        _round(position_px, width, target_col)
        for col in range(width):
            target_px = row_px[col] * inverse[col]
            # Truncation would move the memory away a little in every frame.
            units = int32(np.rint(min(target_px, MAX_DISPARITY_PX) * UNITS_PER_PX))
            known = units if target_px <= MAX_DISPARITY_PX else int32(0)
            key[col] = (uint32(known) << WEIGHT_BITS) | uint32(row_weight[col])
        for col in range(width):
            # The largest key is that of the nearest surface; beyond the image, it lands in the margin.
            v, u = np.uintp(target_row[col] + 1), np.uintp(target_col[col] + 1)
            keys[v, u] = max(keys[v, u], key[col])


@compiled(void(uint32[:, ::1], FLOAT_IMAGE, BYTE_IMAGE))
def _read_keys(
    keys: npt.NDArray[np.uint32],
    # output
    disparity_px: FloatImage,
    weight: GrayImage,
) -> None:
    """Read disparity and weight of the keys without their margin; both are 0 where there is no surface."""
    for row in range(disparity_px.shape[0]):
        for col in range(disparity_px.shape[1]):
            key = keys[row + 1, col + 1]
            units = int32(key >> WEIGHT_BITS)
            disparity_px[row, col] = float32(units) / UNITS_PER_PX
            weight[row, col] = uint8(key & WEIGHT_MASK) if units > 0 else uint8(0)


@compiled(void(FLOAT_IMAGE, BYTE_IMAGE, REPROJECTION_TYPE, WARPED_TYPE))
def _trace_back(
    closed_px: FloatImage,
    closed_weight: GrayImage,
    backward: Reprojection,
    # input and output
    warped: Warped,
) -> None:
    """Fill the cracks, and find the position of each pixel in the source image.

    Args:
        closed_px: Morphological closing of the disparity of `warped`, shape (h, w).
        closed_weight: That of its weight, shape (h, w).
        backward: The map from the target to the source camera.
        warped: Disparity and weight are changed in cracks, and the positions in the source image are written.
    """
    inverse = np.empty(closed_px.shape[1], np.float32)
    for row in range(closed_px.shape[0]):
        near_px, near_weight, weight = closed_px[row], closed_weight[row], warped.weight[row]
        disparity_px = warped.disparity_px[row]
        for col in range(len(weight)):
            own, near = weight[col], near_weight[col]
            weight[col] = own if disparity_px[col] > 0 else near
        for col in range(len(weight)):
            own_px, crack_px = disparity_px[col], near_px[col]
            disparity_px[col] = own_px if own_px > 0 else crack_px
        _find_inverse_ratios(disparity_px, backward, row, inverse)
        _move(disparity_px, inverse, backward, 0, row, warped.source_x[row])
        _move(disparity_px, inverse, backward, 1, row, warped.source_y[row])


@compiled(void(FLOAT_IMAGE, REPROJECTION_TYPE, FLOAT_IMAGE))
def _resample(
    sampled_px: FloatImage,
    backward: Reprojection,
    # input and output
    disparity_px: FloatImage,
) -> None:
    """Replace the disparity of each pixel by its sample in the source image, where that is of the same surface."""
    of_col, epipole = backward.of_col[2], backward.epipole[2]
    for row in range(disparity_px.shape[0]):
        of_row, there_px, row_px = backward.of_row[2, row], sampled_px[row], disparity_px[row]
        for col in range(len(row_px)):
            splatted_px = row_px[col]
            resampled_px = there_px[col] * (epipole * splatted_px + of_col[col] + of_row)
            is_same = (abs(resampled_px - splatted_px) < MAX_RESAMPLING_CHANGE_PX) & (splatted_px > 0)
            row_px[col] = resampled_px if is_same else splatted_px


@compiled(float64(WARPED_TYPE))
def _mean_motion_px2(warped: Warped) -> float:
    """Return the mean squared distance between pixels of the surfaces and their positions in the source image.

    Every `MOTION_STRIDE_PX`th pixel of such rows is enough, since motion varies little.
    """
    total_px2, n_surfaces = 0.0, 0
    for row in range(0, warped.weight.shape[0], MOTION_STRIDE_PX):
        for col in range(0, warped.weight.shape[1], MOTION_STRIDE_PX):
            if warped.weight[row, col] > 0:
                x_px, y_px = warped.source_x[row, col] - float32(col), warped.source_y[row, col] - float32(row)
                total_px2 += float64(x_px * x_px + y_px * y_px)
                n_surfaces += 1
    return total_px2 / max(n_surfaces, 1)
