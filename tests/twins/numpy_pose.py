"""Twins of the loops over points and corners: NumPy expressions over all of them, OpenCV and LAPACK."""

import cv2
import numpy as np

from voxdepth.temporal.pose_fit import KnownMotion
from voxdepth.types import FloatArray, FloatImage, GrayImage, Intrinsics, MaskImage


def exp_se3(step: FloatArray) -> FloatArray:
    """The rigid motion of a translation and a rotation vector, shape (6,)."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = cv2.Rodrigues(step[3:])[0], step[:3]
    return T


def log_se3(T: FloatArray) -> FloatArray:
    """The translation and the rotation vector of a rigid motion, shape (6,)."""
    return np.append(T[:3, 3], cv2.Rodrigues(T[:3, :3])[0])


def moved(points_m: FloatArray, T: FloatArray) -> FloatArray:
    return points_m @ T[:3, :3].T + T[:3, 3]


def project(points_m: FloatArray, camera: Intrinsics) -> FloatArray:
    x, y, z = points_m.T
    z = np.maximum(z, 0.05)
    return np.column_stack([camera.fx_px * x / z + camera.cx_px, camera.fy_px * y / z + camera.cy_px])


def residuals(points_m: FloatArray, observed_px: FloatArray, T: FloatArray, camera: Intrinsics) -> FloatArray:
    """Projected minus observed pixels, shape (N, 2)."""
    return project(moved(points_m, T), camera) - observed_px


def sees(points_m: FloatArray, camera: Intrinsics) -> MaskImage:
    in_front = points_m[:, 2] > 0
    x, y, z = np.where(in_front, points_m.T, np.ones((3, 1)))
    col, row = camera.fx_px * x / z + camera.cx_px, camera.fy_px * y / z + camera.cy_px
    return in_front & (col >= 0) & (col <= camera.width_px - 1) & (row >= 0) & (row <= camera.height_px - 1)


def found(positions: FloatImage, status: GrayImage, width_px: int, height_px: int) -> MaskImage:
    inside = (positions >= 0).all(axis=1) & (positions <= (width_px - 1, height_px - 1)).all(axis=1)
    return (status[:, 0] > 0) & inside


def normal_equations(
    points_m: FloatArray, observed_px: FloatArray, T: FloatArray, camera: Intrinsics, scale_px: float
) -> tuple[FloatArray, FloatArray]:
    """Damped Hessian, shape (6, 6), and gradient, shape (6,), of the residuals with weights of Geman and McClure."""
    residual, target_m = residuals(points_m, observed_px, T, camera), moved(points_m, T)
    length = np.hypot(*residual.T)
    weight = np.where(target_m[:, 2] > 0.05, (1 + (length / (2 * scale_px)) ** 2) ** -2.0, 0)
    z = np.maximum(target_m[:, 2], 0.05)
    x, y, zero = target_m[:, 0] / z, target_m[:, 1] / z, np.zeros(len(z))
    J = np.stack(
        [
            camera.fx_px * np.stack([1 / z, zero, -x / z, -x * y, 1 + x * x, -y], axis=1),
            camera.fy_px * np.stack([zero, 1 / z, -y / z, -1 - y * y, x * y, x], axis=1),
        ],
        axis=1,
    )
    H = np.einsum("n,nci,ncj->ij", weight, J, J)
    return H + (1e-9 * H.trace() + 1e-12) * np.eye(6), np.einsum("n,nci,nc->i", weight, J, residual)


def fit(
    points_m: FloatArray,
    observed_px: FloatArray,
    camera: Intrinsics,
    T: FloatArray,
    inlier_px: float,
    known: KnownMotion | None = None,
) -> tuple[FloatArray, float, int]:
    """The motion, the median reprojection error, and the number of inliers."""
    scale_px, unit = np.inf, np.append(np.full(3, np.median(points_m[:, 2])), np.ones(3))
    for _ in range(12):
        median_px = np.median(np.hypot(*residuals(points_m, observed_px, T, camera).T))
        scale_px = max(0.15, min(scale_px, 1.26 * median_px))
        H, gradient = normal_equations(points_m, observed_px, T, camera, scale_px)
        if known is not None:
            difference = log_se3(T @ np.linalg.inv(known.T_target_source))
            information = np.repeat([known.sigma_m, known.sigma_rad], 3) ** -2.0
            weight = (1 + information @ difference**2 / 4) ** -2 * min(scale_px, inlier_px) ** 2
            H, gradient = H + weight * np.diag(information), gradient + weight * information * difference
        step = -np.linalg.solve(H, gradient)
        T = exp_se3(step) @ T
        if np.abs(step / unit).max() < 3e-5:
            break
    length = np.hypot(*residuals(points_m, observed_px, T, camera).T)
    return T, float(np.median(length)), np.count_nonzero(length < inlier_px)


def best_of_cells(eigenvalue: FloatImage, cell_px: int) -> FloatImage:
    """Corners of the cells, in raster order; of equal eigenvalues in a cell, that of the first column counts."""
    rows, cols = eigenvalue.shape[0] // cell_px, eigenvalue.shape[1] // cell_px
    whole = eigenvalue[: rows * cell_px, : cols * cell_px].reshape(rows, cell_px, cols, cell_px)
    by_cell = whole.transpose(0, 2, 3, 1).reshape(rows * cols, cell_px * cell_px)
    cell = np.flatnonzero(by_cell.max(axis=1, initial=0) > np.float32(2e-4))
    col, row = np.divmod(by_cell[cell].argmax(axis=1), cell_px) if cell.size else (cell, cell)
    return np.column_stack([cell % max(cols, 1) * cell_px + col, cell // max(cols, 1) * cell_px + row])


def sample_nearest(image: FloatImage, pixels: FloatImage, scale_x: float, scale_y: float) -> FloatImage:
    col, row = np.rint((pixels.astype(np.float64) + 0.5) * (scale_x, scale_y) - 0.5).astype(int).T
    return image[np.clip(row, 0, image.shape[0] - 1), np.clip(col, 0, image.shape[1] - 1)]


def back_project(
    pixels: FloatImage, disparity_px: FloatImage, focal_baseline_px_m: float, camera: Intrinsics
) -> FloatArray:
    z = focal_baseline_px_m / disparity_px.astype(np.float64)
    x, y = (pixels.astype(np.float64) - (camera.cx_px, camera.cy_px)).T
    return np.column_stack([x * z / camera.fx_px, y * z / camera.fy_px, z])
