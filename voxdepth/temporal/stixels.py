"""Stixels: upright surfaces on the ground, one per image column, with the disparity of their ground contact."""

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
from pydantic import Field

from ..model import Model
from ..types import FloatArray, FloatImage, MaskImage
from .confidence import INPAINTING
from .ground import GroundPlane
from .planes import CellEstimate
from .working_resolution import WorkingResolution

ROW_STRIDE_PX = 4
"""Stride of the rows that are searched, in pixels of the full image."""
MEDIAN_COLUMNS = 5
"""Number of adjacent columns whose median ground contact is used."""
MIN_GROUND_ROWS = 8
"""Rows of a column that must be on the ground, or half of those up to the contact; otherwise it is a wrong match."""
MAX_ROWS_BETWEEN = 2
"""Measured rows between contact and hole that do not separate them, since texture ends raggedly."""
OCCLUDED_LEVEL = 2
"""Level of the cells that take occluded stixels; the finest cells only take those directly above their contact."""
MIN_OCCLUDED_COVERAGE, MIN_COVERAGE = 0.25, 0.5
"""Fraction of a cell that a stixel must cover, for occluded stixels in large cells and for others in the finest
cells."""
GROUND_TOLERANCE = 0.97
"""Estimates have at least this fraction of the disparity of the ground, whose plane is not exact."""
ON_GROUND = 1.05
"""Estimates with at most this multiple of the disparity of the ground are taken for the ground."""


class StixelsConfig(Model):
    """When a measurement is on the ground."""

    tolerance_px: float = Field(0.5, ge=0)
    """Difference to the disparity of the ground up to which a measurement is on it, besides the relative tolerance."""
    relative_tolerance: float = Field(0.05, ge=0)
    """Fraction of the disparity that is added to the tolerance. A stixel ends below a measurement that is farther by
    `tolerance_px` and twice this fraction."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Stixels:
    """Disparity [px] of the stixels and the ground, by cells of the planes; 0 = no stixel."""

    occluded_px: FloatArray
    """All stixels, even behind other surfaces, in cells of `OCCLUDED_LEVEL`."""
    visible_px: FloatArray
    """Stixels in holes directly above their ground contact, in the finest cells, shape (rows, cols)."""
    ground_px: FloatArray
    """Ground in the finest cells, shape (rows, cols); negative above the horizon."""

    def overlay(self, estimate: CellEstimate, level: int) -> CellEstimate:
        """The estimate of a level with stixels where there are some; at level 0 also with nothing below the ground."""
        if level == OCCLUDED_LEVEL:
            return estimate.replace(self.occluded_px > 0, self.occluded_px, INPAINTING.occluded_stixel)
        if level > 0:
            return estimate
        estimate = estimate.replace(self.visible_px > 0, self.visible_px, INPAINTING.stixel)
        disparity_px = np.maximum(estimate.disparity_px, GROUND_TOLERANCE * self.ground_px)
        on_ground = disparity_px < ON_GROUND * self.ground_px
        probability = np.where(on_ground, INPAINTING.ground, estimate.probability)
        return CellEstimate(disparity_px=disparity_px, probability=probability)


class StixelEstimator:
    """Finds the stixels of images of one size.

    The ground contact of a column is its highest measurement on the ground. The holes above have the disparity of the
    contact, up to the first measurement that is farther. Results are in the cells of `PlaneFitter`, of `cell_px` pixels
    a side.
    """

    def __init__(self, resolution: WorkingResolution, cell_px: int, config: StixelsConfig) -> None:
        self._config = config
        self._row_stride = ROW_STRIDE_PX // resolution.decimation
        self._cell_px = cell_px
        height, width = resolution.shape
        rows, cols = -(-height // cell_px), -(-width // cell_px)
        self._shape = (rows, cols)
        self._left = (cols * cell_px - width) // 2
        from_top = np.arange(0, height, self._row_stride)
        self._v = np.asarray((from_top[::-1] + 0.5) / cell_px - rows / 2, np.float64)
        self._height = np.arange(1, len(from_top) + 1, dtype=np.int16)[:, None]
        self._u = np.asarray((np.arange(width) + 0.5 - width / 2) / cell_px, np.float64)

    def estimate(self, disparity_px: FloatImage, ground: GroundPlane) -> Stixels:
        """The stixels of a disparity image, shape (h, w), on its ground plane; holes are 0."""
        config = self._config
        image_px = np.ascontiguousarray(disparity_px[:: self._row_stride][::-1])  # from the bottom up
        contact, contact_px = self._ground_contact(image_px, ground)
        above = self._height > np.where(contact_px > 0, contact, len(image_px))
        measured = (image_px > 0) & above
        min_px = contact_px - (config.tolerance_px + 2 * np.float32(config.relative_tolerance) * contact_px)
        all_holes = above & (_count_up_to(measured & (image_px < min_px)) == 0)
        visible = above & (_count_up_to(measured) <= MAX_ROWS_BETWEEN)
        rows, cols = self._shape
        return Stixels(
            occluded_px=self._cell_means(contact_px, all_holes, 2**OCCLUDED_LEVEL, MIN_OCCLUDED_COVERAGE),
            visible_px=self._cell_means(contact_px, visible, 1, MIN_COVERAGE),
            ground_px=ground.disparity(_middles(cols), _middles(rows)[:, None]),
        )

    def _ground_contact(self, image_px: FloatImage, ground: GroundPlane) -> tuple[npt.NDArray[np.int16], FloatImage]:
        """Row of the ground contact of each column, counted from 1 at the bottom, and its disparity; 0 = no contact.

        Both have shape (w,). The disparity is a median over adjacent columns.
        """
        config = self._config
        ground_px = ground.disparity(self._u, self._v[:, None]).astype(np.float32)
        tolerance_px = config.tolerance_px + np.float32(config.relative_tolerance) * ground_px
        on_ground = (cv2.absdiff(image_px, ground_px) < tolerance_px) & (image_px > 0) & (ground_px > 0)
        contact = np.max(on_ground * self._height, axis=0)
        contact[np.count_nonzero(on_ground, axis=0) < np.minimum(MIN_GROUND_ROWS, contact / 2)] = 0
        contact_px = np.where(contact > 0, image_px[contact - 1, np.arange(len(contact))], np.float32(0))
        return contact, np.asarray(cv2.medianBlur(contact_px[None], MEDIAN_COLUMNS), np.float32)[0]

    def _cell_means(self, contact_px: FloatImage, mask: MaskImage, size: int, min_coverage: float) -> FloatArray:
        """Mean contact disparity of the columns under a mask, by cells of `size` finest cells a side [px].

        The mask has the rows that are searched, from the bottom up. Cells of which it covers less than `min_coverage`
        are 0.
        """
        rows, cols = -(-self._shape[0] // size), -(-self._shape[1] // size)
        height, width = self._cell_px * size // self._row_stride, self._cell_px * size
        covered = np.zeros((rows * height, cols * width), np.float32)
        inside = np.s_[self._left : self._left + mask.shape[1]]
        covered[: mask.shape[0], inside] = mask[::-1]
        weighted_px = covered.copy()
        weighted_px[:, inside] *= contact_px
        coverage, mean_px = (cv2.resize(i, (cols, rows), interpolation=cv2.INTER_AREA) for i in (covered, weighted_px))
        return np.where(coverage >= min_coverage, mean_px / np.maximum(coverage, np.float32(1e-6)), np.float32(0))


def _count_up_to(mask: MaskImage) -> npt.NDArray[np.int16]:
    """Number of pixels of a mask in each column up to each row, itself included."""
    return np.cumsum(mask, axis=0, dtype=np.int16)


def _middles(cells: int) -> FloatArray:
    """Middles of the cells along one side, in cells from the middle of the image."""
    return np.arange(cells, dtype=np.float64) - (cells - 1) / 2
