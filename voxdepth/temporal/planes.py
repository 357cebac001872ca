"""Planes for inpainting: a moving least-squares fit of first order to disparity, in which planes are linear."""

from typing import NamedTuple, TypeVar

import cv2
import numpy as np
import numpy.typing as npt
from pydantic import Field

from ..model import Model
from ..types import FloatArray, FloatImage
from .confidence import INPAINTING
from .working_resolution import WorkingResolution

MomentPyramid = list[FloatArray]
"""Moments around each cell, shape (11, rows, cols), for each level of cell sizes, the finest first. They are weighted
sums of 1, u, v, uu, uv, vv, D, uD, vD and DD, and the sum of the validities."""
Values = TypeVar("Values", FloatImage, FloatArray)

INSIDE, OUTSIDE = 3.0, 5.0
"""Squared Mahalanobis distances from the data: extrapolation to the far side shrinks from the first one on, and stops
at the second, so that planes do not recede where nothing was measured."""
DISPARITY_MOMENT = 6
MIN_COVERAGE = 0.1
"""Fraction of a cell that must be measured for its mean to be used."""
MAX_CELL_ROWS = 32
"""Largest number of rows of cells whose means are used."""
POWERS = ((0, 0), (0, 1), (1, 0), (0, 2), (1, 1), (2, 0))
"""Powers of v and u in the first six moments."""


class PlanesConfig(Model):
    """How planes are fitted around holes."""

    cell_px: int = Field(16, ge=4)
    """Side of the finest cells, in pixels of the full image. Smaller cells follow their surroundings, and cost more."""
    min_coverage: float = Field(0.08, gt=0)
    """Fraction of a cell's neighbourhood that must be measured for its own plane to have full weight. The remaining
    weight goes to cells of twice the size, and so on."""
    ridge: float = Field(0.003, gt=0)
    """Regularisation of the slopes against the spread of the data. More extrapolates less."""
    max_deviations_far: float = Field(1.25, ge=0)
    """Largest extrapolation to the far side, in standard deviations of the data. It shrinks to 0 outside of them."""
    max_deviations_near: float = Field(2.5, ge=0)
    """Largest extrapolation to the near side, in standard deviations of the data."""


class CellEstimate(NamedTuple):
    """Estimated disparity of the cells of one level, shape (rows, cols)."""

    disparity_px: FloatArray
    """Disparity at the middle of each cell."""
    probability: FloatArray
    """Probability in 0..1 that it is of the right surface."""

    def overlay(self, disparity_px: FloatArray, probability: float) -> "CellEstimate":
        """The estimate with other disparities, of one probability, in the cells where those are not 0."""
        where = disparity_px > 0
        return CellEstimate(
            np.where(where, disparity_px, self.disparity_px), np.where(where, probability, self.probability)
        )


class PlaneFitter:
    """Fits a plane to the neighbourhood of every cell, on levels of cells that double in size.

    The neighbourhood is three by three cells. A cell without enough data blends its plane with that of the next level.
    The finest cells have a side of `cell_px` working pixels; there are `shape` of them, from `left` pixels beside the
    image on.
    """

    def __init__(self, resolution: WorkingResolution, config: PlanesConfig) -> None:
        self._config = config
        height, width = resolution.shape
        self.cell_px = cell = config.cell_px // resolution.decimation
        self.shape = rows, cols = -(-height // cell), -(-width // cell)
        # The columns are centred, so that a mirrored image has mirrored cells.
        self.left = (cols * cell - width) // 2
        self._inside = np.s_[:height, self.left : self.left + width]
        self.levels = 1 + max(1, int(np.log2(max(rows, cols))))
        # Coordinates are in cells, from the middle of the image.
        self._powers_v = _powers(rows, cell).swapaxes(1, 2)
        self._powers_u = _powers(cols, cell)

    def moments(self, disparity_px: FloatImage, validity: FloatImage) -> MomentPyramid:
        """The moments that planes are fitted to, weighted by the fourth power of the validity.

        Both images have shape (h, w). The validity is the fraction of valid neighbours of each pixel, and 0 in holes.
        """
        squared_validity = np.square(validity)
        weight = np.square(squared_validity)
        weighted_px = weight * disparity_px
        terms = ((weight, 6), (weighted_px, 3), (weighted_px * disparity_px, 1), (squared_validity, 1))
        moments = np.concatenate([self._sums(image, n) for image, n in terms]).astype(np.float64)
        pyramid = [_sum_neighbourhood(moments)]
        for _ in range(self.levels - 1):
            moments = _sum_blocks(moments)
            pyramid.append(_sum_neighbourhood(moments))
        return pyramid

    def cell_means(self, pyramid: MomentPyramid) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Column and row, in cells from the middle of the image, and mean disparity [px] of measured cells, shape (N,).

        Only every k-th row is used, such that there are at most `MAX_CELL_ROWS`.
        """
        n, u, v, *_ = rows = pyramid[0][:, :: -(-self.shape[0] // MAX_CELL_ROWS)]
        measured = rows[-1] > MIN_COVERAGE * self.cell_px**2
        n = n[measured]
        return u[measured] / n, v[measured] / n, rows[DISPARITY_MOMENT][measured] / n

    def fit(self, moments: FloatArray, level: int, coarser: CellEstimate | None) -> CellEstimate:
        """The planes of all cells of a level, blended with the estimate of the next coarser level if there is one."""
        config, size = self._config, 2.0**level
        n, u, v, uu, uv, vv, d, ud, vd, dd, coverage = moments
        weight = np.minimum(coverage / (self.cell_px * size) ** 2 / config.min_coverage, 1)
        n = np.maximum(n, 1e-9)
        u, v, d = u / n, v / n, d / n
        uu, uv, vv = uu / n - u * u, uv / n - u * v, vv / n - v * v
        ud, vd = ud / n - u * d, vd / n - v * d
        ridge = config.ridge * size**2
        uu, vv = uu + ridge, vv + ridge
        determinant = uu * vv - uv * uv
        slope_u, slope_v = (vv * ud - uv * vd) / determinant, (uu * vd - uv * ud) / determinant
        rows, cols = n.shape
        offset_v = (np.arange(rows)[:, None] + 0.5) * size - self.shape[0] / 2 - v
        offset_u = (np.arange(cols) + 0.5) * size - self.shape[1] / 2 - u
        disparity_px = d + slope_u * offset_u + slope_v * offset_v
        deviation = np.sqrt(np.maximum(dd / n - d * d, 0))
        mahalanobis = (vv * offset_u**2 - 2 * uv * offset_u * offset_v + uu * offset_v**2) / determinant
        inside = np.clip((OUTSIDE - mahalanobis) / (OUTSIDE - INSIDE), 0, 1)
        min_px = d - config.max_deviations_far * inside * deviation
        disparity_px = np.clip(disparity_px, min_px, d + config.max_deviations_near * deviation)
        probability = np.full_like(disparity_px, INPAINTING.plane(level))
        if coarser is not None:
            coarser_px = _upsample_linear(coarser.disparity_px, 2)[:rows, :cols]
            coarser_probability = _resize(coarser.probability, 2)[:rows, :cols]
            disparity_px = weight * disparity_px + (1 - weight) * coarser_px
            probability = weight * probability + (1 - weight) * coarser_probability
        return CellEstimate(disparity_px, probability)

    def upsample(self, values: FloatArray) -> FloatImage:
        """Values of the finest cells in every pixel, shape (h, w), extrapolated linearly to the border."""
        enlarged = _upsample_linear(values.astype(np.float32), self.cell_px)
        return np.ascontiguousarray(enlarged[self._inside])

    def upsample_bounded(self, values: FloatArray) -> FloatImage:
        """Values of the finest cells in every pixel, shape (h, w), none beyond the smallest and largest of them."""
        enlarged = _resize(values.astype(np.float32), self.cell_px)
        return np.ascontiguousarray(enlarged[self._inside])

    def _sums(self, image: FloatImage, n: int) -> npt.NDArray[np.float32]:
        """Sums per cell of the image times the first n of 1, u, v, uu, uv and vv, shape (n, rows, cols)."""
        (rows, cols), cell = self.shape, self.cell_px
        padded = np.zeros((rows * cell, cols * cell), np.float32)
        padded[self._inside] = image
        by_row = np.matmul(self._powers_v, padded.reshape(rows, cell, -1)).reshape(rows * 3, cols, cell)
        sums = np.matmul(by_row.swapaxes(0, 1), self._powers_u).reshape(cols, rows, 3, 3)
        return np.stack([sums[:, :, of_v, of_u].T for of_v, of_u in POWERS[:n]])


def _powers(cells: int, cell_px: int) -> npt.NDArray[np.float32]:
    """1, x and x squared of the pixels along one side, in cells from the middle, shape (cells, cell_px, 3)."""
    x = (np.arange(cells * cell_px) + 0.5) / cell_px - cells / 2
    return np.stack([x**0, x, x**2], 1).reshape(cells, cell_px, 3).astype(np.float32)


def _sum_neighbourhood(moments: FloatArray) -> FloatArray:
    """Sums over three by three cells with binomial weights, which add up to 1."""
    n, rows, cols = moments.shape
    padded = np.zeros((n, rows + 2, cols + 2))
    padded[:, 1:-1, 1:-1] = moments
    by_row = 0.25 * (padded[:, :-2] + padded[:, 2:]) + 0.5 * padded[:, 1:-1]
    around: FloatArray = 0.25 * (by_row[:, :, :-2] + by_row[:, :, 2:]) + 0.5 * by_row[:, :, 1:-1]
    return around


def _sum_blocks(moments: FloatArray) -> FloatArray:
    """Sums of two by two cells."""
    n, rows, cols = moments.shape
    padded = np.zeros((n, rows + rows % 2, cols + cols % 2))
    padded[:, :rows, :cols] = moments
    blocks: FloatArray = padded[:, ::2, ::2] + padded[:, 1::2, ::2] + padded[:, ::2, 1::2] + padded[:, 1::2, 1::2]
    return blocks


def _upsample_linear(values: Values, factor: int) -> Values:
    """Cell values interpolated to smaller cells, and extrapolated linearly to the border."""
    rows, cols = values.shape
    enlarged = _resize(_extrapolate(_extrapolate(values).T).T, factor)
    top, left = (enlarged.shape[0] - rows * factor) // 2, (enlarged.shape[1] - cols * factor) // 2
    return enlarged[top : top + rows * factor, left : left + cols * factor]


def _extrapolate(values: Values) -> Values:
    """Values with one more row at both ends, in line with the outermost two; a single row stays as it is."""
    if len(values) == 1:
        return values
    extended: Values = np.concatenate([2 * values[:1] - values[1:2], values, 2 * values[-1:] - values[-2:-1]])
    return extended


def _resize(values: Values, factor: int) -> Values:
    """Cell values interpolated to smaller cells, and constant beyond the outermost middles."""
    size = (values.shape[1] * factor, values.shape[0] * factor)
    return np.asarray(cv2.resize(values, size, interpolation=cv2.INTER_LINEAR))
