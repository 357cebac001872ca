"""Interpolation of holes along rows and columns, between the surfaces that are measured at their ends."""

from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
from pydantic import Field

from ..model import Model
from ..types import FloatImage, GrayImage, MaskImage
from .confidence import BACKGROUND, INTERPOLATED
from .masks import above
from .measurement import find_specks

Indices = npt.NDArray[np.integer]

END_SPACING_PX, FAR_SPACING_PX = 1, 2
"""Spacing of the three working pixels whose median is the disparity at an end of a hole: one of them may be an outlier.
It is larger for the far side of a depth discontinuity, whose border may be a mixture of both sides."""
UNCONFIRMED_PX = 3.0
"""Difference of the estimates along row and column that the probability of a hole with only one of them is that of."""


class ScanlinesConfig(Model):
    """How holes are interpolated along rows and columns."""

    min_step_px: float = Field(1.0, gt=0)
    """Disparity by which the ends of a hole must differ, besides the relative step, for a depth discontinuity."""
    relative_step: float = Field(0.03, ge=0)
    """Fraction of the disparity that is added to that."""
    min_gradient: float = Field(0.3, ge=0)
    """Change of disparity per pixel of the full image between the ends up to which both may be on one slanted surface.
    The gradient over an occlusion shadow is 1, or less if depth is aligned to a camera farther to the side."""
    max_distance_px: float = Field(12.0, ge=0)
    """Distance to the nearer end, in pixels of the full image, up to which a smooth surface is interpolated."""


class Interpolated(NamedTuple):
    """Disparity in the holes that the ends of their rows and columns determine, shape (h, w)."""

    disparity_px: FloatImage
    """Disparity; 0 where it is measured, or where no end is near enough."""
    probability: FloatImage
    """Probability in 0..1 that it is of the right surface."""
    background: GrayImage
    """Mask of the pixels between a near and a far end of their row, uint8."""


class _Runs(NamedTuple):
    """The holes of the lines of an image: N runs of unmeasured pixels, along its rows or along its columns."""

    run: npt.NDArray[np.int32]
    """Run of each hole pixel, shape (h, w); arbitrary elsewhere."""
    line: npt.NDArray[np.int32]
    """Row or column of each run, shape (N,)."""
    before: npt.NDArray[np.int32]
    """Position before each run, shape (N,); -1 if it begins at the border of the image."""
    after: npt.NDArray[np.int32]
    """Position after each run, shape (N,); the length of the line if it ends at the border of the image."""
    before_px: FloatImage
    """Disparity before each run, shape (N,); 0 at the border."""
    after_px: FloatImage
    """Disparity after each run, shape (N,); 0 at the border."""
    far_px: FloatImage
    """Disparity of the farther end, shape (N,)."""
    has_step: MaskImage
    """Whether there is a depth discontinuity between both ends, shape (N,)."""


class _Estimate(NamedTuple):
    """The estimate of M hole pixels along one axis, each of shape (M,)."""

    disparity_px: FloatImage
    """Disparity; 0 if neither end is measured."""
    weight: FloatImage
    """Inverse square of the distance to the end that counts; a quarter of that if there is only one end."""


def interpolate_holes(disparity_px: FloatImage, decimation: int, config: ScanlinesConfig) -> Interpolated:
    """Interpolate the holes of a disparity image, shape (h, w), between the ends of their rows and columns.

    Between two ends on one surface the disparity is linear. Between a near and a far end of a row, the hole shows the
    far surface: one camera of a stereo pair does not see a strip of the background beside a near object.
    """
    speck = find_specks(disparity_px)
    rows = _runs(disparity_px, speck, decimation, config)
    columns = _runs(np.ascontiguousarray(disparity_px.T), speck.T, decimation, config)
    reach = int(config.max_distance_px) // decimation
    row, col = np.nonzero(_near_ends(disparity_px, reach) | _with_steps(rows, disparity_px.shape))
    is_background = rows.has_step[rows.run[row, col]]
    distance = np.minimum(_distance(rows, row, col), _distance(columns, col, row))
    determined = is_background | (distance <= reach)
    row, col, is_background = row[determined], col[determined], is_background[determined]
    along_row, along_column = _estimate(rows, row, col), _estimate(columns, col, row)
    both = (along_row.weight > 0) & (along_column.weight > 0)
    residual_px = np.where(both, np.abs(along_row.disparity_px - along_column.disparity_px), np.float32(UNCONFIRMED_PX))
    result = Interpolated(
        disparity_px=np.zeros_like(disparity_px),
        probability=np.zeros_like(disparity_px),
        background=np.zeros(disparity_px.shape, np.uint8),
    )
    at = row, col
    result.disparity_px[at] = np.where(is_background, along_row.disparity_px, _combine(along_row, along_column, config))
    result.probability[at] = np.where(is_background, BACKGROUND.at(residual_px), INTERPOLATED.at(residual_px))
    result.background[at] = np.where(is_background, np.uint8(255), np.uint8(0))
    return result


def _runs(disparity_px: FloatImage, speck: GrayImage, decimation: int, config: ScanlinesConfig) -> _Runs:
    """The holes of the rows of an image, shape (h, w).

    No surface is slanted towards a speck that is nearer than the other end: it would become an obstacle.
    """
    height, width = disparity_px.shape
    # A measured column on either side separates the rows of the flat image.
    hole = np.zeros((height, width + 2), np.bool_)
    np.equal(disparity_px, 0, out=hole[:, 1:-1])
    change = np.flatnonzero(hole.ravel()[1:] != hole.ravel()[:-1]).astype(np.int32)
    first, last = change[::2], change[1::2]
    row = first // np.int32(width + 2)
    before, after = first - row * np.int32(width + 2) - 1, last - row * np.int32(width + 2)
    run = np.zeros(hole.shape, np.int32)
    run[hole] = np.repeat(np.arange(len(row), dtype=np.int32), after - before - 1)
    has_before, has_after = before >= 0, after < width
    near_the_end, behind_the_end = (
        [
            np.where(exists, _median_of_three(disparity_px, row, end, direction * spacing), np.float32(0))
            for end, direction, exists in ((before, -1, has_before), (after, 1, has_after))
        ]
        for spacing in (END_SPACING_PX, FAR_SPACING_PX)
    )
    before_px, after_px = near_the_end
    max_slant_px = np.float32(config.min_gradient * decimation) * (after - before).astype(np.float32)
    near_end = np.where(before_px > after_px, before, np.minimum(after, width - 1))
    is_steep = (np.abs(before_px - after_px) > max_slant_px) | (speck[row, near_end] > 0)
    return _Runs(
        run=run[:, 1:-1],
        line=row,
        before=before,
        after=after,
        before_px=before_px,
        after_px=after_px,
        far_px=np.where(before_px < after_px, *behind_the_end),
        has_step=has_before & has_after & is_steep & _differ(before_px, after_px, config),
    )


def _median_of_three(disparity_px: FloatImage, row: Indices, col: Indices, spacing: int) -> FloatImage:
    """The median of a pixel and of two others of its row beside it, which count as it does if they are holes."""
    width = disparity_px.shape[1]
    flat_px, start = disparity_px.ravel(), row * width
    a_px, b_px, c_px = (flat_px[start + np.clip(col + k * spacing, 0, width - 1)] for k in range(3))
    b_px, c_px = (np.where(each_px > 0, each_px, a_px) for each_px in (b_px, c_px))
    median_px: FloatImage = np.maximum(np.minimum(a_px, b_px), np.minimum(np.maximum(a_px, b_px), c_px))
    return median_px


def _near_ends(disparity_px: FloatImage, reach: int) -> MaskImage:
    """Mask of the holes within some working pixels of a measured pixel of their row or column."""
    valid, side = above(disparity_px, 0), 2 * reach + 1
    near = cv2.dilate(valid, cv2.getStructuringElement(cv2.MORPH_CROSS, (side, side)))
    return near > valid


def _with_steps(rows: _Runs, shape: tuple[int, ...]) -> MaskImage:
    """Mask of the runs along the rows that have a depth discontinuity between their ends."""
    line, before, after = (each[rows.has_step] for each in (rows.line, rows.before, rows.after))
    length = after - before - 1
    first = line * shape[1] + before + 1
    mask = np.zeros(shape, np.bool_)
    mask.ravel()[np.repeat(first - np.cumsum(length) + length, length) + np.arange(length.sum())] = True
    return mask


def _distance(runs: _Runs, line: Indices, position: Indices) -> FloatImage:
    """Distance of hole pixels to the nearer end of their run, in working pixels; infinite unless both are measured."""
    run = runs.run[line, position]
    nearest = np.minimum(position - runs.before[run], runs.after[run] - position).astype(np.float32)
    is_between = (runs.before_px > 0) & (runs.after_px > 0)
    return np.where(is_between[run], nearest, np.float32(np.inf))


def _estimate(runs: _Runs, line: Indices, position: Indices) -> _Estimate:
    """The estimate of some hole pixels along their lines."""
    run = runs.run[line, position]
    before_px, after_px, has_step = runs.before_px[run], runs.after_px[run], runs.has_step[run]
    to_before = (position - runs.before[run]).astype(np.float32)
    to_after = (runs.after[run] - position).astype(np.float32)
    linear_px = (before_px * to_after + after_px * to_before) / (to_before + to_after)
    one_sided_px = np.maximum(before_px, after_px)  # the other one is 0
    is_between = (before_px > 0) & (after_px > 0)
    distance = np.where(is_between, np.minimum(to_before, to_after), np.where(before_px > 0, to_before, to_after))
    share = np.where(is_between, np.float32(1), np.float32(0.25)) * (one_sided_px > 0).astype(np.float32)
    return _Estimate(
        disparity_px=np.where(has_step, runs.far_px[run], np.where(is_between, linear_px, one_sided_px)),
        weight=(share / np.square(distance)).astype(np.float32),
    )


def _combine(rows: _Estimate, columns: _Estimate, config: ScanlinesConfig) -> FloatImage:
    """The mean of the estimates along rows and columns by weight, or that of more weight if they contradict."""
    total = np.maximum(rows.weight + columns.weight, np.float32(1e-12))
    mean_px = (rows.weight * rows.disparity_px + columns.weight * columns.disparity_px) / total
    nearer_end_px = np.where(rows.weight >= columns.weight, rows.disparity_px, columns.disparity_px)
    both = (rows.weight > 0) & (columns.weight > 0)
    contradict = both & _differ(rows.disparity_px, columns.disparity_px, config)
    return np.where(contradict, nearer_end_px, mean_px)


def _differ(one_px: FloatImage, other_px: FloatImage, config: ScanlinesConfig) -> MaskImage:
    """Whether two disparities are of different surfaces."""
    tolerance_px = np.float32(config.min_step_px) + np.float32(config.relative_step) * np.maximum(one_px, other_px)
    different: MaskImage = np.abs(one_px - other_px) > tolerance_px
    return different
