"""The ground plane, which bounds all measured surfaces from below, and stixels: upright surfaces that stand on it."""

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
from pydantic import Field

from ..model import Model
from ..types import FloatArray, FloatImage, MaskImage
from .confidence import INPAINTING
from .planes import CellEstimate, PlaneFitter
from .working_resolution import WorkingResolution

HORIZONS = np.linspace(-1.0, 0.4, 16)
"""Candidate rows of the horizon, in image heights below the middle of the image; above it they are negative."""
MAX_OUTLIER_RATIO = 0.12
"""Fraction of the cells below the horizon that may be farther than a candidate: wrong matches and dips."""
NEAR_QUANTILE = 0.98
"""Quantile of disparity that stands for the nearest cells; those above it may be wrong matches."""
MAX_DISPARITY_RATIO = 5.0
"""Cells of less than the largest disparity through this are ignored: the ground is a plane only near the camera."""
ITERATIONS = 5
"""Iterations of the refinement, of which the first two tolerate larger errors."""
FARTHER_TOLERANCE = 6.0
"""Factor of the tolerance for cells farther than the ground. They contradict it, while nearer cells are objects on it,
so they keep their weight."""
MIN_CELLS = 20
"""Smallest number of measured cells; half as many must be on the ground."""
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


class GroundConfig(Model):
    """When a plane is accepted as the ground."""

    tolerance: float = Field(0.08, gt=0)
    """Relative error of disparity up to which a cell is on the plane."""
    min_inlier_ratio: float = Field(0.03, ge=0)
    """Fraction of the cells that must be on the plane. More than 1 disables the detection of the ground."""
    min_disparity_ratio: float = Field(1.25, ge=1)
    """Smallest ratio of the disparities of the near end and the far end; a plane with less may be a wall."""
    max_farther_ratio: float = Field(0.3, ge=0)
    """Largest number of cells farther than the plane by twice the tolerance, by the number of those on it."""


class StixelsConfig(Model):
    """When a measurement is on the ground. A stixel ends below one that is farther by twice the relative tolerance."""

    tolerance_px: float = Field(0.5, ge=0)
    """Difference to the disparity of the ground up to which a measurement is on it, besides the relative tolerance."""
    relative_tolerance: float = Field(0.05, ge=0)
    """Fraction of the disparity that is added to the tolerance."""


@dataclass(frozen=True, kw_only=True)
class GroundPlane:
    """The ground as a linear function of disparity."""

    slope_u: float
    """Change of disparity [px] per cell to the right."""
    slope_v: float
    """Change of disparity [px] per cell downward. It is larger than that to either side."""
    middle_px: float
    """Disparity at the middle of the image [px], negative where that lies above the horizon."""

    def disparity(self, u: FloatArray, v: FloatArray) -> FloatArray:
        """Disparity [px], negative above the horizon, at columns and rows in cells from the middle of the image."""
        ground_px: FloatArray = self.slope_u * u + self.slope_v * v + self.middle_px
        return ground_px


def find_ground(
    u: FloatArray, v: FloatArray, disparity_px: FloatArray, rows: int, config: GroundConfig
) -> GroundPlane | None:
    """Find the plane with as many cells as possible on it, and hardly any below it.

    A textureless ground is measured only where objects touch it. The search is therefore not for a surface, but for the
    lower bound of all surfaces. The candidates are planes without roll; the best one is refined by reweighted least
    squares.

    The measured cells have columns u and rows v from the middle of the image, and mean disparities, shape (N,). It has
    `rows` rows of cells. The result is None if no plane is accepted.
    """
    if len(u) < MIN_CELLS:
        return None
    near = disparity_px > _quantile(disparity_px, NEAR_QUANTILE) / MAX_DISPARITY_RATIO
    u, v, disparity_px = u[near], v[near], disparity_px[near]
    candidate = _best_level_plane(v, disparity_px, rows, config.tolerance)
    plane = _refine(candidate, u, v, disparity_px, config.tolerance)
    ground_px = plane[0] * u + plane[1] * v + plane[2]
    error = disparity_px / np.maximum(ground_px, 1e-6) - 1
    inliers = (np.abs(error) < config.tolerance) & (ground_px > 0)
    n_farther = np.count_nonzero((error < -2 * config.tolerance) & (ground_px > 0))
    n_inliers = np.count_nonzero(inliers)
    if plane[1] <= abs(plane[0]) or n_inliers < max(MIN_CELLS / 2, config.min_inlier_ratio * len(u)):
        return None
    if n_farther > config.max_farther_ratio * n_inliers:
        return None
    if _quantile(ground_px[inliers], 0.9) < config.min_disparity_ratio * _quantile(ground_px[inliers], 0.1):
        return None
    return GroundPlane(slope_u=float(plane[0]), slope_v=float(plane[1]), middle_px=float(plane[2]))


def _quantile(values: FloatArray, q: float) -> float:
    """The q-quantile, without interpolation between the values."""
    return float(np.sort(values)[int(q * (len(values) - 1))])


def _best_level_plane(v: FloatArray, disparity_px: FloatArray, rows: int, tolerance: float) -> FloatArray:
    """Slopes to the right and downward, and middle, shape (3,), of the best candidate without roll.

    For each horizon the candidate is the steepest plane that leaves `MAX_OUTLIER_RATIO` of the cells below it. It is
    rated by the cells on it minus those below it. Cells weigh less the more of them share half an octave of disparity,
    since distant surfaces fill more cells.
    """
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
    return np.array([0.0, candidate[best], -candidate[best] * rows * HORIZONS[best]])


def _refine(plane: FloatArray, u: FloatArray, v: FloatArray, disparity_px: FloatArray, tolerance: float) -> FloatArray:
    """Reweighted least squares of the relative error. Nearer cells soon lose their weight, farther ones keep it."""
    A = np.stack([u, v, np.ones_like(u)], 1)
    for iteration in range(ITERATIONS):
        ground_px = A @ plane
        below_horizon = ground_px > 0
        ground_px = np.maximum(ground_px, 1e-6)
        error = (disparity_px / ground_px - 1) / (tolerance * max(1, 3 - iteration))
        error[error < 0] /= FARTHER_TOLERANCE
        weighted = A * (below_horizon / np.square(1 + error * error) / ground_px)[:, None]
        normal = A.T @ weighted
        normal += np.eye(3) * (1e-9 * np.trace(normal) + 1e-12)
        plane = np.asarray(np.linalg.solve(normal, disparity_px @ weighted), np.float64)
    return plane


class Stixels(NamedTuple):
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
            return estimate.overlay(self.occluded_px, INPAINTING.occluded_stixel)
        if level > 0:
            return estimate
        estimate = estimate.overlay(self.visible_px, INPAINTING.stixel)
        disparity_px = np.maximum(estimate.disparity_px, GROUND_TOLERANCE * self.ground_px)
        on_ground = disparity_px < ON_GROUND * self.ground_px
        return CellEstimate(disparity_px, np.where(on_ground, INPAINTING.ground, estimate.probability))


class StixelEstimator:
    """Finds the stixels of images of one size, in the cells of a `PlaneFitter`.

    The ground contact of a column is its highest measurement on the ground. The holes above have the disparity of the
    contact, up to the first measurement that is farther.
    """

    def __init__(self, resolution: WorkingResolution, planes: PlaneFitter, config: StixelsConfig) -> None:
        self._config = config
        self._row_stride = ROW_STRIDE_PX // resolution.decimation
        self._planes = planes
        height, width = resolution.shape
        from_top = np.arange(0, height, self._row_stride)
        self._v = np.asarray((from_top[::-1] + 0.5) / planes.cell_px - planes.shape[0] / 2, np.float64)
        self._height = np.arange(1, len(from_top) + 1, dtype=np.int16)[:, None]
        self._u = np.asarray((np.arange(width) + 0.5 - width / 2) / planes.cell_px, np.float64)

    def estimate(self, disparity_px: FloatImage, ground: GroundPlane) -> Stixels:
        """The stixels of a disparity image, shape (h, w), on its ground plane; holes are 0."""
        config = self._config
        image_px = np.ascontiguousarray(disparity_px[:: self._row_stride][::-1])  # from the bottom up
        contact, contact_px = self._ground_contact(image_px, ground)
        above = self._height > np.where(contact_px > 0, contact, len(image_px))
        measured = (image_px > 0) & above
        min_px = contact_px - (config.tolerance_px + 2 * np.float32(config.relative_tolerance) * contact_px)
        all_holes = above & (np.cumsum(measured & (image_px < min_px), axis=0, dtype=np.int16) == 0)
        visible = above & (np.cumsum(measured, axis=0, dtype=np.int16) <= MAX_ROWS_BETWEEN)
        v, u = (np.arange(n, dtype=np.float64) - (n - 1) / 2 for n in self._planes.shape)
        return Stixels(
            occluded_px=self._cell_means(contact_px, all_holes, 2**OCCLUDED_LEVEL, MIN_OCCLUDED_COVERAGE),
            visible_px=self._cell_means(contact_px, visible, 1, MIN_COVERAGE),
            ground_px=ground.disparity(u, v[:, None]),
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
        """Mean contact disparity [px] of the columns under a mask of the rows that are searched, from the bottom up.

        It is 0 in cells, of `size` finest cells a side, of which the mask covers less than `min_coverage`.
        """
        rows, cols = (-(-side // size) for side in self._planes.shape)
        width = self._planes.cell_px * size
        height = width // self._row_stride
        covered = np.zeros((rows * height, cols * width), np.float32)
        inside = np.s_[self._planes.left : self._planes.left + mask.shape[1]]
        covered[: mask.shape[0], inside] = mask[::-1]
        weighted_px = covered.copy()
        weighted_px[:, inside] *= contact_px
        coverage, mean_px = (cv2.resize(i, (cols, rows), interpolation=cv2.INTER_AREA) for i in (covered, weighted_px))
        return np.where(coverage >= min_coverage, mean_px / np.maximum(coverage, np.float32(1e-6)), np.float32(0))
