"""Planes for inpainting: a moving least-squares fit of first order to disparity, in which planes are linear."""

from typing import NamedTuple

import numpy as np
from numba import float32, float64, int64, uint8, void
from numba.types import Tuple, UniTuple
from pydantic import Field

from ..compiled import BYTE_IMAGE, FLOAT_IMAGE, compiled, named_tuple
from ..model import Model
from ..types import FloatArray, FloatImage, GrayImage
from .confidence import INPAINTING
from .masks import box_mean
from .measurement import VALIDITY_WINDOW_PX
from .working_resolution import WorkingResolution

N, U, V, UU, UV, VV, D, UD, VD, DD, COVERAGE = range(11)
"""The moments of a cell: weighted sums of 1, u, v, uu, uv, vv, D, uD, vD and DD, and the sum of the squared validities.
The coordinates u and v are in the finest cells, from the middle of the image."""
N_MOMENTS = 11
INSIDE, OUTSIDE = 3.0, 5.0
"""Squared Mahalanobis distances from the data: extrapolation to the far side shrinks from the first one on, and stops
at the second, so that planes do not recede where nothing was measured."""
MIN_COVERAGE = 0.1
"""Fraction of a cell that must be measured for its mean to be used."""
MAX_CELL_ROWS = 32
"""Largest number of rows of cells whose means are used."""


class PlanesConfig(Model):
    """How planes are fitted around holes."""

    cell_px: int = Field(default=16, ge=4, le=1_024)
    """Side of the finest cells, in pixels of the full image. Smaller cells follow their surroundings, and cost more."""
    min_coverage: float = Field(default=0.08, gt=0)
    """Fraction of a cell's neighbourhood that must be measured for its own plane to have full weight. The remaining
    weight goes to cells of twice the size, and so on."""
    ridge: float = Field(default=0.003, gt=0)
    """Regularisation of the slopes against the spread of the data. More extrapolates less."""
    max_deviations_far: float = Field(default=1.25, ge=0)
    """Largest extrapolation to the far side, in standard deviations of the data. It shrinks to 0 outside of them."""
    max_deviations_near: float = Field(default=2.5, ge=0)
    """Largest extrapolation to the near side, in standard deviations of the data."""


class CellGrid(NamedTuple):
    """The finest cells of an image. The columns are centred, so that a mirrored image has mirrored cells."""

    cell_px: int
    """Side of a cell, in working pixels."""
    left: int
    """Number of pixels by which the first column begins beside the image."""
    rows: int
    cols: int

    @classmethod
    def of(cls, resolution: WorkingResolution, cell_px: int) -> "CellGrid":
        """The cells of a side that cover an image."""
        rows, cols = -(-resolution.height_px // cell_px), -(-resolution.width_px // cell_px)
        return cls(cell_px, (cols * cell_px - resolution.width_px) // 2, rows, cols)


class CellEstimate(NamedTuple):
    """Estimated disparity of the cells of one level, shape (rows, cols)."""

    disparity_px: FloatArray
    """Disparity at the middle of each cell."""
    probability: FloatArray
    """Probability in 0..1 that it is of the right surface."""


class Bounds(NamedTuple):
    """The bounds of the configuration."""

    min_coverage: float
    ridge: float
    max_deviations_far: float
    max_deviations_near: float


GRID = named_tuple(CellGrid, *[int64] * 4)
VALUES, CELLS, MOMENTS = float64[::1], float64[:, ::1], float64[:, :, ::1]
CELL_ESTIMATE = named_tuple(CellEstimate, CELLS, CELLS)
BOUNDS = named_tuple(Bounds, *[float64] * 4)


class PlaneFitter:
    """Fits a plane to the neighbourhood of every cell, on levels of cells that double in size.

    The neighbourhood is three by three cells. A cell without enough data blends its plane with that of the next level.
    """

    def __init__(self, resolution: WorkingResolution, config: PlanesConfig) -> None:
        self.grid = CellGrid.of(resolution, config.cell_px // resolution.decimation)
        self.levels = 1 + max(1, int(np.log2(max(self.grid.rows, self.grid.cols))))
        self._bounds = Bounds(config.min_coverage, config.ridge, config.max_deviations_far, config.max_deviations_near)

    def moments(self, disparity_px: FloatImage, valid: GrayImage) -> list[FloatArray]:
        """The moments around the cells of each level, shape (rows, cols, 11), the finest first.

        Pixels weigh the fourth power of the fraction of their neighbours that are valid, which are given as a mask.
        """
        of_cells = [sum_cells(disparity_px, box_mean(valid, VALIDITY_WINDOW_PX), self.grid)]
        for _ in range(self.levels - 1):
            of_cells.append(sum_blocks(of_cells[-1]))
        return [sum_neighbourhood(each) for each in of_cells]

    def cell_means(self, finest_moments: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Column and row, in cells from the middle of the image, and mean disparity [px] of measured cells, shape (N,).

        Only every k-th row is used, such that there are at most `MAX_CELL_ROWS`.
        """
        row_stride = -(-self.grid.rows // MAX_CELL_ROWS)
        return _cell_means(finest_moments, row_stride, MIN_COVERAGE * self.grid.cell_px**2)

    def fit(self, moments: FloatArray, level: int, coarser: CellEstimate | None) -> CellEstimate:
        """The planes of all cells of a level, blended with the estimate of the next coarser level if there is one."""
        estimate, weight = fit_planes(moments, 2**level, INPAINTING.plane(level), self.grid, self._bounds)
        if coarser is not None:
            blend(coarser, weight, estimate)
        return estimate


@compiled(void(VALUES, float64, VALUES))
def _add_scaled(
    values: FloatArray,
    factor: float,
    # input and output
    sums: FloatArray,
) -> None:
    """Add a multiple of some values to some sums."""
    for k in range(len(values)):
        sums[k] += factor * values[k]


@compiled(void(float32[::1], uint8[::1], CELLS))
def _weigh_row(
    disparity_px: FloatImage,
    valid_around: GrayImage,
    # output
    terms: FloatArray,
) -> None:
    """The weight of the pixels of a row, weight times D and DD, and their squared validity; 0 in holes.

    The validity is the fraction of valid neighbours, given as 0..255. Pixels weigh its fourth power.
    """
    for col in range(len(disparity_px)):
        validity = valid_around[col] * (1 / 255) if disparity_px[col] > 0 else 0.0
        terms[3, col] = validity * validity
        terms[0, col] = terms[3, col] * terms[3, col]
        terms[1, col] = terms[0, col] * disparity_px[col]
        terms[2, col] = terms[1, col] * disparity_px[col]


@compiled(void(CELLS, int64, int64, float64, float64, VALUES))
def _sum_columns(
    sums: FloatArray,
    first: int,
    last: int,
    first_u: float,
    step_u: float,
    # output
    moments: FloatArray,
) -> None:
    """The moments of some columns, whose sums of 1, v, vv, D, vD, DD and the squared validities are known."""
    n = u = v = uu = uv = vv = d = ud = vd = dd = coverage = 0.0
    for col in range(first, last):
        column_u = first_u + step_u * (col - first)
        n += sums[0, col]
        u += sums[0, col] * column_u
        uu += sums[0, col] * column_u * column_u
        v += sums[1, col]
        uv += sums[1, col] * column_u
        vv += sums[2, col]
        d += sums[3, col]
        ud += sums[3, col] * column_u
        vd += sums[4, col]
        dd += sums[5, col]
        coverage += sums[6, col]
    moments[N], moments[U], moments[V], moments[UU], moments[UV], moments[VV] = n, u, v, uu, uv, vv
    moments[D], moments[UD], moments[VD], moments[DD], moments[COVERAGE] = d, ud, vd, dd, coverage


@compiled(MOMENTS(FLOAT_IMAGE, BYTE_IMAGE, GRID))
def sum_cells(disparity_px: FloatImage, valid_around: GrayImage, grid: CellGrid) -> FloatArray:
    """The moments of the pixels in each of the finest cells, which are summed down the columns first."""
    height, width = disparity_px.shape
    terms, sums = np.empty((4, width)), np.empty((7, width))
    moments = np.empty((grid.rows, grid.cols, N_MOMENTS))
    for cell_row in range(grid.rows):
        sums[:] = 0
        for row in range(cell_row * grid.cell_px, min((cell_row + 1) * grid.cell_px, height)):
            v = (row + 0.5) / grid.cell_px - grid.rows / 2
            _weigh_row(disparity_px[row], valid_around[row], terms)
            for k, (term, factor) in enumerate(((0, 1.0), (0, v), (0, v * v), (1, 1.0), (1, v), (2, 1.0), (3, 1.0))):
                _add_scaled(terms[term], factor, sums[k])
        for cell_col in range(grid.cols):
            first = max(cell_col * grid.cell_px - grid.left, 0)
            last = min((cell_col + 1) * grid.cell_px - grid.left, width)
            u = (first + grid.left + 0.5) / grid.cell_px - grid.cols / 2
            _sum_columns(sums, first, last, u, 1 / grid.cell_px, moments[cell_row, cell_col])
    return moments


@compiled(MOMENTS(MOMENTS))
def sum_blocks(moments: FloatArray) -> FloatArray:
    """Sums of two by two cells."""
    rows, cols, _ = moments.shape
    blocks = np.zeros(((rows + 1) // 2, (cols + 1) // 2, N_MOMENTS))
    for row in range(rows):
        for col in range(cols):
            _add_scaled(moments[row, col], 1.0, blocks[row // 2, col // 2])
    return blocks


@compiled(MOMENTS(MOMENTS))
def sum_neighbourhood(moments: FloatArray) -> FloatArray:
    """Sums over three by three cells with binomial weights, which add up to 1."""
    rows, cols, _ = moments.shape
    around, of_row = np.zeros((rows, cols * N_MOMENTS)), np.empty(cols * N_MOMENTS)
    for row in range(rows):
        values = moments[row].reshape(-1)
        of_row[:] = 0
        _add_scaled(values[:-N_MOMENTS], 0.25, of_row[N_MOMENTS:])
        _add_scaled(values, 0.5, of_row)
        _add_scaled(values[N_MOMENTS:], 0.25, of_row[:-N_MOMENTS])
        for other_row, weight in ((row - 1, 0.25), (row, 0.5), (row + 1, 0.25)):
            if 0 <= other_row < rows:
                _add_scaled(of_row, weight, around[other_row])
    return around.reshape(moments.shape)


@compiled(UniTuple(VALUES, 3)(MOMENTS, int64, float64))
def _cell_means(moments: FloatArray, row_stride: int, min_coverage: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    rows, cols, _ = moments.shape
    u, v, disparity_px = np.empty(rows * cols), np.empty(rows * cols), np.empty(rows * cols)
    n = 0
    for row in range(0, rows, row_stride):
        for col in range(cols):
            cell = moments[row, col]
            if cell[COVERAGE] > min_coverage:
                u[n], v[n], disparity_px[n] = cell[U] / cell[N], cell[V] / cell[N], cell[D] / cell[N]
                n += 1
    return u[:n], v[:n], disparity_px[:n]


@compiled(Tuple((CELL_ESTIMATE, CELLS))(MOMENTS, float64, float64, GRID, BOUNDS))
def fit_planes(
    moments: FloatArray, size: float, probability: float, grid: CellGrid, bounds: Bounds
) -> tuple[CellEstimate, FloatArray]:
    """The planes of cells of `size` times the finest, which are right with that probability, and their weight, 0..1."""
    rows, cols, _ = moments.shape
    estimate = CellEstimate(np.empty((rows, cols)), np.full((rows, cols), probability))
    weight, ridge = np.empty((rows, cols)), bounds.ridge * size**2
    for row in range(rows):
        for col in range(cols):
            cell = moments[row, col]
            n = max(cell[N], 1e-9)
            u, v, d = cell[U] / n, cell[V] / n, cell[D] / n
            uu, uv, vv = cell[UU] / n - u * u + ridge, cell[UV] / n - u * v, cell[VV] / n - v * v + ridge
            ud, vd, deviation = cell[UD] / n - u * d, cell[VD] / n - v * d, np.sqrt(max(cell[DD] / n - d * d, 0))
            determinant = uu * vv - uv * uv
            slope_u, slope_v = (vv * ud - uv * vd) / determinant, (uu * vd - uv * ud) / determinant
            offset_u, offset_v = (col + 0.5) * size - grid.cols / 2 - u, (row + 0.5) * size - grid.rows / 2 - v
            mahalanobis = (vv * offset_u**2 - 2 * uv * offset_u * offset_v + uu * offset_v**2) / determinant
            inside = min(max((OUTSIDE - mahalanobis) / (OUTSIDE - INSIDE), 0), 1)
            min_px = d - bounds.max_deviations_far * inside * deviation
            max_px = d + bounds.max_deviations_near * deviation
            estimate.disparity_px[row, col] = min(max(d + slope_u * offset_u + slope_v * offset_v, min_px), max_px)
            weight[row, col] = min(cell[COVERAGE] / (grid.cell_px * size) ** 2 / bounds.min_coverage, 1)
    return estimate, weight


@compiled(float64(VALUES, float64))
def interpolate(values: FloatArray, position: float) -> float:
    """A value between those of the middles of cells, extrapolated linearly beyond the outermost."""
    k = min(max(int(np.floor(position)), 0), max(len(values) - 2, 0))
    value: float = values[k] + (position - k) * (values[min(k + 1, len(values) - 1)] - values[k])
    return value


@compiled(void(CELLS, float64, VALUES))
def interpolate_rows(
    values: FloatArray,
    position: float,
    # output
    row_values: FloatArray,
) -> None:
    """The values between those of the rows of cells, shape (cols,), extrapolated linearly beyond the outermost."""
    k = min(max(int(np.floor(position)), 0), max(len(values) - 2, 0))
    above, below = values[k], values[min(k + 1, len(values) - 1)]
    for col in range(len(row_values)):
        row_values[col] = above[col] + (position - k) * (below[col] - above[col])


@compiled(float64(float64, int64))
def bounded(position: float, n: int) -> float:
    """The position, but none beyond the middles of the outermost of n cells."""
    return min(max(position, 0.0), n - 1.0)


@compiled(void(CELL_ESTIMATE, CELLS, CELL_ESTIMATE))
def blend(
    coarser: CellEstimate,
    weight: FloatArray,
    # input and output
    estimate: CellEstimate,
) -> None:
    """Blend the estimate of cells with that of cells of twice the size, by their own weight."""
    coarser_rows, coarser_cols = coarser.disparity_px.shape
    row_px, row_probability = np.empty(coarser_cols), np.empty(coarser_cols)
    for row in range(weight.shape[0]):
        v = (row + 0.5) / 2 - 0.5
        interpolate_rows(coarser.disparity_px, v, row_px)
        interpolate_rows(coarser.probability, bounded(v, coarser_rows), row_probability)
        for col in range(weight.shape[1]):
            u, share = (col + 0.5) / 2 - 0.5, 1 - weight[row, col]
            coarse_px, probability = interpolate(row_px, u), interpolate(row_probability, bounded(u, coarser_cols))
            estimate.disparity_px[row, col] += share * (coarse_px - estimate.disparity_px[row, col])
            estimate.probability[row, col] += share * (probability - estimate.probability[row, col])
