"""Detection of the ground plane, which bounds all measured surfaces from below."""

from dataclasses import dataclass

import numpy as np
from pydantic import Field

from ..model import Model
from ..types import FloatArray

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
        """Disparity [px], negative above the horizon, at columns and rows in cells from the middle of the image.

        The shapes of `u` and `v` are broadcast.
        """
        ground_px: FloatArray = self.slope_u * u + self.slope_v * v + self.middle_px
        return ground_px


def find_ground(
    u: FloatArray, v: FloatArray, disparity_px: FloatArray, rows: int, config: GroundConfig
) -> GroundPlane | None:
    """Find the plane with as many cells as possible on it, and hardly any below it.

    A textureless ground is measured only where objects touch it. The search is therefore not for a surface, but for the
    lower bound of all surfaces. The candidates are planes without roll; the best one is refined by reweighted least
    squares.

    Args:
        u: Columns of the measured cells, from the middle of the image, in cells, shape (N,).
        v: Rows of the measured cells, from the middle of the image, in cells, shape (N,).
        disparity_px: Their mean disparities, positive, shape (N,).
        rows: Number of rows of cells of the image.
        config: When a plane is accepted.

    Returns:
        The ground plane; None if no plane is accepted.
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
    """Reweighted least squares of the relative error. Nearer cells soon lose their weight, farther ones keep it.

    Planes are slopes to the right and downward, and the middle, shape (3,).
    """
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
