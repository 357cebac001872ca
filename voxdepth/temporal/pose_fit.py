"""Robust estimation of a camera's motion from 3D points and their projections."""

from typing import NamedTuple

import numpy as np

from ..geometry import exp_se3
from ..types import FloatArray, Intrinsics

MAX_ITERATIONS = 12
CONVERGENCE_STEP = 1e-4
"""Step [m or rad] below which the iteration has converged."""
MIN_SCALE_PX = 0.15
"""Lower bound of the residual scale; without it, the last few exact points would decide alone."""
KERNEL_WIDTH = 2.0
"""Residual, in units of the scale, at which a point has a quarter of the full weight."""
MEDIAN_TO_SCALE = 1.26
"""Factor from the median residual to the scale. For residuals with Rayleigh's distribution it would be 0.85."""
MIN_DEPTH_M = 0.05
"""Points nearer than this, or behind the camera, have no weight."""


class PoseFit(NamedTuple):
    """An estimated rigid motion, shape (4, 4), and how well it explains the points."""

    T_target_source: FloatArray
    median_residual_px: float
    """Median reprojection error of all points."""
    n_points: int
    n_inliers: int
    """Points whose reprojection error is less than `inlier_px`."""


def fit_pose(
    points_m: FloatArray, observed_px: FloatArray, camera: Intrinsics, T_initial: FloatArray, inlier_px: float
) -> PoseFit:
    """Minimise the reprojection error by Gauss-Newton steps with the weights of Geman and McClure.

    The estimate is deterministic: there is no random sampling. The scale of the residuals is estimated in every
    iteration, and never grows. The points are in the source camera, shape (N, 3), N >= 3, and their observed pixels in
    the target camera, shape (N, 2).
    """
    T, scale_px = T_initial.copy(), np.inf
    for _ in range(MAX_ITERATIONS):
        target_m = transform_points(T, points_m)
        residual = project(target_m, camera) - observed_px
        length = np.hypot(*residual.T)
        scale_px = max(MIN_SCALE_PX, min(scale_px, MEDIAN_TO_SCALE * median(length)))
        weight = 1 / np.square(1 + np.square(length / (KERNEL_WIDTH * scale_px)))
        weight[target_m[:, 2] <= MIN_DEPTH_M] = 0
        step = _gauss_newton_step(target_m, residual, weight, camera)
        T = exp_se3(step) @ T
        if np.abs(step).max() < CONVERGENCE_STEP:
            break
    length = np.hypot(*(project(transform_points(T, points_m), camera) - observed_px).T)
    return PoseFit(T, median(length), len(points_m), int(np.count_nonzero(length < inlier_px)))


def project(points_m: FloatArray, camera: Intrinsics) -> FloatArray:
    """Pixels, shape (N, 2), of points in the camera frame, shape (N, 3), in double precision."""
    z = np.maximum(points_m[:, 2], MIN_DEPTH_M)
    pixels = np.empty((len(points_m), 2))
    pixels[:, 0] = camera.fx_px * points_m[:, 0] / z + camera.cx_px
    pixels[:, 1] = camera.fy_px * points_m[:, 1] / z + camera.cy_px
    return pixels


def transform_points(T_a_b: FloatArray, points_b: FloatArray) -> FloatArray:
    """Points of frame b in the coordinates of frame a, shape (N, 3), in double precision."""
    points_a: FloatArray = points_b @ T_a_b[:3, :3].T + T_a_b[:3, 3]
    return points_a


def median(values: FloatArray) -> float:
    """The median of at least one finite number, shape (N,). NumPy's takes six times as long for a few hundred."""
    middle = len(values) // 2
    if len(values) % 2:
        return float(np.partition(values, middle)[middle])
    ordered = np.partition(values, (middle - 1, middle))
    return float((ordered[middle - 1] + ordered[middle]) / 2)


def _gauss_newton_step(
    target_m: FloatArray, residual: FloatArray, weight: FloatArray, camera: Intrinsics
) -> FloatArray:
    """Translation and rotation vector, shape (6,), that minimise the linearised weighted residuals."""
    inverse_z = 1 / np.maximum(target_m[:, 2], MIN_DEPTH_M)
    x, y = target_m[:, 0] * inverse_z, target_m[:, 1] * inverse_z
    zero = np.zeros_like(x)
    J_col = camera.fx_px * np.stack([inverse_z, zero, -x * inverse_z, -x * y, 1 + x * x, -y], axis=1)
    J_row = camera.fy_px * np.stack([zero, inverse_z, -y * inverse_z, -1 - y * y, x * y, x], axis=1)
    weighted_col, weighted_row = J_col * weight[:, None], J_row * weight[:, None]
    H = weighted_col.T @ J_col + weighted_row.T @ J_row
    gradient = weighted_col.T @ residual[:, 0] + weighted_row.T @ residual[:, 1]
    damping = (1e-9 * H.trace() + 1e-12) * np.eye(6)
    step: FloatArray = -np.linalg.solve(H + damping, gradient)
    return step
