"""The ground plane, which bounds all measured surfaces from below."""

from typing import NamedTuple

import numpy as np
from numba import float64, int64
from numba.types import Tuple
from pydantic import Field

from ..compiled import compiled, named_tuple
from ..geometry import solve_symmetric
from ..model import Model
from ..types import FloatArray
from .planes import VALUES, CellGrid

HORIZONS = np.linspace(-1.0, 0.4, 16)
"""Candidate rows of the horizon, in image heights below the middle of the image; above it they are negative."""
MAX_OUTLIER_RATIO = 0.12
"""Fraction of the cells below the horizon that may be farther than a candidate: wrong matches and dips."""
ITERATIONS = 5
"""Iterations of the refinement, of which the first two tolerate larger errors."""
FARTHER_TOLERANCE = 6.0
"""Factor of the tolerance for cells farther than the ground. They contradict it, while nearer cells are objects on it,
so they keep their weight."""
HALF_OCTAVES = 128
"""Number of half octaves that are told apart, half of them below a pixel."""
BISECTIONS = 32
"""Steps in which the slope of a candidate is found."""
NEAR_QUANTILE = 0.98
"""Quantile of disparity that stands for the nearest cells; those above it may be wrong matches."""
MAX_DISPARITY_RATIO = 5.0
"""Cells of less than the largest disparity through this are ignored: the ground is a plane only near the camera."""
MIN_CELLS = 20
"""Smallest number of measured cells; half as many must be on the ground."""


class GroundConfig(Model):
    """When a plane is accepted as the ground."""

    tolerance: float = Field(default=0.08, gt=0)
    """Relative error of disparity up to which a cell is on the plane."""
    min_inlier_ratio: float = Field(default=0.03, ge=0)
    """Fraction of the cells that must be on the plane. More than 1 disables the detection of the ground."""
    min_disparity_ratio: float = Field(default=1.25, ge=1)
    """Smallest ratio of the disparities of the near end and the far end; a plane with less may be a wall."""
    max_farther_ratio: float = Field(default=0.3, ge=0)
    """Largest number of cells farther than the plane by twice the tolerance, by the number of those on it."""


class GroundPlane(NamedTuple):
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

    def by_pixels(self, grid: CellGrid) -> "GroundPlane":
        """Express the plane by columns and rows of the image, from its first pixel."""
        u, v = (grid.left + 0.5) / grid.cell_px - grid.cols / 2, 0.5 / grid.cell_px - grid.rows / 2
        return GroundPlane(self.slope_u / grid.cell_px, self.slope_v / grid.cell_px, plane_at(self, u, v))

    def by_cells(self, grid: CellGrid) -> "GroundPlane":
        """Express the plane by columns and rows of the finest cells, from the first one."""
        return self._replace(middle_px=plane_at(self, (1 - grid.cols) / 2, (1 - grid.rows) / 2))


PLANE = named_tuple(GroundPlane, float64, float64, float64)


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
    candidate = best_level_plane(v, disparity_px, rows, config.tolerance)
    plane = refine(candidate, u, v, disparity_px, config.tolerance)
    inlier_px, n_farther = find_inliers(plane, u, v, disparity_px, config.tolerance)
    if plane.slope_v <= abs(plane.slope_u) or len(inlier_px) < max(MIN_CELLS / 2, config.min_inlier_ratio * len(u)):
        return None
    if n_farther > config.max_farther_ratio * len(inlier_px):
        return None
    if _quantile(inlier_px, 0.9) < config.min_disparity_ratio * _quantile(inlier_px, 0.1):
        return None
    return plane


def _quantile(values: FloatArray, q: float) -> float:
    """The q-quantile, without interpolation between the values."""
    return float(np.sort(values)[int(q * (len(values) - 1))])


@compiled(float64(PLANE, float64, float64))
def plane_at(plane: GroundPlane, u: float, v: float) -> float:
    """`GroundPlane.disparity` at one position, in compiled functions."""
    return plane.slope_u * u + plane.slope_v * v + plane.middle_px


@compiled(int64(float64))
def _half_octave(disparity_px: float) -> int:
    """Number of the half octave of a disparity, 0..`HALF_OCTAVES`."""
    return min(max(int(np.floor(2 * np.log2(disparity_px))) + HALF_OCTAVES // 2, 0), HALF_OCTAVES - 1)


@compiled(VALUES(VALUES))
def octave_weights(disparity_px: FloatArray) -> FloatArray:
    """A weight per cell, less the more of them share half an octave of disparity: distant surfaces fill more cells."""
    n, weight = np.zeros(HALF_OCTAVES), np.empty(len(disparity_px))
    for k in range(len(disparity_px)):
        n[_half_octave(disparity_px[k])] += 1
    for k in range(len(disparity_px)):
        weight[k] = 1 / np.sqrt(n[_half_octave(disparity_px[k])])
    return weight


@compiled(float64(VALUES, int64))
def steepest_slope(slopes: FloatArray, n_below: int) -> float:
    """The largest slope that not more than that number of slopes are below, to within a billionth of the largest."""
    low, high = 0.0, 0.0
    for k in range(len(slopes)):
        high = max(high, slopes[k])
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        n = 0
        for k in range(len(slopes)):
            n += slopes[k] < middle
        if n <= n_below:
            low = middle
        else:
            high = middle
    return low


@compiled(float64(VALUES, VALUES, float64, float64))
def _rate(slopes: FloatArray, weight: FloatArray, candidate: float, tolerance: float) -> float:
    """The weight of the cells on a candidate minus that of the cells farther than it."""
    farthest, nearest = candidate * (1 - 1.5 * tolerance), candidate * (1 + 1.5 * tolerance)
    rating = 0.0
    for k in range(len(slopes)):
        is_on_plane, is_farther = farthest < slopes[k] < nearest, slopes[k] <= farthest
        rating += weight[k] * (int(is_on_plane) - int(is_farther))
    return rating


@compiled(PLANE(VALUES, VALUES, int64, float64))
def best_level_plane(v: FloatArray, disparity_px: FloatArray, rows: int, tolerance: float) -> GroundPlane:
    """The best candidate without roll, in an image of so many rows of cells.

    For each horizon the candidate is the steepest plane that leaves `MAX_OUTLIER_RATIO` of the cells below it. It is
    rated by the cells on it minus those below it.
    """
    weight, n_cells = octave_weights(disparity_px), len(v)
    slopes, slope_weight = np.empty(n_cells), np.empty(n_cells)
    best_rating, best_slope, best_horizon = -np.inf, 0.0, 0.0
    for horizon in HORIZONS:
        n = 0
        for k in range(n_cells):
            if v[k] - horizon * rows > 0.5:
                slopes[n], slope_weight[n] = disparity_px[k] / (v[k] - horizon * rows), weight[k]
                n += 1
        n_farther = int(MAX_OUTLIER_RATIO * n) + 1
        slope = steepest_slope(slopes[:n], n_farther) if n_farther < n else 0.0
        rating = _rate(slopes[:n], slope_weight[:n], slope, tolerance)
        if rating > best_rating:
            best_rating, best_slope, best_horizon = rating, slope, horizon * rows
    return GroundPlane(0.0, best_slope, -best_slope * best_horizon)


@compiled(float64(float64, float64, float64))
def _robust_weight(disparity_px: float, ground_px: float, tolerance: float) -> float:
    """Weight of a cell in the fit: that of Geman and McClure, of the relative error."""
    error = (disparity_px / ground_px - 1) / tolerance
    error = error / FARTHER_TOLERANCE if error < 0 else error
    return 1 / (1 + error * error) ** 2 / ground_px


@compiled(PLANE(PLANE, VALUES, VALUES, VALUES, float64))
def refine(plane: GroundPlane, u: FloatArray, v: FloatArray, disparity_px: FloatArray, tolerance: float) -> GroundPlane:
    """Reweighted least squares of the relative error. Nearer cells soon lose their weight, farther ones keep it."""
    for iteration in range(ITERATIONS):
        normal, right = np.zeros((3, 3)), np.zeros(3)
        for k in range(len(u)):
            cell = (u[k], v[k], 1.0)
            ground_px = plane_at(plane, u[k], v[k])
            weight = _robust_weight(disparity_px[k], max(ground_px, 1e-6), tolerance * max(1, 3 - iteration))
            weight = weight if ground_px > 0 else 0.0
            for i in range(3):
                right[i] += weight * disparity_px[k] * cell[i]
                for j in range(3):
                    normal[i, j] += weight * cell[i] * cell[j]
        damping = 1e-9 * (normal[0, 0] + normal[1, 1] + normal[2, 2]) + 1e-12
        for i in range(3):
            normal[i, i] += damping
        a, b, c = solve_symmetric(normal, right)
        plane = GroundPlane(a, b, c)
    return plane


@compiled(Tuple((VALUES, int64))(PLANE, VALUES, VALUES, VALUES, float64))
def find_inliers(
    plane: GroundPlane, u: FloatArray, v: FloatArray, disparity_px: FloatArray, tolerance: float
) -> tuple[FloatArray, int]:
    """Disparity of the plane at the cells on it, shape (M,), and the number of cells that are clearly farther."""
    inlier_px = np.empty(len(u))
    n_inliers = n_farther = 0
    for k in range(len(u)):
        ground_px = plane_at(plane, u[k], v[k])
        error = disparity_px[k] / max(ground_px, 1e-6) - 1
        if ground_px > 0 and abs(error) < tolerance:
            inlier_px[n_inliers] = ground_px
            n_inliers += 1
        n_farther += ground_px > 0 and error < -2 * tolerance
    return inlier_px[:n_inliers], n_farther
