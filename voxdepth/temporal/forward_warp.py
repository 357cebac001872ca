"""Forward warping of a disparity image to another camera pose, with the values resampled backward."""

from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
from numba import float32, float64, int32, int64, types, uint8, uint32, void

from ..arithmetic import matmul
from ..compiled import BYTE_IMAGE, FLOAT_IMAGE, compiled, compiled_part, named_tuple
from ..geometry import bilinear, inverse_rigid
from ..types import FloatArray, FloatImage, GrayImage
from .working_resolution import MAX_DISPARITY_PX, WorkingResolution

UNITS_PER_PX = np.float32(2**14)
"""Steps of a disparity in the z-buffer: with 24 bits in all it covers 1024 px in steps of 0.00006 px."""
WEIGHT_BITS, WEIGHT_MASK = np.uint32(8), np.uint32(255)
"""The lower bits of a key of the z-buffer are the weight."""
MAX_RESAMPLING_CHANGE_PX = np.float32(0.6)
"""A resampled value replaces the splatted one if it differs by less; otherwise it belongs to another surface."""
MIN_DEPTH_RATIO = np.float32(1e-3)
"""Points whose depth shrinks to this fraction, or a smaller one, are taken to lie behind the camera."""
HOLE_PX = np.float32(-1e9)
"""Disparity that stands for a hole while values are resampled: the smallest share of it makes a sample invalid."""
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


WARPED_TYPE = named_tuple(Warped, FLOAT_IMAGE, BYTE_IMAGE, FLOAT_IMAGE, FLOAT_IMAGE)
Row = tuple[float, float, float, float]
ROW_TYPE = types.UniTuple(float32, 4)


def reprojection(resolution: WorkingResolution, T_target_source: FloatArray) -> FloatImage:
    """The projective map `(H | e)` of pixels with disparity for a motion of the camera, shape (3, 4), float32.

    (u, v, D) moves to `H (u, v, 1) + e D`, divided by its last row. That divisor is the ratio of the depths after and
    before, so the new disparity is D divided by it as well. H is the infinite homography `K R K^-1`, shape (3, 3), and
    e is the epipole `K t / (f B)`, shape (3,).
    """
    K_R = matmul(resolution.K, T_target_source[:3])
    matrix = np.empty((3, 4), np.float32)
    matrix[:, :3] = matmul(K_R[:, :3], resolution.K_inverse)
    matrix[:, 3] = K_R[:, 3] / resolution.focal_baseline_px_m
    return matrix


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
        self._marked_px = np.empty((height, width), np.float32)

    def warp(self, disparity_px: FloatImage, weight: GrayImage, T_target_source: FloatArray) -> Warped:
        """The image as the target camera sees it after a motion, shape (4, 4).

        Disparity and weight have shape (H, W); 0 = no surface. The larger weight wins between equal disparities.
        """
        forward, backward = (
            reprojection(self._resolution, T) for T in (T_target_source, inverse_rigid(T_target_source))
        )
        kinds = np.float32, np.uint8, np.float32, np.float32
        warped = Warped(*(np.empty(disparity_px.shape, kind) for kind in kinds))
        self._keys.fill(0)
        _splat(disparity_px, weight, forward, self._keys, self._marked_px)
        _read_keys(self._keys, warped.disparity_px, warped.weight)
        closed_px = np.asarray(cv2.morphologyEx(warped.disparity_px, cv2.MORPH_CLOSE, CRACK_KERNEL), np.float32)
        closed_weight = np.asarray(cv2.morphologyEx(warped.weight, cv2.MORPH_CLOSE, CRACK_KERNEL), np.uint8)
        _trace_back(closed_px, closed_weight, backward, warped)
        _resample(self._marked_px, backward, warped)
        return warped

    def motion_px2(self, warped: Warped) -> float:
        """The mean squared distance by which the surfaces of the image have moved, in its pixels; 0 without any."""
        return _mean_motion_px2(warped)


@compiled(ROW_TYPE(FLOAT_IMAGE, int64))
def _row(matrix: FloatImage, axis: int) -> Row:
    """One row of a map."""
    return matrix[axis, 0], matrix[axis, 1], matrix[axis, 2], matrix[axis, 3]


@compiled_part(float32(ROW_TYPE, int64, int64, float32))
def _numerator(map_row: Row, row: int, col: int, disparity_px: float) -> float:
    """One row of `H (u, v, 1) + e D`."""
    of_col: float = map_row[0] * float32(col) + map_row[2]
    of_row: float = map_row[1] * float32(row)
    return map_row[3] * disparity_px + of_col + of_row


@compiled_part(float32(ROW_TYPE, int64, int64, float32))
def _inverse_depth_ratio(map_row: Row, row: int, col: int, disparity_px: float) -> float:
    """The inverse of the last row of the map; 0 for points behind the camera."""
    ratio = _numerator(map_row, row, col, disparity_px)
    inverse: float = float32(1) / ratio if ratio > MIN_DEPTH_RATIO else float32(0)
    return inverse


@compiled(void(FLOAT_IMAGE, BYTE_IMAGE, FLOAT_IMAGE, uint32[:, ::1], FLOAT_IMAGE))
def _splat(
    disparity_px: FloatImage,
    weight: GrayImage,
    forward: FloatImage,
    # output
    keys: npt.NDArray[np.uint32],
    marked_px: FloatImage,
) -> None:
    """Write each pixel to the z-buffer, whose keys are disparity first and weight second, and start at 0.

    The second output is the disparity with `HOLE_PX` in holes. The places and keys of a row are known before any of
    them is written.
    """
    height, width = disparity_px.shape
    forward_x, forward_y, forward_z = _row(forward, 0), _row(forward, 1), _row(forward, 2)
    target_row, target_col, key = np.empty(width, np.int32), np.empty(width, np.int32), np.empty(width, np.uint32)
    for row in range(height):
        for col in range(width):
            pixel_px = disparity_px[row, col]
            marked_px[row, col] = pixel_px if pixel_px > 0 else HOLE_PX
            inverse = _inverse_depth_ratio(forward_z, row, col, pixel_px)
            y = np.rint(_numerator(forward_y, row, col, pixel_px) * inverse)
            x = np.rint(_numerator(forward_x, row, col, pixel_px) * inverse)
            target_row[col] = int32(min(max(y, float32(-1)), float32(height)))
            target_col[col] = int32(min(max(x, float32(-1)), float32(width)))
            target_px = pixel_px * inverse
            # Truncation would move the memory away a little in every frame.
            units = int32(np.rint(target_px * UNITS_PER_PX)) if target_px <= MAX_DISPARITY_PX else int32(0)
            key[col] = (uint32(units) << WEIGHT_BITS) | uint32(weight[row, col])
        for col in range(width):
            v, u = target_row[col] + 1, target_col[col] + 1
            keys[v, u] = max(keys[v, u], key[col])


@compiled(void(uint32[:, ::1], FLOAT_IMAGE, BYTE_IMAGE))
def _read_keys(
    keys: npt.NDArray[np.uint32],
    # output
    disparity_px: FloatImage,
    weight: GrayImage,
) -> None:
    """Disparity and weight of the keys without their margin; both are 0 where there is no surface."""
    for row in range(disparity_px.shape[0]):
        for col in range(disparity_px.shape[1]):
            key = keys[row + 1, col + 1]
            units = int32(key >> WEIGHT_BITS)
            disparity_px[row, col] = float32(units) / UNITS_PER_PX
            weight[row, col] = uint8(key & WEIGHT_MASK) if units > 0 else uint8(0)


@compiled(void(FLOAT_IMAGE, BYTE_IMAGE, FLOAT_IMAGE, WARPED_TYPE))
def _trace_back(
    closed_px: FloatImage,
    closed_weight: GrayImage,
    backward: FloatImage,
    # input and output
    warped: Warped,
) -> None:
    """Fill the cracks, and find the position of each pixel in the source image."""
    backward_x, backward_y, backward_z = _row(backward, 0), _row(backward, 1), _row(backward, 2)
    for row in range(closed_px.shape[0]):
        for col in range(closed_px.shape[1]):
            near_px, near_weight = closed_px[row, col], closed_weight[row, col]
            own_px, own_weight = warped.disparity_px[row, col], warped.weight[row, col]
            disparity_px = own_px if own_px > 0 else near_px
            inverse = _inverse_depth_ratio(backward_z, row, col, disparity_px)
            warped.disparity_px[row, col] = disparity_px
            warped.weight[row, col] = own_weight if own_px > 0 else near_weight
            warped.source_x[row, col] = _numerator(backward_x, row, col, disparity_px) * inverse
            warped.source_y[row, col] = _numerator(backward_y, row, col, disparity_px) * inverse


@compiled(float64(WARPED_TYPE))
def _mean_motion_px2(warped: Warped) -> float:
    """The mean squared distance between the pixels of the surfaces and their positions in the source image."""
    total_px2, n_surfaces = 0.0, 0
    for row in range(warped.weight.shape[0]):
        for col in range(warped.weight.shape[1]):
            x_px, y_px = warped.source_x[row, col] - float32(col), warped.source_y[row, col] - float32(row)
            is_known = warped.weight[row, col] > 0
            total_px2 += float64(x_px * x_px + y_px * y_px) if is_known else 0.0
            n_surfaces += is_known
    return total_px2 / max(n_surfaces, 1)


@compiled(void(FLOAT_IMAGE, FLOAT_IMAGE, WARPED_TYPE))
def _resample(
    marked_px: FloatImage,
    backward: FloatImage,
    # input and output
    warped: Warped,
) -> None:
    """Replace the disparity of each pixel by its sample in the source image, where that is of the same surface."""
    backward_z = _row(backward, 2)
    disparity_px = warped.disparity_px
    for row in range(marked_px.shape[0]):
        for col in range(marked_px.shape[1]):
            splatted_px = disparity_px[row, col]
            depth_ratio = _numerator(backward_z, row, col, splatted_px)
            sampled_px = bilinear(marked_px, warped.source_x[row, col], warped.source_y[row, col], float32(HOLE_PX))
            resampled_px = sampled_px * depth_ratio
            is_same = (abs(resampled_px - splatted_px) < MAX_RESAMPLING_CHANGE_PX) & (splatted_px > 0)
            disparity_px[row, col] = resampled_px if is_same else splatted_px
