"""Interpolation of holes along rows and columns, between the surfaces that are measured at their ends."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from pydantic import Field

from ..model import Model
from ..types import FloatArray, FloatImage, GrayImage, MaskImage
from .confidence import INPAINTING

Indices = npt.NDArray[np.intp]

END_SPACING_PX, FAR_SPACING_PX = 1, 2
"""Spacing of the three working pixels whose median is the disparity at an end of a hole: one of them may be an outlier.
It is larger for the far side of a depth discontinuity, whose border may be a mixture of both sides."""


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


class _Estimate(NamedTuple):
    """The estimate of N hole pixels along one axis, each of shape (N,)."""

    disparity_px: FloatArray
    """Disparity; 0 if neither end is measured."""
    weight: FloatArray
    """Inverse square of the distance to the end that counts; a quarter of that if there is only one end."""
    distance_px: FloatArray
    """Distance to the nearer end [px]; infinite unless there are two."""
    has_step: MaskImage
    """Whether there is a depth discontinuity between both ends."""


def interpolate_holes(disparity_px: FloatImage, decimation: int, config: ScanlinesConfig) -> Interpolated:
    """Interpolate the holes of a disparity image, shape (h, w), between the ends of their rows and columns.

    Between two ends on one surface the disparity is linear. Between a near and a far end of a row, the hole shows the
    far surface: one camera of a stereo pair does not see a strip of the background beside a near object.
    """
    row, col = at = np.nonzero(disparity_px == 0)
    rows = _estimate(disparity_px, row, col, decimation, config)
    columns = _estimate(np.ascontiguousarray(disparity_px.T), col, row, decimation, config)
    value_px = np.where(rows.has_step, rows.disparity_px, _combine(rows, columns, config))
    determined = rows.has_step | (np.minimum(rows.distance_px, columns.distance_px) <= config.max_distance_px)
    both = (rows.weight > 0) & (columns.weight > 0)
    residual_px = np.where(both, np.abs(rows.disparity_px - columns.disparity_px), np.inf)
    probability = np.where(rows.has_step, INPAINTING.background.at(residual_px), INPAINTING.interpolated.at(residual_px))
    result = Interpolated(
        disparity_px=np.zeros_like(disparity_px),
        probability=np.zeros_like(disparity_px),
        background=np.zeros(disparity_px.shape, np.uint8),
    )
    result.disparity_px[at] = value_px * determined
    result.probability[at] = probability * determined
    result.background[at] = np.uint8(255) * rows.has_step
    return result


def _combine(rows: _Estimate, columns: _Estimate, config: ScanlinesConfig) -> FloatArray:
    """The mean of the estimates along rows and columns by weight, or that of more weight if they contradict."""
    total = np.maximum(rows.weight + columns.weight, 1e-12)
    mean_px = (rows.weight * rows.disparity_px + columns.weight * columns.disparity_px) / total
    nearer_end_px = np.where(rows.weight >= columns.weight, rows.disparity_px, columns.disparity_px)
    both = (rows.weight > 0) & (columns.weight > 0)
    contradict = both & _differ(rows.disparity_px, columns.disparity_px, config)
    return np.where(contradict, nearer_end_px, mean_px)


def _differ(one_px: FloatArray, other_px: FloatArray, config: ScanlinesConfig) -> MaskImage:
    """Whether two disparities are of different surfaces."""
    difference_px: FloatArray = np.abs(one_px - other_px)
    different: MaskImage = difference_px > config.min_step_px + config.relative_step * np.maximum(one_px, other_px)
    return different


def _estimate(
    disparity_px: FloatImage, row: Indices, col: Indices, decimation: int, config: ScanlinesConfig
) -> _Estimate:
    """The estimate along the rows of an image, shape (h, w), at some of its holes."""
    width = disparity_px.shape[1]
    valid, every_col = disparity_px > 0, np.arange(width)
    before = np.maximum.accumulate(np.where(valid, every_col, -1), axis=1)[row, col]
    after = np.minimum.accumulate(np.where(valid, every_col, width)[:, ::-1], axis=1)[:, ::-1][row, col]
    to_before, to_after = col - before, after - col
    before_px, after_px = _ends(disparity_px, row, before, after, END_SPACING_PX)
    far_before_px, far_after_px = _ends(disparity_px, row, before, after, FAR_SPACING_PX)
    has_before, has_after = before >= 0, after < width
    is_between = has_before & has_after
    max_slant_px = config.min_gradient * decimation * (after - before)
    has_step = is_between & _differ(before_px, after_px, config) & (np.abs(before_px - after_px) > max_slant_px)
    linear_px = (before_px * to_after + after_px * to_before) / (after - before)
    one_sided_px = np.where(has_before, before_px, after_px)
    nearest = np.where(is_between, np.minimum(to_before, to_after), np.where(has_before, to_before, to_after))
    far_px = np.where(before_px < after_px, far_before_px, far_after_px)
    return _Estimate(
        disparity_px=np.where(has_step, far_px, np.where(is_between, linear_px, one_sided_px)),
        weight=np.where(is_between, 1.0, 0.25) * (has_before | has_after) / np.square(nearest.astype(np.float64)),
        distance_px=np.where(is_between, decimation * nearest, np.inf),
        has_step=has_step,
    )


def _ends(
    disparity_px: FloatImage, row: Indices, before: Indices, after: Indices, spacing: int
) -> tuple[FloatArray, FloatArray]:
    """Disparity before and after each hole of a row, shape (N,): the median of three pixels; 0 = the image ends."""
    width = disparity_px.shape[1]
    medians = []
    for end, direction, exists in ((before, -1, before >= 0), (after, 1, after < width)):
        cols = np.clip(end + direction * spacing * np.arange(3)[:, None], 0, width - 1)
        samples_px = disparity_px[row, cols]
        samples_px = np.where(samples_px > 0, samples_px, samples_px[0])
        medians.append(np.where(exists, np.sort(samples_px, axis=0)[1], 0))
    return medians[0], medians[1]
