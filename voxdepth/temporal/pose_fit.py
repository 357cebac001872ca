"""Robust estimation of a camera's motion from 3D points and their projections."""

from typing import NamedTuple

import numpy as np
from numba import float64, int64, void
from numba.types import Tuple, UniTuple

from ..compiled import READABLE_MATRIX, compiled, compiled_part
from ..geometry import compose, inverse_rigid, local_coordinates, retract, solve_symmetric
from ..types import FloatArray, Intrinsics

MAX_ITERATIONS = 12
CONVERGENCE_STEP = 3e-5
"""Rotation [rad], and translation as a share of the median distance of the points, below which the iteration has
converged."""
MIN_SCALE_PX = 0.15
"""Lower bound of the residual scale; without it, the last few exact points would decide alone."""
KERNEL_WIDTH = 2.0
"""Residual, in units of the scale, at which a point has a quarter of the full weight."""
MEDIAN_TO_SCALE = 1.26
"""Factor from the median residual to the scale. For residuals with Rayleigh's distribution it would be 0.85."""
MIN_DEPTH_M = 0.05
"""Points nearer than this, or behind the camera, have no weight."""

Lens = tuple[float, float, float, float]
"""Focal lengths and principal point of a camera [px]."""
LENS_TYPE, MATRIX = UniTuple(float64, 4), float64[:, ::1]


class MotionPrior(NamedTuple):
    """A motion that something else has measured, and its standard deviations."""

    T_target_source: FloatArray
    """Shape (4, 4)."""
    sigma_m: float
    """Standard deviation of each coordinate."""
    sigma_rad: float
    """Standard deviation of the rotation about each axis."""


class PoseFit(NamedTuple):
    """An estimated rigid motion, shape (4, 4), and how well it explains the points."""

    T_target_source: FloatArray
    median_residual_px: float
    """Median reprojection error of all points."""
    n_points: int
    n_inliers: int
    """Points whose reprojection error is less than `inlier_px`."""


def fit_pose(
    points_m: FloatArray,
    observed_px: FloatArray,
    camera: Intrinsics,
    T_initial: FloatArray,
    inlier_px: float,
    known: MotionPrior | None = None,
) -> PoseFit:
    """Minimise the reprojection error by Gauss-Newton steps with the weights of Geman and McClure.

    The estimate is deterministic: there is no random sampling. The scale of the residuals is estimated in every
    iteration, and never grows. A motion that is known counts as one more measurement, with the same weights: it decides
    where the points leave a direction uncertain, and loses its weight where they contradict it.

    Args:
        points_m: Points in the source camera, shape (N, 3), N >= 3.
        observed_px: Column and row of each in the image of the target camera, shape (N, 2).
        camera: Intrinsics of the target camera.
        T_initial: Pose of the source in the target camera that the iteration starts from, shape (4, 4).
        inlier_px: Reprojection error below which a point is an inlier.
        known: A motion that something else has measured; None without one.
    """
    lens, T = lens_of(camera), np.ascontiguousarray(T_initial)
    points_m, observed_px = np.ascontiguousarray(points_m), np.ascontiguousarray(observed_px)
    T_source_target, information = np.eye(4), np.zeros(6)
    if known is not None:
        T_source_target = inverse_rigid(known.T_target_source)
        information[:3], information[3:] = known.sigma_m**-2, known.sigma_rad**-2
    distance_m = float(np.median(points_m[:, 2]))
    T, median_px, n_inliers = _fit(points_m, observed_px, distance_m, T, lens, inlier_px, T_source_target, information)
    return PoseFit(T, median_px, len(points_m), n_inliers)


def project(points_m: FloatArray, camera: Intrinsics) -> FloatArray:
    """Return the pixels, shape (N, 2), of points in the camera frame, shape (N, 3), in double precision."""
    return pixels_of(np.ascontiguousarray(points_m), lens_of(camera))


@compiled(MATRIX(READABLE_MATRIX, LENS_TYPE))
def pixels_of(points_m: FloatArray, lens: Lens) -> FloatArray:
    """Return the pixels of points, see `project`, for a camera that is given by its lens."""
    fx, fy, cx, cy = lens
    pixels = np.empty((len(points_m), 2))
    for k in range(len(points_m)):
        z = max(points_m[k, 2], MIN_DEPTH_M)
        pixels[k, 0], pixels[k, 1] = fx * points_m[k, 0] / z + cx, fy * points_m[k, 1] / z + cy
    return pixels


def lens_of(camera: Intrinsics) -> Lens:
    """Return the focal lengths and the principal point of a camera."""
    return camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px


@compiled_part(UniTuple(float64, 5)(MATRIX, MATRIX, MATRIX, LENS_TYPE, int64))
def _project_point(
    points_m: FloatArray, observed_px: FloatArray, T: FloatArray, lens: Lens, k: int
) -> tuple[float, float, float, float, float]:
    """Return the residual of a point along columns and rows [px], its position divided by its depth, and its depth [m].

    Args:
        points_m: Points in the source camera, shape (N, 3).
        observed_px: Column and row of each in the target image, shape (N, 2).
        T: Pose of the source in the target camera, shape (4, 4).
        lens: That of the target camera.
        k: Index of the point.
    """
    fx, fy, cx, cy = lens
    X, Y, Z = points_m[k]
    x = T[0, 0] * X + T[0, 1] * Y + T[0, 2] * Z + T[0, 3]
    y = T[1, 0] * X + T[1, 1] * Y + T[1, 2] * Z + T[1, 3]
    z = T[2, 0] * X + T[2, 1] * Y + T[2, 2] * Z + T[2, 3]
    x, y = x / max(z, MIN_DEPTH_M), y / max(z, MIN_DEPTH_M)
    return fx * x + cx - observed_px[k, 0], fy * y + cy - observed_px[k, 1], x, y, z


@compiled_part(float64[::1](MATRIX, MATRIX, MATRIX, LENS_TYPE))
def _residual_lengths(points_m: FloatArray, observed_px: FloatArray, T: FloatArray, lens: Lens) -> FloatArray:
    """Return the reprojection error of each point [px], shape (N,).

    Args:
        points_m: Points in the source camera, shape (N, 3).
        observed_px: Column and row of each in the target image, shape (N, 2).
        T: Pose of the source in the target camera, shape (4, 4).
        lens: That of the target camera.
    """
    length_px = np.empty(len(points_m))
    for k in range(len(points_m)):
        col_px, row_px, _, _, _ = _project_point(points_m, observed_px, T, lens, k)
        length_px[k] = np.sqrt(col_px * col_px + row_px * row_px)
    return length_px


@compiled_part(Tuple((MATRIX, float64[::1]))(MATRIX, MATRIX, MATRIX, LENS_TYPE, float64))
def _normal_equations(
    points_m: FloatArray, observed_px: FloatArray, T: FloatArray, lens: Lens, scale_px: float
) -> tuple[FloatArray, FloatArray]:
    """Return Hessian, shape (6, 6), and gradient, shape (6,), of the weighted squares of the linearised residuals.

    They are for a translation and a rotation vector, which move the points in the target camera. Only the lower
    triangle of the Hessian is set, and its diagonal is damped slightly.

    Args:
        points_m: Points in the source camera, shape (N, 3).
        observed_px: Column and row of each in the target image, shape (N, 2).
        T: Pose of the source in the target camera, shape (4, 4).
        lens: That of the target camera.
        scale_px: Scale of the residuals, with which the weights fall.
    """
    fx, fy, _, _ = lens
    H, gradient = np.zeros((6, 6)), np.zeros(6)
    J_col, J_row = np.zeros(6), np.zeros(6)
    for k in range(len(points_m)):
        col_px, row_px, x, y, z = _project_point(points_m, observed_px, T, lens, k)
        if z <= MIN_DEPTH_M:
            continue
        weight = 1 / (1 + (col_px * col_px + row_px * row_px) / (KERNEL_WIDTH * scale_px) ** 2) ** 2
        # Derivatives of column and row by the translation and the rotation vector; x and y are divided by the depth.
        J_col[0], J_col[2], J_col[3], J_col[4], J_col[5] = fx / z, -fx * x / z, -fx * x * y, fx * (1 + x * x), -fx * y
        J_row[1], J_row[2], J_row[3], J_row[4], J_row[5] = fy / z, -fy * y / z, -fy * (1 + y * y), fy * x * y, fy * x
        for i in range(6):
            gradient[i] += weight * (J_col[i] * col_px + J_row[i] * row_px)
            for j in range(i + 1):
                H[i, j] += weight * (J_col[i] * J_col[j] + J_row[i] * J_row[j])
    trace = H[0, 0] + H[1, 1] + H[2, 2] + H[3, 3] + H[4, 4] + H[5, 5]
    for i in range(6):
        H[i, i] += 1e-9 * trace + 1e-12
    return H, gradient


@compiled_part(void(MATRIX, MATRIX, float64[::1], float64, MATRIX, float64[::1]))
def _add_known(
    T: FloatArray,
    T_source_target: FloatArray,
    information: FloatArray,
    point_sigma_px: float,
    # input and output
    H: FloatArray,
    gradient: FloatArray,
) -> None:
    """Add a known motion to the normal equations.

    The normal equations of the points lack the factor of their own variance, `1 / point_sigma_px**2`.

    Args:
        T: Present estimate of the pose of the source in the target camera, shape (4, 4).
        T_source_target: Inverse of the known motion, shape (4, 4).
        information: Inverse variances of its translation [1/m^2] and rotation [1/rad^2], shape (6,).
        point_sigma_px: Standard deviation of the residuals of the points.
        H: Hessian of the points, shape (6, 6); its diagonal is changed in place.
        gradient: Their gradient, shape (6,); changed in place.
    """
    difference = local_coordinates(compose(T, T_source_target))
    squared = 0.0
    for i in range(6):
        squared += information[i] * difference[i] * difference[i]
    weight = (point_sigma_px / (1 + squared / KERNEL_WIDTH**2)) ** 2
    for i in range(6):
        H[i, i] += weight * information[i]
        gradient[i] += weight * information[i] * difference[i]


@compiled(Tuple((MATRIX, float64, int64))(MATRIX, MATRIX, float64, MATRIX, LENS_TYPE, float64, MATRIX, float64[::1]))
def _fit(
    points_m: FloatArray,
    observed_px: FloatArray,
    distance_m: float,
    T: FloatArray,
    lens: Lens,
    inlier_px: float,
    T_source_target: FloatArray,
    information: FloatArray,
) -> tuple[FloatArray, float, int]:
    """Return the motion, shape (4, 4), the median reprojection error [px], and the number of inliers.

    Args:
        points_m: Points in the source camera, shape (N, 3).
        observed_px: Column and row of each in the target image, shape (N, 2).
        distance_m: Median depth of the points.
        T: Pose of the source in the target camera that the iteration starts from, shape (4, 4).
        lens: That of the target camera.
        inlier_px: Reprojection error below which a point is an inlier.
        T_source_target: Inverse of a known motion, shape (4, 4); unused if none is known.
        information: Inverse variances of its translation [1/m^2] and rotation [1/rad^2], shape (6,); 0 if none is
            known.
    """
    length_px, scale_px = _residual_lengths(points_m, observed_px, T, lens), np.inf
    for _ in range(MAX_ITERATIONS):
        scale_px = max(MIN_SCALE_PX, min(scale_px, MEDIAN_TO_SCALE * np.median(length_px)))
        H, gradient = _normal_equations(points_m, observed_px, T, lens, scale_px)
        # Residuals are large at first because the motion is wrong, which makes the known motion no more certain.
        _add_known(T, T_source_target, information, min(scale_px, inlier_px), H, gradient)
        step = -solve_symmetric(H, gradient)
        T = compose(retract(step), T)
        length_px = _residual_lengths(points_m, observed_px, T, lens)
        shift_m, turn = max(abs(step[0]), abs(step[1]), abs(step[2])), max(abs(step[3]), abs(step[4]), abs(step[5]))
        if max(shift_m / distance_m, turn) < CONVERGENCE_STEP:
            break
    return T, np.median(length_px), int(np.count_nonzero(length_px < inlier_px))
