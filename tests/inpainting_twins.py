"""NumPy and OpenCV twins of the compiled loops of inpainting."""

from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from voxdepth.temporal.confidence import AGREEMENT, BACKGROUND, INPAINTING, INTERPOLATED
from voxdepth.temporal.ground import FARTHER_TOLERANCE, HORIZONS, ITERATIONS, MAX_OUTLIER_RATIO, GroundPlane
from voxdepth.temporal.measurement import find_specks
from voxdepth.temporal.planes import INSIDE, OUTSIDE, Bounds, CellEstimate, CellGrid
from voxdepth.temporal.scanlines import (
    END_SPACING_PX,
    FAR_SPACING_PX,
    ONLY_END,
    UNCONFIRMED_PX,
    Interpolated,
    ScanlinesConfig,
)
from voxdepth.temporal.sky import CELL_PX, GRAY_QUANTILE, MAX_KNOWN, MIN_SHARE
from voxdepth.temporal.stixels import GROUND_TOLERANCE, MIN_GROUND_ROWS, ON_GROUND
from voxdepth.types import FloatArray, FloatImage, GrayImage, MaskImage


class Run(NamedTuple):
    """A run of holes of a line, and its ends."""

    before: int
    after: int
    before_px: float
    after_px: float
    background_px: float

    def is_near(self, position: int, reach: int) -> bool:
        return min(self.before_px, self.after_px) > 0 and min(position - self.before, self.after - position) <= reach

    def estimate(self, position: int) -> tuple[float, float]:
        """Disparity and weight."""
        distances = np.float32([position - self.before, self.after - position])
        ends_px = np.array([self.before_px, self.after_px], np.float32)
        if ends_px.min() > 0:
            linear_px = np.float32(ends_px @ distances[::-1] / distances.sum())
            return self.background_px or linear_px, 1 / distances.min() ** 2
        if ends_px.max() == 0:
            return 0.0, 0.0
        return ends_px.max(), ONLY_END / distances[ends_px.argmax()] ** 2


def differ(one_px: float, other_px: float, config: ScanlinesConfig) -> bool:
    return abs(one_px - other_px) > config.min_step_px + config.relative_step * max(one_px, other_px)


def median_of_three(line_px: FloatImage, end: int, step: int) -> float:
    if not 0 <= end < len(line_px):
        return 0.0
    three_px = line_px[np.clip([end, end + step, end + 2 * step], 0, len(line_px) - 1)]
    return float(np.median(np.where(three_px > 0, three_px, three_px[0])))


def run_around(line_px: FloatImage, speck: GrayImage, position: int, decimation: int, config: ScanlinesConfig) -> Run:
    """The run that a hole of a line is in. The specks of the line are given as a mask."""
    valid = np.flatnonzero(line_px > 0)
    before = int(max(valid[valid < position], default=-1))
    after = int(min(valid[valid > position], default=len(line_px)))
    before_px = median_of_three(line_px, before, -END_SPACING_PX)
    after_px = median_of_three(line_px, after, END_SPACING_PX)
    background_px = 0.0
    if min(before_px, after_px) > 0 and differ(before_px, after_px, config):
        is_steep = abs(before_px - after_px) > config.min_gradient * decimation * (after - before)
        if is_steep or speck[before if before_px > after_px else after]:
            ends = (before, -FAR_SPACING_PX), (after, FAR_SPACING_PX)
            background_px = median_of_three(line_px, *ends[before_px > after_px])
    return Run(before, after, before_px, after_px, background_px)


def interpolate_holes(disparity_px: FloatImage, decimation: int, config: ScanlinesConfig) -> FloatArray:
    """Disparity, probability and background, shape (3, h, w)."""
    result, speck = np.zeros((3, *disparity_px.shape)), find_specks(disparity_px)
    reach = int(config.max_distance_px) // decimation
    for row, col in np.argwhere(disparity_px == 0):
        along_row = run_around(disparity_px[row], speck[row], col, decimation, config)
        along_column = run_around(disparity_px[:, col], speck[:, col], row, decimation, config)
        is_background = along_row.background_px > 0
        if is_background or along_row.is_near(col, reach) or along_column.is_near(row, reach):
            estimates_px, weights = np.transpose([along_row.estimate(col), along_column.estimate(row)])
            both = weights.min() > 0
            disparity = np.average(estimates_px, weights=weights)
            if both and differ(*estimates_px, config):
                disparity = estimates_px[weights.argmax()]
            difference_px = np.float64(abs(np.diff(estimates_px)[0]) if both else UNCONFIRMED_PX)
            curve = BACKGROUND if is_background else INTERPOLATED
            result[:, row, col] = (
                estimates_px[0] if is_background else disparity,
                curve.at(difference_px),
                255 * is_background,
            )
    return result


def sum_cells(disparity_px: FloatImage, valid_around: GrayImage, grid: CellGrid) -> FloatArray:
    cell_px, left, rows, cols = grid
    row, col = np.indices(disparity_px.shape)
    v, u = (row + 0.5) / cell_px - rows / 2, (col + left + 0.5) / cell_px - cols / 2
    d = disparity_px.astype(np.float64)
    validity = np.where(d > 0, valid_around / 255, 0)
    of_pixel = np.stack([u**0, u, v, u * u, u * v, v * v, d, u * d, v * d, d * d]) * validity**4
    moments = np.zeros((rows, cols, 11))
    np.add.at(moments, (row // cell_px, (col + left) // cell_px), np.moveaxis([*of_pixel, validity**2], 0, 2))
    return moments


def sum_neighbourhood(moments: FloatArray) -> FloatArray:
    """Each of the moments is an image."""
    kernel = np.outer([0.25, 0.5, 0.25], [0.25, 0.5, 0.25])
    images = np.moveaxis(moments, 2, 0)
    return np.stack([cv2.filter2D(image, -1, kernel, borderType=cv2.BORDER_CONSTANT) for image in images], axis=2)


def fit_planes(moments: FloatArray, size: float, grid: CellGrid, bounds: Bounds) -> tuple[FloatArray, FloatArray]:
    """Disparity and weight of the planes."""
    min_coverage, ridge, max_deviations_far, max_deviations_near = bounds
    n, u, v, uu, uv, vv, d, ud, vd, dd, coverage = np.moveaxis(moments, 2, 0)
    n = np.maximum(n, 1e-9)
    mean = np.stack([u, v], axis=2) / n[..., None]
    second = np.stack([uu, uv, uv, vv], axis=2).reshape(*n.shape, 2, 2) / n[..., None, None]
    covariance = second - mean[..., :, None] * mean[..., None, :] + ridge * size**2 * np.eye(2)
    d = d / n
    with_disparity = np.stack([ud, vd], axis=2) / n[..., None] - mean * d[..., None]
    middles = [(np.arange(each) + 0.5) * size - of_image / 2 for each, of_image in zip(n.shape, grid[2:], strict=True)]
    offset = np.stack(np.meshgrid(*middles[::-1]), axis=2) - mean
    slopes = np.linalg.solve(covariance, with_disparity[..., None])[..., 0]
    mahalanobis = np.sum(offset * np.linalg.solve(covariance, offset[..., None])[..., 0], axis=2)
    inside = np.clip((OUTSIDE - mahalanobis) / (OUTSIDE - INSIDE), 0, 1)
    deviation = np.sqrt(np.maximum(dd / n - d * d, 0))
    min_px, max_px = d - max_deviations_far * inside * deviation, d + max_deviations_near * deviation
    weight = np.minimum(coverage / (grid.cell_px * size) ** 2 / min_coverage, 1)
    return np.clip(d + np.sum(slopes * offset, axis=2), min_px, max_px), weight


def upsample_linear(values: FloatArray, factor: int) -> FloatArray:
    """Cell values interpolated to smaller cells, and extrapolated linearly to the border."""
    rows, cols = values.shape
    enlarged = upsample_bounded(extrapolate(extrapolate(values).T).T, factor)
    top, left = (enlarged.shape[0] - rows * factor) // 2, (enlarged.shape[1] - cols * factor) // 2
    return enlarged[top : top + rows * factor, left : left + cols * factor]


def extrapolate(values: FloatArray) -> FloatArray:
    """Values with one more row at both ends, in line with the outermost two; a single row stays as it is."""
    if len(values) == 1:
        return values
    return np.concatenate([2 * values[:1] - values[1:2], values, 2 * values[-1:] - values[-2:-1]])


def upsample_bounded(values: FloatArray, factor: int) -> FloatArray:
    """Cell values interpolated to smaller cells, and constant beyond the outermost middles."""
    size = (values.shape[1] * factor, values.shape[0] * factor)
    return np.asarray(cv2.resize(values, size, interpolation=cv2.INTER_LINEAR))


def best_level_plane(v: FloatArray, disparity_px: FloatArray, rows: int, tolerance: float) -> GroundPlane:
    half_octave = np.floor(2 * np.log2(disparity_px)).astype(np.intp)
    half_octave -= half_octave.min()
    weight = 1 / np.sqrt(np.bincount(half_octave)[half_octave])
    below_horizon = v - rows * HORIZONS[:, None]
    with np.errstate(divide="ignore"):
        slope = np.where(below_horizon > 0.5, disparity_px / np.maximum(below_horizon, 0.5), np.inf)
    rank = (MAX_OUTLIER_RATIO * np.count_nonzero(below_horizon > 0.5, axis=1)).astype(np.intp) + 1
    candidate = np.sort(slope, axis=1)[np.arange(len(rank)), np.minimum(rank, len(v) - 1)]
    candidate = np.where(np.isfinite(candidate), candidate, 0)
    above = slope - candidate[:, None] * (1 - 1.5 * tolerance)
    on_plane = (above > 0) & (above < candidate[:, None] * 3 * tolerance)
    best = np.argmax((on_plane.astype(np.float64) - (above <= 0)) @ weight)
    return GroundPlane(0.0, candidate[best], -candidate[best] * rows * HORIZONS[best])


def refine(
    candidate: GroundPlane, u: FloatArray, v: FloatArray, disparity_px: FloatArray, tolerance: float
) -> FloatArray:
    plane, A = np.array(candidate), np.stack([u, v, np.ones_like(u)], 1)
    for iteration in range(ITERATIONS):
        ground_px = A @ plane
        below_horizon = ground_px > 0
        ground_px = np.maximum(ground_px, 1e-6)
        error = (disparity_px / ground_px - 1) / (tolerance * max(1, 3 - iteration))
        error[error < 0] /= FARTHER_TOLERANCE
        weighted = A * (below_horizon / np.square(1 + error * error) / ground_px)[:, None]
        normal = A.T @ weighted
        normal += np.eye(3) * (1e-9 * np.trace(normal) + 1e-12)
        plane = np.linalg.solve(normal, disparity_px @ weighted)
    return plane


def plane_image(plane: GroundPlane, shape: tuple[int, ...]) -> FloatArray:
    row, col = np.indices(shape)
    return plane.disparity(col, row)


def find_contacts(
    disparity_px: FloatImage,
    row_stride: int,
    plane: GroundPlane,
    tolerance_px: float,
    relative_tolerance: float,
) -> tuple[npt.NDArray[np.intp], FloatImage]:
    searched_px = disparity_px[::row_stride]
    ground_px = plane_image(plane, disparity_px.shape)[::row_stride].astype(np.float32)
    tolerance_px = np.float32(tolerance_px) + np.float32(relative_tolerance) * ground_px
    on_ground = np.abs(searched_px - ground_px) < tolerance_px
    on_ground &= (searched_px > 0) & (ground_px > 0)
    highest = on_ground.argmax(axis=0)
    n_rows = len(on_ground) - highest
    has_contact = on_ground.any(axis=0) & (on_ground.sum(axis=0) >= np.minimum(MIN_GROUND_ROWS, n_rows / 2))
    contact_px = np.where(has_contact, searched_px[highest, np.arange(len(highest))], np.float32(0))
    return np.where(has_contact, highest * row_stride, len(disparity_px)), contact_px


def stixel_mask(
    disparity_px: FloatImage, row_stride: int, contact: npt.NDArray[np.intp], limit_px: FloatImage, max_between: int
) -> MaskImage:
    """Whether each of the searched rows is covered, from the top down."""
    searched_px = disparity_px[::row_stride]
    above = np.arange(len(disparity_px))[::row_stride, None] < contact
    between = above & (searched_px > 0) & (searched_px < limit_px)
    n_between = np.cumsum(between[::-1], axis=0)[::-1]
    return above & (n_between <= max_between)


def stixel_means(
    contact_px: FloatImage, mask: MaskImage, row_stride: int, grid: CellGrid, min_coverage: float
) -> FloatArray:
    """Mean disparity of the stixels in each cell, by the area means of two images."""
    cell_px, left, rows, cols = grid
    covered = np.zeros((rows * (cell_px // row_stride), cols * cell_px), np.float32)
    covered[: len(mask), left : left + mask.shape[1]] = mask
    weighted_px = covered.copy()
    weighted_px[:, left : left + mask.shape[1]] *= contact_px
    coverage, mean_px = (cv2.resize(i, (cols, rows), interpolation=cv2.INTER_AREA) for i in (covered, weighted_px))
    return np.where(coverage >= min_coverage, mean_px / np.maximum(coverage, np.float32(1e-6)), 0)


def raise_to_ground(plane: GroundPlane, probability: float, estimate: CellEstimate) -> CellEstimate:
    ground_px = plane_image(plane, estimate.disparity_px.shape)
    raised_px = np.maximum(estimate.disparity_px, GROUND_TOLERANCE * ground_px)
    return CellEstimate(raised_px, np.where(raised_px < ON_GROUND * ground_px, probability, estimate.probability))


def find_sky(known: GrayImage, gray: GrayImage) -> MaskImage:
    """By OpenCV, for images whose sides are multiples of the cells'."""
    middles = np.s_[CELL_PX // 2 :: CELL_PX, CELL_PX // 2 :: CELL_PX]
    gray, is_known = gray[middles], known[middles] > 0
    lower = len(gray) // 2
    known_gray = np.sort(gray[lower:][is_known[lower:]])
    min_gray = known_gray[int(GRAY_QUANTILE * (known_gray.size - 1))] if known_gray.size else np.uint8(255)
    share = cv2.resize(known / 255, gray.shape[::-1], interpolation=cv2.INTER_AREA)
    bright_hole = (share < MAX_KNOWN + 0.01) & (gray > min_gray)
    _, label, stats, _ = cv2.connectedComponentsWithStats(bright_hole.astype(np.uint8), connectivity=4)
    is_sky = (stats[:, cv2.CC_STAT_TOP] == 0) & (stats[:, cv2.CC_STAT_AREA] >= MIN_SHARE * label.size)
    is_sky[0] = False  # the component of all other pixels
    return is_sky[label]


def recall(
    measured_px: FloatImage, remembered_px: FloatImage, near_px: FloatImage, tolerance_px: float, relative: float
) -> tuple[FloatImage, MaskImage]:
    """Known disparities, and where they are remembered."""
    is_contradicted = (near_px > 0) & (np.abs(remembered_px - near_px) > near_px * relative + tolerance_px)
    is_remembered = (remembered_px > 0) & ~is_contradicted
    return np.where(is_remembered, remembered_px, measured_px), is_remembered


def fill(
    known_px: FloatImage,
    near: Interpolated,
    cells: CellEstimate,
    grid: CellGrid,
    plane: GroundPlane,
    farthest_px: float,
    sky: MaskImage,
) -> tuple[FloatArray, FloatArray]:
    """Disparity and probability. The sky is given by pixels."""
    inside = np.s_[: known_px.shape[0], grid.left : grid.left + known_px.shape[1]]
    guess_px = np.maximum(upsample_linear(cells.disparity_px, grid.cell_px)[inside], farthest_px)
    guess_probability = upsample_bounded(cells.probability, grid.cell_px)[inside]
    guess_probability = np.where(sky, INPAINTING.sky, guess_probability)
    raised_px = np.maximum(near.disparity_px, GROUND_TOLERANCE * plane_image(plane, known_px.shape))
    end_px = np.where(near.background, near.disparity_px, raised_px)
    is_known, has_end = known_px > 0, near.disparity_px > 0
    agreement = np.where(has_end, AGREEMENT.at(np.abs(known_px - near.disparity_px)), 1)
    filled_px = np.where(is_known, known_px, np.where(has_end, end_px, guess_px))
    return filled_px, np.where(is_known, agreement, np.where(has_end, near.probability, guess_probability))
