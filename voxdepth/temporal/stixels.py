"""Stixels: upright surfaces that stand on the ground."""

from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
from numba import float32, float64, int64, void
from numba.types import Tuple
from pydantic import Field

from ..compiled import FLOAT_IMAGE, compiled
from ..model import Model
from ..types import FloatArray, FloatImage
from .confidence import INPAINTING
from .ground import PLANE, GroundPlane, plane_at
from .planes import CELL_ESTIMATE, CELLS, GRID, CellEstimate, CellGrid
from .working_resolution import WorkingResolution

Rows = npt.NDArray[np.int64]
"""One row of the image per column, shape (w,)."""

ROW_STRIDE_PX = 4
"""Stride of the rows that are searched, in pixels of the full image."""
MEDIAN_COLUMNS = 5
"""Number of adjacent columns whose median ground contact is used."""
MIN_GROUND_ROWS = 8
"""Rows of a column that must be on the ground, or half of those up to the contact; otherwise it is a wrong match."""
GROUND_TOLERANCE = 0.97
"""Estimates have at least this fraction of the disparity of the ground, whose plane is not exact."""
ON_GROUND = 1.05
"""Estimates with at most this multiple of the disparity of the ground are taken for the ground."""
MAX_ROWS_BETWEEN = 2
"""Measured rows between contact and hole that do not separate them, since texture ends raggedly."""
OCCLUDED_LEVEL = 2
"""Level of the cells that take occluded stixels; the finest cells only take those directly above their contact."""
MIN_OCCLUDED_COVERAGE, MIN_COVERAGE = 0.25, 0.5
"""Fraction of a cell that a stixel must cover, for occluded stixels in large cells and for others in the finest
cells."""


class StixelsConfig(Model):
    """When a measurement is on the ground. A stixel ends below one that is farther by twice the relative tolerance."""

    tolerance_px: float = Field(default=0.5, ge=0)
    """Difference to the disparity of the ground up to which a measurement is on it, besides the relative tolerance."""
    relative_tolerance: float = Field(default=0.05, ge=0)
    """Fraction of the disparity that is added to the tolerance."""


ROWS = int64[::1]


class Stixels(NamedTuple):
    """Disparity [px] of the stixels, by cells of the planes, and the ground; 0 = no stixel."""

    occluded_px: FloatArray
    """All stixels, even behind other surfaces, in cells of `OCCLUDED_LEVEL`."""
    visible_px: FloatArray
    """Stixels in holes directly above their ground contact, in the finest cells, shape (rows, cols)."""
    ground: GroundPlane
    """The ground by the finest cells."""

    def overlay(self, estimate: CellEstimate, level: int) -> None:
        """Put stixels into the estimate of a level where there are some; at level 0 also nothing below the ground."""
        if level == OCCLUDED_LEVEL:
            overlay(self.occluded_px, INPAINTING.occluded_stixel, estimate)
        if level == 0:
            overlay(self.visible_px, INPAINTING.stixel, estimate)
            raise_to_ground(self.ground, INPAINTING.ground, estimate)


class StixelEstimator:
    """Finds the stixels of images of one size, in the cells of its planes.

    The ground contact of a column is its highest measurement on the ground. The holes above have the disparity of the
    contact, up to the first measurement that is farther. Only every few rows are searched.
    """

    def __init__(self, resolution: WorkingResolution, grid: CellGrid, config: StixelsConfig) -> None:
        self._config = config
        self._row_stride = ROW_STRIDE_PX // resolution.decimation
        self._grid = grid

    def estimate(self, disparity_px: FloatImage, ground: GroundPlane) -> Stixels:
        """The stixels of a disparity image, shape (h, w), on its ground plane; holes are 0."""
        stride, config = self._row_stride, self._config
        tolerances = config.tolerance_px, config.relative_tolerance
        contact, raw_px = find_contacts(disparity_px, stride, ground.by_pixels(self._grid), *tolerances)
        contact_px = np.asarray(cv2.medianBlur(raw_px[None], MEDIAN_COLUMNS), np.float32)[0]
        contact[contact_px == 0] = 0  # No row is above the first one.
        farther_px = contact_px - (config.tolerance_px + 2 * np.float32(config.relative_tolerance) * contact_px)
        any_px = np.full_like(contact_px, np.inf)
        occluded = find_tops(disparity_px, stride, contact, farther_px, 0)
        visible = find_tops(disparity_px, stride, contact, any_px, MAX_ROWS_BETWEEN)
        return Stixels(
            occluded_px=self._cell_means(contact_px, contact, occluded, 2**OCCLUDED_LEVEL, MIN_OCCLUDED_COVERAGE),
            visible_px=self._cell_means(contact_px, contact, visible, 1, MIN_COVERAGE),
            ground=ground.by_cells(self._grid),
        )

    def _cell_means(
        self, contact_px: FloatImage, contact: Rows, top: Rows, size: int, min_coverage: float
    ) -> FloatArray:
        """Mean disparity [px] of the stixels in cells of `size` finest cells a side."""
        cell_px, left, rows, cols = self._grid
        grid = CellGrid(cell_px * size, left, -(-rows // size), -(-cols // size))
        return stixel_means(contact_px, contact, top, self._row_stride, grid, min_coverage)


@compiled(Tuple((ROWS, float32[::1]))(FLOAT_IMAGE, int64, PLANE, float32, float32))
def find_contacts(
    disparity_px: FloatImage, row_stride: int, ground: GroundPlane, tolerance_px: float, relative_tolerance: float
) -> tuple[Rows, FloatImage]:
    """Row and disparity of the ground contact of each column; below the image and 0 if there is none."""
    height, width = disparity_px.shape
    contact, contact_px = np.full(width, height), np.zeros(width, np.float32)
    n_on_ground = np.zeros(width, np.int64)
    for row in range(0, height, row_stride):
        for col in range(width):
            seen_px, ground_px = disparity_px[row, col], float32(plane_at(ground, col, row))
            is_close = abs(seen_px - ground_px) < tolerance_px + relative_tolerance * ground_px
            if is_close and min(seen_px, ground_px) > 0:
                if n_on_ground[col] == 0:
                    contact[col], contact_px[col] = row, seen_px
                n_on_ground[col] += 1
    for col in range(width):
        n_rows = (height - 1) // row_stride - contact[col] // row_stride + 1
        if n_on_ground[col] < min(MIN_GROUND_ROWS, n_rows / 2):
            contact[col], contact_px[col] = height, 0
    return contact, contact_px


@compiled(ROWS(FLOAT_IMAGE, int64, ROWS, float32[::1], int64))
def find_tops(disparity_px: FloatImage, row_stride: int, contact: Rows, limit_px: FloatImage, max_between: int) -> Rows:
    """Highest row above each ground contact that not more than a few measurements below a limit separate from it.

    It is the row of the contact if there is none.
    """
    height, width = disparity_px.shape
    top, n_between = contact.copy(), np.zeros(width, np.int64)
    for row in range((height - 1) // row_stride * row_stride, -1, -row_stride):
        for col in range(width):
            if row < contact[col]:
                n_between[col] += 0 < disparity_px[row, col] < limit_px[col]
                if n_between[col] <= max_between:
                    top[col] = row
    return top


@compiled(CELLS(float32[::1], ROWS, ROWS, int64, GRID, float64))
def stixel_means(
    contact_px: FloatImage, contact: Rows, top: Rows, row_stride: int, grid: CellGrid, min_coverage: float
) -> FloatArray:
    """Mean disparity of the stixels from their tops to above their contacts in each cell; 0 with less coverage."""
    n, mean_px = np.zeros((grid.rows, grid.cols)), np.zeros((grid.rows, grid.cols))
    for col in range(len(top)):
        cell_col = (col + grid.left) // grid.cell_px
        for cell_row in range(top[col] // grid.cell_px, (contact[col] - 1) // grid.cell_px + 1):
            first, last = max(top[col], cell_row * grid.cell_px), min(contact[col], (cell_row + 1) * grid.cell_px)
            n_rows = (last + row_stride - 1) // row_stride - (first + row_stride - 1) // row_stride
            n[cell_row, cell_col] += n_rows
            mean_px[cell_row, cell_col] += n_rows * contact_px[col]
    for row in range(grid.rows):
        for col in range(grid.cols):
            is_covered = n[row, col] * row_stride >= min_coverage * grid.cell_px**2
            mean_px[row, col] = mean_px[row, col] / n[row, col] if is_covered else 0.0
    return mean_px


@compiled(void(CELLS, float64, CELL_ESTIMATE))
def overlay(
    stixel_px: FloatArray,
    probability: float,
    # input and output
    estimate: CellEstimate,
) -> None:
    """Replace the estimate of cells that have a stixel."""
    for row in range(stixel_px.shape[0]):
        for col in range(stixel_px.shape[1]):
            if stixel_px[row, col] > 0:
                estimate.disparity_px[row, col], estimate.probability[row, col] = stixel_px[row, col], probability


@compiled(void(PLANE, float64, CELL_ESTIMATE))
def raise_to_ground(
    ground: GroundPlane,
    probability: float,
    # input and output
    estimate: CellEstimate,
) -> None:
    """Raise the estimate of cells to the ground, of that probability."""
    for row in range(estimate.disparity_px.shape[0]):
        for col in range(estimate.disparity_px.shape[1]):
            ground_px = plane_at(ground, col, row)
            raised_px = max(estimate.disparity_px[row, col], GROUND_TOLERANCE * ground_px)
            estimate.disparity_px[row, col] = raised_px
            if raised_px < ON_GROUND * ground_px:
                estimate.probability[row, col] = probability
