"""The measurement of one frame at the working resolution."""

from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
from numba import float32, int32, int64, void

from ..compiled import BYTE_IMAGE, FLOAT_IMAGE, READABLE_IMAGE, compiled, named_tuple
from ..types import FloatImage, Frame, GrayImage
from .masks import above, box_mean
from .memory import WEIGHT_UNIT
from .working_resolution import MAX_DISPARITY_PX, WorkingResolution, disparity_of

Indices = npt.NDArray[np.int32]

VALIDITY_WINDOW_PX = 5
"""Window in which the valid neighbours of a pixel are counted: most pixels at the border of holes are wrong."""
MAX_SURFACE_SPAN_PX = float32(1)
"""Blocks of two by two pixels whose disparities span less are averaged; others show two surfaces. Adjacent pixels of
one surface differ by at most as much."""
MAX_SPECK_PX = 16
"""Largest number of working pixels of a speck."""
SPECK_RADIUS_PX = 3
"""Distance along each axis to which the background of a speck is searched."""
_BLOCK_VALIDITY = np.rint(255 * np.sqrt(np.arange(5) / 4)).astype(np.uint8)
"""Validity of a block in 0..255, by the number of its valid pixels: the square root of the valid fraction. The fraction
itself would leave too little weight to surfaces that are measured in sparse pixels only."""
_WEIGHT = np.maximum(1, np.rint(WEIGHT_UNIT * (np.arange(256) / 255) ** 4)).astype(np.uint8)
"""Weight by the mean validity of the neighbours: its fourth power."""


class Measurement(NamedTuple):
    """Disparity and gray image of one frame at the working resolution, shape (h, w)."""

    disparity_px: FloatImage
    """Disparity, float32; 0 = invalid."""
    weight: GrayImage
    """Weight in units of `1 / WEIGHT_UNIT`, uint8; 0 where invalid."""
    gray: GrayImage
    """Gray image, smoothed against photon noise, uint8."""


def measure(frame: Frame, resolution: WorkingResolution) -> Measurement:
    """Bring a frame to the working resolution, and weight its pixels."""
    if resolution.decimation == 1:
        disparity_px, gray = resolution.disparity(frame.depth_m), frame.gray
        validity = above(disparity_px, 0)
    else:
        disparity_px, validity = np.empty(resolution.shape, np.float32), np.empty(resolution.shape, np.uint8)
        _decimate(np.ascontiguousarray(frame.depth_m), resolution.focal_baseline_px_m, disparity_px, validity)
        even = frame.gray[: 2 * resolution.height_px, : 2 * resolution.width_px]
        gray = np.asarray(cv2.resize(even, resolution.shape[::-1], interpolation=cv2.INTER_AREA), np.uint8)
    _remove_near_specks(find_specks(disparity_px), disparity_px)
    weight = np.asarray(cv2.LUT(box_mean(validity, VALIDITY_WINDOW_PX), _WEIGHT), np.uint8)
    gray = np.asarray(cv2.GaussianBlur(gray, (3, 3), 0), np.uint8)
    return Measurement(disparity_px=disparity_px, weight=weight & above(disparity_px, 0), gray=gray)


MEASUREMENT_TYPE = named_tuple(Measurement, FLOAT_IMAGE, BYTE_IMAGE, BYTE_IMAGE)


def find_specks(disparity_px: FloatImage) -> GrayImage:
    """Mask of the surfaces of at most `MAX_SPECK_PX` pixels, shape (h, w).

    Adjacent pixels are of one surface if they differ by at most `MAX_SURFACE_SPAN_PX`.
    """
    speck = np.zeros(disparity_px.shape, np.uint8)
    run_of = np.empty(disparity_px.shape, np.int32)
    start, parent, size = np.empty((3, disparity_px.size + 1), np.int32)
    _mark_specks(disparity_px, run_of, start, parent, size, speck)
    return speck


@compiled(void(READABLE_IMAGE, float32, FLOAT_IMAGE, BYTE_IMAGE))
def _decimate(
    depth_m: FloatImage,
    focal_baseline_px_m: float,
    # output
    disparity_px: FloatImage,
    validity: GrayImage,
) -> None:
    """Disparity and validity of each block of two by two pixels, shape (h, w), of a depth image of shape (H, W).

    The disparity is the mean of a block that shows one surface. Of a block that shows two, it is that of the surface
    with more pixels, or else of the farther one.
    """
    for row in range(disparity_px.shape[0]):
        for col in range(disparity_px.shape[1]):
            a_m, b_m = depth_m[2 * row, 2 * col], depth_m[2 * row, 2 * col + 1]
            c_m, d_m = depth_m[2 * row + 1, 2 * col], depth_m[2 * row + 1, 2 * col + 1]
            a_px, b_px = disparity_of(a_m, focal_baseline_px_m), disparity_of(b_m, focal_baseline_px_m)
            c_px, d_px = disparity_of(c_m, focal_baseline_px_m), disparity_of(d_m, focal_baseline_px_m)
            n_valid = (a_px > 0) + (b_px > 0) + (c_px > 0) + (d_px > 0)
            mean_px = (a_px + b_px + c_px + d_px) / np.float32(max(n_valid, 1))
            near_px = max(a_px, b_px, c_px, d_px)
            far_px = disparity_of(max(a_m, b_m, c_m, d_m), focal_baseline_px_m)
            surface_px = near_px if near_px - mean_px < mean_px - far_px else far_px
            disparity_px[row, col] = mean_px if near_px - far_px < MAX_SURFACE_SPAN_PX else surface_px
            validity[row, col] = _BLOCK_VALIDITY[n_valid]


@compiled("i4(i4[::1], i4)")
def _root(parent: Indices, run: int) -> int:
    """The run that stands for all that a run is joined to; the path to it is halved."""
    while parent[run] != run:
        parent[run] = parent[parent[run]]
        run = parent[run]
    return run


@compiled("b1(f4, f4)")
def _is_joined(a_px: float, b_px: float) -> bool:
    """Whether two adjacent pixels are of one surface, or both of none."""
    return (a_px > 0) == (b_px > 0) and abs(a_px - b_px) <= MAX_SURFACE_SPAN_PX


@compiled(int64(FLOAT_IMAGE, int32[:, ::1], int32[::1]))
def _divide_into_runs(
    disparity_px: FloatImage,
    # output
    run_of: Indices,
    start: Indices,
) -> int:
    """Number the runs of joined pixels along the rows; `start` is the first pixel of each in the flat image."""
    height, width = disparity_px.shape
    n_runs = 0
    for row in range(height):
        for col in range(width):
            if col == 0 or not _is_joined(disparity_px[row, col - 1], disparity_px[row, col]):
                start[n_runs] = row * width + col
                n_runs += 1
            run_of[row, col] = n_runs - 1
    start[n_runs] = height * width
    return n_runs


@compiled(void(FLOAT_IMAGE, int32[:, ::1], int32[::1], int64, int32[::1], int32[::1]))
def _join_runs(
    disparity_px: FloatImage,
    run_of: Indices,
    start: Indices,
    run: int,
    # input and output
    parent: Indices,
    size: Indices,
) -> None:
    """Join a run with those above and below it in a disjoint-set forest."""
    height, width = disparity_px.shape
    row, first_col = divmod(start[run], width)
    for col in range(first_col, first_col + start[run + 1] - start[run]):
        for other_row in range(max(row - 1, 0), min(row + 2, height)):
            if _is_joined(disparity_px[row, col], disparity_px[other_row, col]):
                root, other = _root(parent, run), _root(parent, run_of[other_row, col])
                if root != other:
                    parent[root] = other
                    size[other] += size[root]


@compiled(void(FLOAT_IMAGE, int32[:, ::1], int32[::1], int32[::1], int32[::1], BYTE_IMAGE))
def _mark_specks(
    disparity_px: FloatImage,
    # buffers
    run_of: Indices,
    start: Indices,
    parent: Indices,
    size: Indices,
    # output
    speck: GrayImage,
) -> None:
    """Join the runs that are short enough for a speck to surfaces, and mark those of small ones."""
    width, n_runs = disparity_px.shape[1], _divide_into_runs(disparity_px, run_of, start)
    for run in range(n_runs):
        parent[run], size[run] = run, start[run + 1] - start[run]
    for run in range(n_runs):
        if start[run + 1] - start[run] <= MAX_SPECK_PX:
            _join_runs(disparity_px, run_of, start, run, parent, size)
    for run in range(n_runs):
        row, col = divmod(start[run], width)
        if disparity_px[row, col] > 0 and size[_root(parent, run)] <= MAX_SPECK_PX:
            speck[row, col : col + start[run + 1] - start[run]] = 255


@compiled("f4(f4[:, ::1], u1[:, ::1], i8, i8)")
def _background(disparity_px: FloatImage, speck: GrayImage, row: int, col: int) -> float:
    """Disparity of the farthest surface around a pixel that is no speck; the largest possible one if there is none."""
    height, width = disparity_px.shape
    background_px: float = MAX_DISPARITY_PX
    for v in range(max(row - SPECK_RADIUS_PX, 0), min(row + SPECK_RADIUS_PX + 1, height)):
        for u in range(max(col - SPECK_RADIUS_PX, 0), min(col + SPECK_RADIUS_PX + 1, width)):
            if disparity_px[v, u] > 0 and not speck[v, u]:
                background_px = min(background_px, disparity_px[v, u])
    return background_px


@compiled(void(BYTE_IMAGE, FLOAT_IMAGE))
def _remove_near_specks(
    speck: GrayImage,
    # input and output
    disparity_px: FloatImage,
) -> None:
    """Remove the specks that are nearer than the farthest larger surface around them.

    Such specks are wrong matches more often than objects. Farther ones may be all that is visible of the background.
    """
    for row in range(disparity_px.shape[0]):
        for col in range(disparity_px.shape[1]):
            if speck[row, col]:
                background_px = _background(disparity_px, speck, row, col)
                if disparity_px[row, col] >= background_px + MAX_SURFACE_SPAN_PX:
                    disparity_px[row, col] = 0
