"""Forward warping of the memory to another camera pose, with the values resampled backward."""

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from numba import float32, int32, int64, types, uint8, uint32, void

from ..compiled import BYTE_IMAGE, FLOAT_IMAGE, compiled
from ..geometry import inverse_rigid
from ..types import FloatArray, FloatImage, GrayImage
from .memory import DRIFT_DECIMATION, MEMORY_TYPE, Memory
from .masks import Image
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

Row = tuple[np.float32, np.float32, np.float32, np.float32]
Reprojection = tuple[Row, Row, Row]
"""The projective map of pixels with disparity: (u, v, D) moves to `H (u, v, 1) + e D`, divided by its last row.

That divisor is the ratio of the depths after and before, so the new disparity is D divided by it as well. H is the
infinite homography `K R K^-1`, shape (3, 3), and e is the epipole `K t / (f B)`, shape (3,). The map is `(H | e)`.
"""
ROW_TYPE = types.UniTuple(float32, 4)
REPROJECTION_TYPE = types.UniTuple(ROW_TYPE, 3)


def reprojection(resolution: WorkingResolution, T_target_source: FloatArray) -> Reprojection:
    """The map of a motion, shape (4, 4)."""
    K = resolution.K
    H = K @ T_target_source[:3, :3] @ np.linalg.inv(K)
    e = K @ T_target_source[:3, 3] / resolution.focal_baseline_px_m
    rows: Any = tuple(tuple(row) for row in np.column_stack([H, e]).astype(np.float32))
    return rows


class ForwardWarp:
    """Warps a memory to the pose of another camera.

    1. Each pixel is splatted to the nearest pixel of the target; a z-buffer keeps the nearest surface.
    2. Cracks of one pixel are closed.
    3. Each target pixel is traced back to the source image, and its values are sampled there with subpixel accuracy.
    """

    def __init__(self, resolution: WorkingResolution) -> None:
        self._resolution = resolution
        height, width = resolution.shape
        # A border of one pixel catches the points that fall outside of the image.
        self._keys = np.empty((height + 2, width + 2), np.uint32)
        self._source_x, self._source_y, self._marked_px = np.empty((3, height, width), np.float32)

    def warp(self, memory: Memory, T_target_source: FloatArray) -> Memory:
        """The memory as the target camera sees it after a motion, shape (4, 4).

        The larger weight wins between equal disparities.
        """
        forward = reprojection(self._resolution, T_target_source)
        backward = reprojection(self._resolution, inverse_rigid(T_target_source))
        source_x, source_y, marked_px = self._source_x, self._source_y, self._marked_px
        disparity_px, weight = np.empty_like(memory.disparity_px), np.empty_like(memory.weight)
        self._keys.fill(0)
        _splat(memory, forward, self._keys, marked_px)
        _read_keys(self._keys, disparity_px, weight)
        closed_px = np.asarray(cv2.morphologyEx(disparity_px, cv2.MORPH_CLOSE, CRACK_KERNEL), np.float32)
        closed_weight = np.asarray(cv2.morphologyEx(weight, cv2.MORPH_CLOSE, CRACK_KERNEL), np.uint8)
        _trace_back(closed_px, closed_weight, backward, disparity_px, weight, source_x, source_y)
        sampled_px = cv2.remap(
            marked_px, source_x, source_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=float(HOLE_PX)
        )
        _resample(np.asarray(sampled_px, np.float32), backward, forward[2][3], disparity_px)
        coarse = memory.drift_px.shape
        return Memory(
            disparity_px=disparity_px,
            weight=weight,
            gray=_sample(memory.gray, source_x, source_y),
            age=_sample(memory.age, source_x, source_y, cv2.INTER_NEAREST),
            drift_px=_sample(memory.drift_px, *(_coarse_position(source, coarse) for source in (source_x, source_y))),
        )


@compiled(float32(ROW_TYPE, int64, int64, float32))
def _numerator(map_row: Row, row: int, col: int, disparity_px: np.float32) -> np.float32:
    """One row of `H (u, v, 1) + e D`."""
    of_col = map_row[0] * float32(col) + map_row[2]
    return map_row[3] * disparity_px + of_col + map_row[1] * float32(row)


@compiled(float32(ROW_TYPE, int64, int64, float32))
def _inverse_depth_ratio(map_row: Row, row: int, col: int, disparity_px: np.float32) -> np.float32:
    """The inverse of the last row of the map; 0 for points behind the camera."""
    ratio = _numerator(map_row, row, col, disparity_px)
    return float32(1) / ratio if ratio > MIN_DEPTH_RATIO else float32(0)


@compiled(void(MEMORY_TYPE, REPROJECTION_TYPE, uint32[:, ::1], FLOAT_IMAGE))
def _splat(
    memory: Memory,
    forward: Reprojection,
    # output
    keys: npt.NDArray[np.uint32],
    marked_px: FloatImage,
) -> None:
    """Write each pixel to the z-buffer, whose keys are disparity first and weight second, and start at 0.

    The second output is the disparity with `HOLE_PX` in holes.
    """
    height, width = memory.disparity_px.shape
    target_row, target_col, key = np.empty(width, np.int32), np.empty(width, np.int32), np.empty(width, np.uint32)
    for row in range(height):
        for col in range(width):
            disparity_px = memory.disparity_px[row, col]
            marked_px[row, col] = disparity_px if disparity_px > 0 else HOLE_PX
            inverse = _inverse_depth_ratio(forward[2], row, col, disparity_px)
            y = np.rint(_numerator(forward[1], row, col, disparity_px) * inverse)
            x = np.rint(_numerator(forward[0], row, col, disparity_px) * inverse)
            target_row[col] = int32(min(max(y, float32(-1)), float32(height)))
            target_col[col] = int32(min(max(x, float32(-1)), float32(width)))
            target_px = disparity_px * inverse
            # Truncation would move the memory away a little in every frame.
            units = int32(np.rint(target_px * UNITS_PER_PX)) if target_px <= MAX_DISPARITY_PX else int32(0)
            key[col] = (uint32(units) << WEIGHT_BITS) | uint32(memory.weight[row, col])
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
    """Disparity and weight of the keys without their border; both are 0 where there is no surface."""
    for row in range(disparity_px.shape[0]):
        for col in range(disparity_px.shape[1]):
            key = keys[row + 1, col + 1]
            units = int32(key >> WEIGHT_BITS)
            disparity_px[row, col] = float32(units) / UNITS_PER_PX
            weight[row, col] = uint8(key & WEIGHT_MASK) if units > 0 else uint8(0)


@compiled(void(FLOAT_IMAGE, BYTE_IMAGE, REPROJECTION_TYPE, FLOAT_IMAGE, BYTE_IMAGE, FLOAT_IMAGE, FLOAT_IMAGE))
def _trace_back(
    closed_px: FloatImage,
    closed_weight: GrayImage,
    backward: Reprojection,
    # input and output
    splatted_px: FloatImage,
    weight: GrayImage,
    # output
    source_x: FloatImage,
    source_y: FloatImage,
) -> None:
    """Fill the cracks, and find the position of each pixel in the source image."""
    for row in range(closed_px.shape[0]):
        for col in range(closed_px.shape[1]):
            is_crack = splatted_px[row, col] == 0
            disparity_px = closed_px[row, col] if is_crack else splatted_px[row, col]
            inverse = _inverse_depth_ratio(backward[2], row, col, disparity_px)
            source_x[row, col] = _numerator(backward[0], row, col, disparity_px) * inverse
            source_y[row, col] = _numerator(backward[1], row, col, disparity_px) * inverse
            splatted_px[row, col] = disparity_px
            weight[row, col] = closed_weight[row, col] if is_crack else weight[row, col]


@compiled(void(FLOAT_IMAGE, REPROJECTION_TYPE, float32, FLOAT_IMAGE))
def _resample(
    sampled_px: FloatImage,
    backward: Reprojection,
    e_z: np.float32,
    # input and output
    disparity_px: FloatImage,
) -> None:
    """Replace the disparity of each pixel by its sample in the source image, where that is of the same surface.

    The position of the sample was computed with the splatted disparity, so the depth ratio, whose rate of change is
    `e_z`, is corrected for that of the sample.
    """
    for row in range(sampled_px.shape[0]):
        for col in range(sampled_px.shape[1]):
            splatted_px = disparity_px[row, col]
            inverse = _inverse_depth_ratio(backward[2], row, col, splatted_px)
            ratio = (sampled_px[row, col] - splatted_px * inverse) * e_z + inverse
            resampled_px = sampled_px[row, col] / max(ratio, MIN_DEPTH_RATIO)
            is_same = (abs(resampled_px - splatted_px) < MAX_RESAMPLING_CHANGE_PX) & (splatted_px > 0)
            disparity_px[row, col] = resampled_px if is_same else splatted_px


def _sample(image: Image, x: FloatImage, y: FloatImage, interpolation: int = cv2.INTER_LINEAR) -> Image:
    """Samples of an image at columns x and rows y, with the border replicated."""
    return np.asarray(cv2.remap(image, x, y, interpolation, borderMode=cv2.BORDER_REPLICATE))


def _coarse_position(position: FloatImage, shape: tuple[int, ...]) -> FloatImage:
    """Columns or rows of the memory as those of the decimated drift, averaged to its shape."""
    mean: FloatImage = np.asarray(cv2.resize(position, shape[::-1], interpolation=cv2.INTER_AREA), np.float32)
    return (mean - np.float32((DRIFT_DECIMATION - 1) / 2)) / np.float32(DRIFT_DECIMATION)
