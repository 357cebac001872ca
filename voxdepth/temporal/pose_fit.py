"""A camera's motion from points and where they are seen, robust against what moves by itself."""

from dataclasses import dataclass

import numpy as np

from ..geometry import exp_se3
from ..types import FloatArray

ITERATIONS = 12
SETTLED = 1e-4
"""Step [m or rad] below which the fit has converged."""
LEAST_SPREAD_PX = 0.15
"""Residuals are never taken to be spread less than this, or the last few exact ones would decide alone."""
TURNING_POINT = 2.0
"""Residuals count for a quarter at this many spreads."""
MEDIAN_TO_SPREAD = 1.26
"""The spread of one coordinate over the median length of a residual of two: Rayleigh's distribution has 0.85."""
NEAREST_M = 0.05
"""Points nearer than this, or behind the camera, do not count."""
IDENTITY = np.eye(6)


@dataclass(frozen=True, kw_only=True, eq=False)
class Pinhole:
    """Focal lengths and principal point of the image that is tracked on [px]."""

    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float

    def project(self, points_m: FloatArray) -> FloatArray:
        """Pixels, shape (N, 2), of points in the camera frame, shape (N, 3)."""
        z = np.maximum(points_m[:, 2], NEAREST_M)
        at_px = np.empty((len(points_m), 2))
        at_px[:, 0] = self.fx_px * points_m[:, 0] / z + self.cx_px
        at_px[:, 1] = self.fy_px * points_m[:, 1] / z + self.cy_px
        return at_px


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """A motion, and how well it explains the points."""

    T_target_source: FloatArray
    """Shape (4, 4)."""
    inlier_share: float
    """Of all points, those that are seen within `inlier_px` of where they should be, 0..1."""
    residual_px: float
    """Median distance of all points."""
    inliers: int


def fit_pose(points_m: FloatArray, seen_px: FloatArray, lens: Pinhole, T_start: FloatArray, inlier_px: float) -> Fit:
    """Gauss-Newton on the reprojection error, with weights that fall with the residual (Geman-McClure).

    Deterministic: no sampling. The spread of the residuals is estimated anew in every step and never grows.

    Args:
        points_m: In the source camera [m], shape (N, 3), N >= 3.
        seen_px: Where the target camera sees them, shape (N, 2).
        lens: Of the target camera.
        T_start: First guess of the motion, shape (4, 4).
        inlier_px: Distance up to which a point supports the motion.
    """
    T, spread_px = T_start.copy(), np.inf
    for _ in range(ITERATIONS):
        moved = points_m @ T[:3, :3].T + T[:3, 3]
        residual = lens.project(moved) - seen_px
        length = np.hypot(*residual.T)
        spread_px = max(LEAST_SPREAD_PX, min(spread_px, MEDIAN_TO_SPREAD * median(length)))
        weight = 1 / np.square(1 + np.square(length / (TURNING_POINT * spread_px)))
        weight[moved[:, 2] <= NEAREST_M] = 0
        step = _step(moved, residual, weight, lens)
        T = exp_se3(step) @ T
        if np.abs(step).max() < SETTLED:
            break
    length = np.hypot(*(lens.project(points_m @ T[:3, :3].T + T[:3, 3]) - seen_px).T)
    return Fit(
        T_target_source=T,
        inlier_share=float(np.mean(length < inlier_px)),
        residual_px=median(length),
        inliers=int(np.count_nonzero(length < inlier_px)),
    )


def _step(moved: FloatArray, residual: FloatArray, weight: FloatArray, lens: Pinhole) -> FloatArray:
    """Small motion (translation, rotation), shape (6,), that reduces the weighted residuals most."""
    inverse_z = 1 / np.maximum(moved[:, 2], NEAREST_M)
    x, y = moved[:, 0] * inverse_z, moved[:, 1] * inverse_z
    along_x, along_y = np.zeros((2, len(moved), 6))
    for column, values in zip((0, 2, 3, 4, 5), (inverse_z, -x * inverse_z, -x * y, 1 + x * x, -y), strict=True):
        along_x[:, column] = values
    for column, values in zip((1, 2, 3, 4, 5), (inverse_z, -y * inverse_z, -1 - y * y, x * y, x), strict=True):
        along_y[:, column] = values
    along_x *= lens.fx_px
    along_y *= lens.fy_px
    weighted_x, weighted_y = along_x * weight[:, None], along_y * weight[:, None]
    H = weighted_x.T @ along_x + weighted_y.T @ along_y
    g = weighted_x.T @ residual[:, 0] + weighted_y.T @ residual[:, 1]
    damping = (1e-9 * H.trace() + 1e-12) * IDENTITY
    step: FloatArray = -np.linalg.solve(H + damping, g)
    return step


def median(values: FloatArray) -> float:
    """The median of at least one finite number, shape (N,): that of NumPy, which takes six times as long for so few."""
    after = len(values) // 2
    if len(values) % 2:
        return float(np.partition(values, after)[after])
    ordered = np.partition(values, (after - 1, after))
    return float((ordered[after - 1] + ordered[after]) / 2)
