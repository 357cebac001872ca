"""Filling of pixels without a measurement: from the ends of their rows and columns, from the memory, or by a guess."""

from typing import NamedTuple

import numpy as np
from numba import boolean, float32, int64, void
from numba.types import Tuple
from pydantic import Field

from ..compiled import BYTE_IMAGE, FLOAT_IMAGE, compile_all, compiled, named_tuple
from ..image_pool import ImagePool
from ..model import Model
from ..types import FloatImage, GrayImage, MaskImage
from .confidence import AGREEMENT, INPAINTING, exponential
from .ground import PLANE, GroundConfig, GroundPlane, find_ground, plane_at
from .planes import (
    CELL_ESTIMATE,
    GRID,
    CellEstimate,
    CellGrid,
    PlaneFitter,
    PlanesConfig,
    bounded,
    interpolate,
    interpolate_rows,
)
from .scanlines import INTERPOLATED_TYPE, Interpolated, ScanlineInterpolator, ScanlinesConfig
from .sky import CELL_PX, find_sky
from .stixels import GROUND_TOLERANCE, StixelEstimator, StixelsConfig
from .working_resolution import WorkingResolution

NO_GROUND = GroundPlane(0.0, 0.0, 0.0)
"""The plane of the least disparities if there is no ground."""
SKY_PROBABILITY = float32(INPAINTING.sky)


class InpaintingConfig(Model):
    """How holes are filled."""

    scanlines: ScanlinesConfig = ScanlinesConfig()
    max_memory_difference_px: float = Field(default=1.0, gt=0)
    """Difference of disparity up to which the memory of a hole agrees with its ends, besides the relative step of the
    scanlines."""
    planes: PlanesConfig = PlanesConfig()
    ground: GroundConfig = GroundConfig()
    stixels: StixelsConfig = StixelsConfig()


class Inpainted(NamedTuple):
    """A disparity image without holes, shape (h, w)."""

    disparity_px: FloatImage
    """Disparity; 0 only if the whole image is empty."""
    probability: FloatImage
    """Probability in 0..1 that an inpainted disparity is of the right surface. In remembered holes it is the factor by
    which the ends of the hole change the probability of the memory, and 1 in measured pixels."""
    remembered: GrayImage
    """Mask of the holes that the memory fills."""


INPAINTED_TYPE = named_tuple(Inpainted, FLOAT_IMAGE, FLOAT_IMAGE, BYTE_IMAGE)


class Inpainter:
    """Fills all holes of a disparity image from the memory and from the image itself."""

    def __init__(self, resolution: WorkingResolution, config: InpaintingConfig) -> None:
        self._config = config
        self._scanlines = ScanlineInterpolator(resolution, config.scanlines)
        self._planes = PlaneFitter(resolution, config.planes)
        self._stixels = StixelEstimator(resolution, self._planes.grid, config.stixels)
        self._floats, self._bytes = ImagePool(resolution.shape, np.float32), ImagePool(resolution.shape, np.uint8)
        compile_all()

    def inpaint(self, measured_px: FloatImage, remembered_px: FloatImage, gray: GrayImage) -> Inpainted:
        """Fill the holes of an image of measured disparities. An empty image stays empty.

        Measured ends of a hole nearby are more often right than the memory, which holds the fattened borders of near
        objects and objects that have left. The memory in turn is more often right than a guess from farther away.
        Nothing is inpainted farther than the farthest known surface.

        Args:
            measured_px: Disparity, shape (h, w); 0 = hole.
            remembered_px: Disparity of the memory in holes, shape (h, w); 0 = unknown or measured.
            gray: Gray image, shape (h, w).
        """
        near, config = self._scanlines.interpolate(measured_px), self._config
        known_px, known, remembered = self._floats.image(), self._bytes.image(), self._bytes.image()
        tolerances = config.max_memory_difference_px, config.scanlines.relative_step
        n_known, farthest_px = recall(
            measured_px, remembered_px, near.disparity_px, *tolerances, known_px, known, remembered
        )
        if n_known == 0 or (n_known == known_px.size and not remembered.any()):
            return Inpainted(known_px, np.ones_like(known_px), remembered)
        estimate, ground = self._guess(known_px, known)
        sky = find_sky(known, gray)
        inpainted = Inpainted(self._floats.image(), self._floats.image(), remembered)
        fill(known_px, near, estimate, self._planes.grid, ground, farthest_px, sky, inpainted)
        return inpainted

    def _guess(self, known_px: FloatImage, known: GrayImage) -> tuple[CellEstimate, GroundPlane]:
        """The estimate of the finest cells, from planes, stixels and the ground; and the ground by pixels."""
        planes = self._planes
        moments = planes.moments(known_px, known)
        ground = find_ground(*planes.cell_means(moments[0]), planes.grid.rows, self._config.ground)
        stixels = None if ground is None else self._stixels.estimate(known_px, ground)
        estimate = None
        for level in reversed(range(planes.levels)):
            estimate = planes.fit(moments[level], level, estimate)
            if stixels is not None:
                stixels.overlay(estimate, level)
        assert estimate is not None
        return estimate, NO_GROUND if ground is None else ground.by_pixels(planes.grid)


@compiled(
    Tuple((int64, float32))(
        FLOAT_IMAGE, FLOAT_IMAGE, FLOAT_IMAGE, float32, float32, FLOAT_IMAGE, BYTE_IMAGE, BYTE_IMAGE
    )
)
def recall(
    measured_px: FloatImage,
    remembered_px: FloatImage,
    near_px: FloatImage,
    tolerance_px: float,
    relative_tolerance: float,
    # output
    known_px: FloatImage,
    known: GrayImage,
    remembered: GrayImage,
) -> tuple[int, float]:
    """Fill holes from the memory, unless their ends have another disparity.

    Returns the number of known pixels, and the least of their disparities.
    """
    n_known, farthest_px = 0, float32(np.inf)
    for row in range(measured_px.shape[0]):
        for col in range(measured_px.shape[1]):
            memory_px, end_px = remembered_px[row, col], near_px[row, col]
            is_contradicted = end_px > 0 and abs(memory_px - end_px) > end_px * relative_tolerance + tolerance_px
            is_remembered = memory_px > 0 and not is_contradicted
            known_px[row, col] = memory_px if is_remembered else measured_px[row, col]
            known[row, col] = 255 if known_px[row, col] > 0 else 0
            remembered[row, col] = 255 if is_remembered else 0
            n_known += known_px[row, col] > 0
            farthest_px = min(farthest_px, known_px[row, col]) if known_px[row, col] > 0 else farthest_px
    return n_known, farthest_px


@compiled(void(FLOAT_IMAGE, INTERPOLATED_TYPE, CELL_ESTIMATE, GRID, PLANE, float32, boolean[:, ::1], INPAINTED_TYPE))
def fill(
    known_px: FloatImage,
    near: Interpolated,
    cells: CellEstimate,
    grid: CellGrid,
    ground: GroundPlane,
    farthest_px: float,
    sky: MaskImage,
    # output
    inpainted: Inpainted,
) -> None:
    """Choose the disparity of each pixel: its own, or that of the ends of its hole, or the guess of its cells."""
    height, width = known_px.shape
    row_px, row_probability = np.empty(grid.cols), np.empty(grid.cols)
    u = (np.arange(width) + (grid.left + 0.5)) / grid.cell_px - 0.5
    for row in range(height):
        v, sky_row = (row + 0.5) / grid.cell_px - 0.5, min(row // CELL_PX, sky.shape[0] - 1)
        interpolate_rows(cells.disparity_px, v, row_px)
        interpolate_rows(cells.probability, bounded(v, grid.rows), row_probability)
        for col in range(width):
            end_px = near.disparity_px[row, col]
            if known_px[row, col] > 0:
                difference_px = abs(known_px[row, col] - end_px)
                disparity_px = known_px[row, col]
                probability = exponential(AGREEMENT, difference_px) if end_px > 0 else float32(1)
            elif end_px > 0:
                ground_px = float32(GROUND_TOLERANCE * plane_at(ground, col, row))
                disparity_px = end_px if near.background[row, col] else max(end_px, ground_px)
                probability = near.probability[row, col]
            else:
                disparity_px = max(float32(interpolate(row_px, u[col])), farthest_px)
                probability = float32(interpolate(row_probability, bounded(u[col], grid.cols)))
                probability = SKY_PROBABILITY if sky[sky_row, min(col // CELL_PX, sky.shape[1] - 1)] else probability
            inpainted.disparity_px[row, col], inpainted.probability[row, col] = disparity_px, probability
