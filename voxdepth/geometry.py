"""Back-projection and rigid motion of points."""

from dataclasses import dataclass
from typing import TypeVar

import cv2
import numpy as np
import numpy.typing as npt
from numba import float32, float64, int32, int64, void

from .arithmetic import matmul
from .compiled import FLOAT_IMAGE, FLOAT_ROW, READABLE_IMAGE, compiled, compiled_part
from .types import FloatArray, FloatImage, Intrinsics

PointArray = npt.NDArray[np.float32]
Points = TypeVar("Points", PointArray, FloatArray)


def back_project(depth_m: FloatImage, intrinsics: Intrinsics) -> PointArray:
    """Return the points of all pixels with depth [m] in the camera frame, in raster order, (N, 3), float32.

    `S(u, v) = ((u - cx) z / fx, (v - cy) z / fy, z)`: paper, Eq. surface, whose plus sign before the principal
    point is a misprint (its Algorithm 1 has the minus).
    """
    row, col = np.nonzero(depth_m)
    z = depth_m[row, col]
    points = np.empty((z.size, 3), np.float32)
    points[:, 0] = (col - np.float32(intrinsics.cx_px)) * z / np.float32(intrinsics.fx_px)
    points[:, 1] = (row - np.float32(intrinsics.cy_px)) * z / np.float32(intrinsics.fy_px)
    points[:, 2] = z
    return points


@dataclass(frozen=True, eq=False)
class RayMap:
    """Coordinates of pixels in another frame: `(rows[k, v] + cols[k, u]) z + offset[k]` along axis k.

    It replaces the back-projection of single pixels by six products per row and column. The arrays have the shapes
    (3, H), (3, W) and (3,).
    """

    rows: npt.NDArray[np.float32]
    cols: npt.NDArray[np.float32]
    offset: npt.NDArray[np.float32]

    @classmethod
    def of(cls, intrinsics: Intrinsics, A_frame_cam: FloatArray) -> "RayMap":
        """Return the map for a camera and an affine `A_frame_cam`, shape (4, 4), which need not be rigid.

        With the identity it is the back-projection `S(u, v) = ((u - cx) z / fx, (v - cy) z / fy, z)`.
        """
        x = (np.arange(intrinsics.width_px) - intrinsics.cx_px) / intrinsics.fx_px
        y = (np.arange(intrinsics.height_px) - intrinsics.cy_px) / intrinsics.fy_px
        return cls(
            rows=(A_frame_cam[:3, 1:2] * y + A_frame_cam[:3, 2:3]).astype(np.float32),
            cols=(A_frame_cam[:3, 0:1] * x).astype(np.float32),
            offset=A_frame_cam[:3, 3].astype(np.float32),
        )


def transform(T_a_b: FloatArray, points_b: Points) -> Points:
    """Return points of frame b in the coordinates of frame a, shape (N, 3), in the precision of the points."""
    kind = points_b.dtype
    moved: Points = np.ascontiguousarray(matmul(points_b, T_a_b[:3, :3].T.astype(kind)) + T_a_b[:3, 3].astype(kind))
    return moved


def inverse_rigid(T_a_b: FloatArray) -> FloatArray:
    """Return the inverse `T_b_a` of a rigid `T_a_b`, shape (4, 4)."""
    T_b_a = np.eye(4)
    T_b_a[:3, :3] = T_a_b[:3, :3].T
    T_b_a[:3, 3] = matmul(-T_b_a[:3, :3], T_a_b[:3, 3])
    return T_b_a


@compiled(float64[:, ::1](float64[::1]))
def retract(step: FloatArray) -> FloatArray:
    """Return the rigid motion, shape (4, 4), of a translation [m] and a rotation vector [rad], shape (6,).

    The rotation is that of Rodrigues' formula, and the translation is not coupled with it: a retraction, which is the
    exponential map of SE(3) to first order. That suffices for iterations whose step converges to zero.
    """
    rotation = step[3], step[4], step[5]
    angle = np.sqrt(step[3] * step[3] + step[4] * step[4] + step[5] * step[5])
    sine, one_minus_cosine = (np.sin(angle) / angle, 2 * (np.sin(angle / 2) / angle) ** 2) if angle > 0 else (1.0, 0.5)
    T = np.zeros((4, 4))
    T[3, 3] = 1
    for i in range(3):
        for j in range(3):
            T[i, j] = one_minus_cosine * rotation[i] * rotation[j]
    for i in range(3):
        T[i, i] += np.cos(angle)
        T[i, 3] = step[i]
        T[(i + 2) % 3, (i + 1) % 3] += sine * rotation[i]
        T[(i + 1) % 3, (i + 2) % 3] -= sine * rotation[i]
    return T


@compiled(float64[::1](float64[:, ::1]))
def local_coordinates(T: FloatArray) -> FloatArray:
    """Return the translation [m] and the rotation vector [rad] of a rigid motion, shape (6,): the inverse of `retract`.

    The angle must be less than 180 degrees.
    """
    step = np.empty(6)
    for i in range(3):  # The antisymmetric part of the rotation is its axis times the sine of its angle.
        step[i] = T[i, 3]
        step[3 + i] = (T[(i + 2) % 3, (i + 1) % 3] - T[(i + 1) % 3, (i + 2) % 3]) / 2
    sine = np.sqrt(step[3] * step[3] + step[4] * step[4] + step[5] * step[5])
    factor = np.arctan2(sine, (T[0, 0] + T[1, 1] + T[2, 2] - 1) / 2) / sine if sine > 0 else 1.0
    for i in range(3, 6):  # A slice would compile for seconds.
        step[i] *= factor
    return step


@compiled(float64[:, ::1](float64[:, ::1], float64[:, ::1]))
def compose(T_a_b: FloatArray, T_b_c: FloatArray) -> FloatArray:
    """Return `T_a_c` of two motions, shape (4, 4)."""
    T_a_c = np.zeros((4, 4))
    for i in range(4):
        for j in range(4):
            for k in range(4):
                T_a_c[i, j] += T_a_b[i, k] * T_b_c[k, j]
    return T_a_c


@compiled(float64[::1](float64[:, ::1], float64[::1]))
def solve_symmetric(A: FloatArray, b: FloatArray) -> FloatArray:
    """Return the solution of `A x = b`, shape (N,), by elimination in place; both arguments are overwritten.

    A is positive definite, shape (N, N), and only its lower triangle is read.
    """
    n = len(b)
    for k in range(n):
        for row in range(k + 1, n):
            factor = A[row, k] / A[k, k]
            b[row] -= factor * b[k]
            for col in range(k + 1, row + 1):
                A[row, col] -= factor * A[col, k]
    for k in range(n - 1, -1, -1):
        for col in range(k + 1, n):
            b[k] -= A[col, k] * b[col]
        b[k] /= A[k, k]
    return b


@compiled_part(void(FLOAT_ROW, int64, FLOAT_ROW, int32[::1], FLOAT_ROW))
def _find_cells(
    position_px: FloatImage,
    side: int,
    # output
    inside_px: FloatImage,
    cell: npt.NDArray[np.int32],
    share: FloatImage,
) -> None:
    """Move positions along one side of an image into it, and find the pixel before each, and the share of the next one.

    The pixel before the end of the image is the last but one.

    Args:
        position_px: Columns or rows, which may lie outside or be NaN, shape (N,).
        side: Number of pixels along that side, at least 2.
        inside_px: The positions moved into the image, shape (N,); written.
        cell: Index of the pixel before each, shape (N,); written.
        share: Weight of the pixel after it, 0..1, shape (N,); written.
    """
    last_px, last_cell_px = float32(side - 1), float32(side - 2)
    for k in range(len(position_px)):
        at_px = position_px[k]
        # The comparison is false for NaN.
        inside_px[k] = min(at_px if at_px > 0 else float32(0), last_px)
    for k in range(len(position_px)):
        cell[k] = int32(min(inside_px[k], last_cell_px))
    for k in range(len(position_px)):
        share[k] = inside_px[k] - float32(cell[k])


@compiled(void(READABLE_IMAGE, FLOAT_IMAGE, FLOAT_IMAGE, float32, FLOAT_IMAGE))
def interpolate(
    image: FloatImage,
    x_px: FloatImage,
    y_px: FloatImage,
    outside: float,
    # output
    values: FloatImage,
) -> None:
    """Sample an image bilinearly. OpenCV's `remap` rounds differently on each processor.

    Args:
        image: Shape (H, W), both at least 2.
        x_px: Columns of the samples, shape (h, w); the centre of the first pixel is 0.
        y_px: Their rows, shape (h, w).
        outside: Value beyond the centres of the outermost pixels.
        values: The samples, shape (h, w); written.
    """
    (height, width), n = image.shape, x_px.shape[1]
    pixels, below = image.reshape(height * width), np.uintp(width)
    inside_x, inside_y = np.empty(n, np.float32), np.empty(n, np.float32)
    right_share, low_share = np.empty(n, np.float32), np.empty(n, np.float32)
    cell_x, cell_y = np.empty(n, np.int32), np.empty(n, np.int32)
    for row in range(x_px.shape[0]):
        x, y, value = x_px[row], y_px[row], values[row]
        _find_cells(x, width, inside_x, cell_x, right_share)
        _find_cells(y, height, inside_y, cell_y, low_share)
        for k in range(n):
            at = np.uintp(cell_y[k]) * below + np.uintp(cell_x[k])
            a, b = pixels[at], pixels[at + np.uintp(1)]
            c, d = pixels[at + below], pixels[at + below + np.uintp(1)]
            upper, lower = a + right_share[k] * (b - a), c + right_share[k] * (d - c)
            value[k] = upper + low_share[k] * (lower - upper)
        for k in range(n):
            between, is_inside = value[k], (inside_x[k] == x[k]) & (inside_y[k] == y[k])
            value[k] = between if is_inside else outside


def fill_from_nearest(depth_m: FloatImage) -> FloatImage:
    """Fill invalid pixels (0) with the depth [m] of the nearest valid pixel, shape (H, W), float32.

    An image without a valid pixel stays empty. Distances are 5 x 5 chamfer distances (Borgefors 1986,
    DOI 10.1016/S0734-189X(86)80047-0): the chosen pixel may be up to 4 % farther than the nearest.
    """
    valid = depth_m > 0
    if not valid.any():
        return depth_m.copy()
    _, nearest = cv2.distanceTransformWithLabels(
        (~valid).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    depth_of: FloatImage = np.zeros(int(nearest.max()) + 1, np.float32)
    depth_of[nearest[valid]] = depth_m[valid]
    filled_m: FloatImage = depth_of[nearest]
    return filled_m
