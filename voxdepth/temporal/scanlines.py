"""Interpolation of holes along rows and columns, between the surfaces that are measured at their ends."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import boolean, float32, int32, int64, void
from numba.types import UniTuple
from pydantic import Field

from ..compiled import BYTE_IMAGE, FLOAT_IMAGE, compiled, named_tuple
from ..model import Model
from ..types import FloatImage, GrayImage, MaskImage
from .confidence import BACKGROUND, INTERPOLATED, exponential
from .measurement import MAX_SPECK_PX, MAX_SURFACE_SPAN_PX
from .working_resolution import WorkingResolution

Indices = npt.NDArray[np.int32]

END_SPACING_PX, FAR_SPACING_PX = 1, 2
"""Spacing of the three working pixels whose median is the disparity at an end of a hole: one of them may be an outlier.
It is larger for the far side of a depth discontinuity, whose border may be a mixture of both sides."""
ONLY_END = float32(0.25)
"""Factor of the weight of an estimate from one end only."""
UNCONFIRMED_PX = float32(3.0)
"""Difference of the estimates along row and column that the probability of a hole with only one of them is that of."""
NEIGHBOURS = ((-1, 0), (0, -1), (0, 1), (1, 0))
"""Steps to the pixels that may be of the same surface."""


class ScanlinesConfig(Model):
    """How holes are interpolated along rows and columns."""

    min_step_px: float = Field(default=1.0, gt=0)
    """Disparity by which the ends of a hole must differ, besides the relative step, for a depth discontinuity."""
    relative_step: float = Field(default=0.03, ge=0)
    """Fraction of the disparity that is added to that."""
    min_gradient: float = Field(default=0.3, ge=0)
    """Change of disparity per pixel of the matched images between the ends up to which both may be on one slanted
    surface. The gradient over an occlusion shadow is 1, or less if depth is aligned to a camera farther to the side."""
    max_distance_px: float = Field(default=12.0, ge=0)
    """Distance to the nearer end, in pixels of the full image, up to which a smooth surface is interpolated."""


class Limits(NamedTuple):
    """The bounds of the configuration in working pixels."""

    min_step_px: float
    relative_step: float
    min_gradient: float
    reach: int


class Runs(NamedTuple):
    """Runs of holes along the rows of an image. Those along columns are the runs of the transposed image."""

    place: Indices
    """Row, column before, and column behind each run, shape (N, 3). One of the columns may be out of the image."""
    ends_px: FloatImage
    """Disparity before and behind each run, 0 out of the image, and that of its background, shape (N, 3): the farther
    one of both if there is a depth discontinuity between them, else 0."""


class Interpolated(NamedTuple):
    """Disparity in the holes that the ends of their rows and columns determine, shape (h, w)."""

    disparity_px: FloatImage
    """Disparity; 0 where it is measured, or where no end is near enough."""
    probability: FloatImage
    """Probability in 0..1 that it is of the right surface; 0 in the same pixels."""
    background: GrayImage
    """Mask of the pixels between a near and a far end of their row, uint8."""


LIMITS = named_tuple(Limits, float32, float32, float32, int64)
PLACES = int32[:, ::1]
RUNS = named_tuple(Runs, PLACES, FLOAT_IMAGE)
INTERPOLATED_TYPE = named_tuple(Interpolated, FLOAT_IMAGE, FLOAT_IMAGE, BYTE_IMAGE)
ANY_IMAGE, ANY_MASK = float32[:, :], boolean[:, :]
"""Types of an image and of a mask that may be transposed."""


class ScanlineInterpolator:
    """Interpolates the holes of disparity images of one size between the ends of their rows and columns.

    Between two ends on one surface the disparity is linear. Between a near and a far end of a row, the hole shows the
    far surface: one camera of a stereo pair does not see a strip of the background beside a near object.
    """

    def __init__(self, resolution: WorkingResolution, config: ScanlinesConfig) -> None:
        self._limits = Limits(
            min_step_px=float32(config.min_step_px),
            relative_step=float32(config.relative_step),
            min_gradient=float32(config.min_gradient * resolution.matched_px),
            reach=int(config.max_distance_px) // resolution.decimation,
        )
        shape = resolution.shape
        self._column_at, self._is_near = np.empty(shape, np.int32), np.empty(shape, np.bool_)
        self._result = Interpolated(np.empty(shape, np.float32), np.empty(shape, np.float32), np.empty(shape, np.uint8))

    def interpolate(self, disparity_px: FloatImage) -> Interpolated:
        """Interpolate the holes of an image, shape (h, w). The next call overwrites the result."""
        row_places, column_places = find_runs(disparity_px, self._column_at)
        rows = Runs(row_places, find_ends(disparity_px, row_places, self._limits))
        columns = Runs(column_places, find_ends(disparity_px.T, column_places, self._limits))
        for image in (self._is_near, *self._result):
            image.fill(0)
        mark_near(rows, self._limits, self._is_near)
        mark_near(columns, self._limits, self._is_near.T)
        interpolate(rows, columns, self._column_at, self._is_near, self._limits, self._result)
        return self._result


@compiled(UniTuple(PLACES, 2)(FLOAT_IMAGE, PLACES))
def find_runs(
    disparity_px: FloatImage,
    # output
    column_at: Indices,
) -> tuple[Indices, Indices]:
    """The places of the runs along the rows, and along the columns; and the number of the latter at each hole.

    That number is arbitrary elsewhere.
    """
    height, width = disparity_px.shape
    rows = np.empty((height * ((width + 1) // 2), 3), np.int32)
    columns = np.empty((width * ((height + 1) // 2), 3), np.int32)
    n_rows = n_columns = 0
    open_column = np.full(width, -1, np.int32)
    for row in range(height):
        is_open = False
        for col in range(width):
            if disparity_px[row, col] > 0:
                if is_open:
                    rows[n_rows - 1, 2] = col
                    is_open = False
                if open_column[col] >= 0:
                    columns[open_column[col], 2] = row
                    open_column[col] = -1
                continue
            if not is_open:
                rows[n_rows, 0], rows[n_rows, 1], rows[n_rows, 2] = row, col - 1, width
                n_rows += 1
                is_open = True
            if open_column[col] < 0:
                columns[n_columns, 0], columns[n_columns, 1], columns[n_columns, 2] = col, row - 1, height
                open_column[col] = n_columns
                n_columns += 1
            column_at[row, col] = open_column[col]
    return rows[:n_rows], columns[:n_columns]


@compiled(boolean(float32, float32, LIMITS))
def _differ(one_px: float, other_px: float, limits: Limits) -> bool:
    """Whether two disparities are of different surfaces."""
    return abs(one_px - other_px) > limits.min_step_px + limits.relative_step * max(one_px, other_px)


@compiled(float32(ANY_IMAGE, int64, int64))
def _pixel(image_px: FloatImage, row: int, col: int) -> float:
    """Disparity of a pixel; 0 out of the image."""
    is_inside = 0 <= row < image_px.shape[0] and 0 <= col < image_px.shape[1]
    disparity_px: float = image_px[row, col] if is_inside else float32(0)
    return disparity_px


@compiled(boolean(int64[:, ::1], int64, int64, int64))
def _is_among(pixels: npt.NDArray[np.int64], n: int, row: int, col: int) -> bool:
    """Whether a pixel is one of the first n."""
    is_found = False
    for k in range(n):
        is_found |= pixels[k, 0] == row and pixels[k, 1] == col
    return is_found


@compiled(boolean(ANY_IMAGE, int64, int64))
def is_speck(image_px: FloatImage, row: int, col: int) -> bool:
    """Whether a pixel is one of `find_specks`: its surface is searched until it has more than `MAX_SPECK_PX` pixels."""
    surface = np.empty((MAX_SPECK_PX + len(NEIGHBOURS), 2), np.int64)
    surface[0, 0], surface[0, 1] = row, col
    n, n_done = 1, 0
    while n_done < n <= MAX_SPECK_PX:
        disparity_px = image_px[surface[n_done, 0], surface[n_done, 1]]
        for down, right in NEIGHBOURS:
            row, col = surface[n_done, 0] + down, surface[n_done, 1] + right
            beside_px = _pixel(image_px, row, col)
            is_joined = beside_px > 0 and abs(disparity_px - beside_px) <= MAX_SURFACE_SPAN_PX
            if is_joined and not _is_among(surface, n, row, col):
                surface[n, 0], surface[n, 1] = row, col
                n += 1
        n_done += 1
    return n <= MAX_SPECK_PX


@compiled(float32(ANY_IMAGE, int64, int64, int64))
def _end(image_px: FloatImage, row: int, col: int, step: int) -> float:
    """The median of the pixel at an end of a run and of two more in steps from it, which count as it does if they are
    holes; 0 out of the image.
    """
    last, a_px = image_px.shape[1] - 1, _pixel(image_px, row, col)
    b_px = image_px[row, min(max(col + step, 0), last)]
    c_px = image_px[row, min(max(col + 2 * step, 0), last)]
    b_px = b_px if b_px > 0 else a_px
    c_px = c_px if c_px > 0 else a_px
    median_px: float = max(min(a_px, b_px), min(max(a_px, b_px), c_px))
    return median_px


@compiled(FLOAT_IMAGE(ANY_IMAGE, PLACES, LIMITS))
def find_ends(image_px: FloatImage, places: Indices, limits: Limits) -> FloatImage:
    """The ends of runs along the rows of an image, shape (N, 3).

    No surface is slanted towards a speck that is nearer than the other end: it would become an obstacle.
    """
    ends_px: FloatImage = np.zeros((len(places), 3), np.float32)
    for run in range(len(places)):
        row, before, behind = places[run]
        before_px, behind_px = _end(image_px, row, before, -END_SPACING_PX), _end(image_px, row, behind, END_SPACING_PX)
        ends_px[run, 0], ends_px[run, 1] = before_px, behind_px
        if min(before_px, behind_px) > 0 and _differ(before_px, behind_px, limits):
            is_steep = abs(before_px - behind_px) > limits.min_gradient * float32(behind - before)
            if is_steep or is_speck(image_px, row, before if before_px > behind_px else behind):
                far, step = (before, -FAR_SPACING_PX) if before_px < behind_px else (behind, FAR_SPACING_PX)
                ends_px[run, 2] = _end(image_px, row, far, step)
    return ends_px


@compiled(void(RUNS, LIMITS, ANY_MASK))
def mark_near(
    runs: Runs,
    limits: Limits,
    # output
    is_near: MaskImage,
) -> None:
    """Mark the holes of rows within reach of an end of their run, if both ends are measured."""
    for run in range(len(runs.place)):
        row, before, behind = runs.place[run]
        if min(runs.ends_px[run, 0], runs.ends_px[run, 1]) > 0:
            for distance in range(1, min(limits.reach, behind - before - 1) + 1):
                is_near[row, before + distance] = True
                is_near[row, behind - distance] = True


ESTIMATE = UniTuple(float32, 2)


@compiled(ESTIMATE(RUNS, int64, int64))
def _estimate(runs: Runs, run: int, position: int) -> tuple[float, float]:
    """The estimate at a position in a run, and its weight: linear between two ends, the background, or the only end.

    The weight is the inverse square of the distance to the nearer end, and 0 if there is none.
    """
    before_px, behind_px, background_px = runs.ends_px[run]
    to_before, to_behind = float32(position - runs.place[run, 1]), float32(runs.place[run, 2] - position)
    if min(before_px, behind_px) > 0:
        distance, share = min(to_before, to_behind), float32(1)
        linear_px = (before_px * to_behind + behind_px * to_before) / (to_before + to_behind)
        disparity_px = background_px if background_px > 0 else linear_px
    else:
        distance, share = (to_before if before_px > 0 else to_behind), ONLY_END
        disparity_px = max(before_px, behind_px)
    weight = share / (distance * distance) if disparity_px > 0 else float32(0)
    return disparity_px, weight


@compiled(UniTuple(float32, 2)(ESTIMATE, ESTIMATE, LIMITS))
def _combine(along_row: tuple[float, float], along_column: tuple[float, float], limits: Limits) -> tuple[float, float]:
    """The mean of two estimates by weight, or that of more weight if they contradict; and their difference.

    At least one of them has a weight.
    """
    (row_px, row_weight), (column_px, column_weight) = along_row, along_column
    if min(row_weight, column_weight) == 0:
        return max(row_px, column_px), UNCONFIRMED_PX
    difference_px = abs(row_px - column_px)
    if _differ(row_px, column_px, limits):
        return (row_px if row_weight >= column_weight else column_px), difference_px
    return (row_weight * row_px + column_weight * column_px) / (row_weight + column_weight), difference_px


@compiled(void(RUNS, RUNS, PLACES, ANY_MASK, LIMITS, INTERPOLATED_TYPE))
def interpolate(
    rows: Runs,
    columns: Runs,
    column_at: Indices,
    is_near: MaskImage,
    limits: Limits,
    # output
    result: Interpolated,
) -> None:
    """Interpolate the holes near an end, and those with a background in their row. The result starts at 0."""
    for run in range(len(rows.place)):
        row, before, behind = rows.place[run]
        is_background = rows.ends_px[run, 2] > 0
        for col in range(before + 1, behind):
            if is_background or is_near[row, col]:
                along_row, along_column = _estimate(rows, run, col), _estimate(columns, column_at[row, col], row)
                combined_px, difference_px = _combine(along_row, along_column, limits)
                curve = BACKGROUND if is_background else INTERPOLATED
                result.disparity_px[row, col] = along_row[0] if is_background else combined_px
                result.probability[row, col] = exponential(curve, difference_px)
                result.background[row, col] = 255 if is_background else 0
