"""Triangle rasterisation as compiled loops.

A pixel of direction d = (x, y, 1) sees the triangle with corners a, b, c in the camera frame if no edge function
`(b x c) . d`, `(c x a) . d`, `(a x b) . d`, each over the volume `a . (b x c)`, is negative there; their sum is the
inverse of its depth. All are linear in the pixel's column and row, so each row of a triangle is one span, and the
triangle need not be clipped at the image plane (Olano and Greer 1997, "Triangle scan conversion using 2D homogeneous
coordinates", doi:10.1145/258694.258723).
"""

import numpy as np
import numpy.typing as npt

from voxdepth.compiled import compiled
from voxdepth.types import FloatArray, FloatImage, MaskImage

from ..types import IdImage

EDGE_TOLERANCE_PX = 1e-6
"""A pixel this near to an edge belongs to the triangles on both sides, which leaves no gap between them."""
NEAR_M = 1e-3
"""Triangles with a corner nearer than this, or behind the camera, may cover any row."""
MIN_VOLUME_M3 = 1e-15
"""Triangles with a smaller volume are seen edge-on or have no area, and are skipped."""
FLAT = 2.0**-100
"""Slope that stands for 0. As a power of two it divides without rounding."""

Triangles = npt.NDArray[np.uint32]
Vector = tuple[float, float, float]
Bounds = tuple[float, float, float, float]
Corner = tuple[float, float, float, float, float]


@compiled("f8(UniTuple(f8, 3), UniTuple(f8, 3))")
def dot(a: Vector, b: Vector) -> float:
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled("UniTuple(f8, 3)(UniTuple(f8, 3), UniTuple(f8, 3))")
def cross(a: Vector, b: Vector) -> Vector:
    """Vector product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@compiled("b1(f8[:, ::1], f8[::1], f8[:, ::1], f8[::1])")
def may_see(R_cam_world: FloatArray, origin_m: FloatArray, inward: FloatArray, sphere_m: FloatArray) -> bool:
    """Whether a part of a sphere, given by centre and radius, may be in the image."""
    R, radius_m = R_cam_world, sphere_m[3]
    x, y, z = sphere_m[0] - origin_m[0], sphere_m[1] - origin_m[1], sphere_m[2] - origin_m[2]
    right = R[0, 0] * x + R[0, 1] * y + R[0, 2] * z
    down = R[1, 0] * x + R[1, 1] * y + R[1, 2] * z
    ahead = R[2, 0] * x + R[2, 1] * y + R[2, 2] * z
    inside = ahead > -radius_m
    for k in range(4):
        inside &= inward[k, 0] * right + inward[k, 1] * down + inward[k, 2] * ahead > -radius_m
    return bool(inside)


@compiled("void(f8[:, ::1], f8[::1], f8[::1], f8[:, ::1], f8[:, ::1])")
def project(
    R_cam_world: FloatArray,
    origin_m: FloatArray,
    pinhole_px: FloatArray,
    vertices_m: FloatArray,
    # output
    corners: FloatArray,
) -> None:
    """Place (x, y, z) [m] in the camera frame and (column, row) [px] of each vertex, shape (V, 5)."""
    R = R_cam_world
    for i in range(len(vertices_m)):
        x, y, z = vertices_m[i, 0] - origin_m[0], vertices_m[i, 1] - origin_m[1], vertices_m[i, 2] - origin_m[2]
        right = R[0, 0] * x + R[0, 1] * y + R[0, 2] * z
        down = R[1, 0] * x + R[1, 1] * y + R[1, 2] * z
        ahead = R[2, 0] * x + R[2, 1] * y + R[2, 2] * z
        corners[i, 0], corners[i, 1], corners[i, 2] = right, down, ahead
        corners[i, 3] = pinhole_px[0] * right / ahead + pinhole_px[2]
        corners[i, 4] = pinhole_px[1] * down / ahead + pinhole_px[3]


@compiled("UniTuple(f8, 5)(f8[:, ::1], u4)")
def corner(corners: FloatArray, i: int) -> Corner:
    """One of the corners that `project` has placed."""
    return corners[i, 0], corners[i, 1], corners[i, 2], corners[i, 3], corners[i, 4]


@compiled("UniTuple(i8, 2)(f8, f8, i8)")
def pixels_between(low_px: float, high_px: float, size: int) -> tuple[int, int]:
    """First and last pixel of an image between two places; the last is before the first if there is none."""
    low, high = max(low_px, 0.0), min(high_px, size - 1.0)
    if not low <= high:  # Also if a place is not a number.
        return 0, -1
    first = int(low)
    return first + (first < low), int(high)


@compiled("UniTuple(i8, 2)(UniTuple(f8, 5), UniTuple(f8, 5), UniTuple(f8, 5), i8, i8)")
def rows_of(a: Corner, b: Corner, c: Corner, height: int, width: int) -> tuple[int, int]:
    """First and last row that a triangle may cover; the last row is before the first if it covers none."""
    if min(a[2], b[2], c[2]) > NEAR_M:
        low, high = min(a[3], b[3], c[3]) - EDGE_TOLERANCE_PX, max(a[3], b[3], c[3]) + EDGE_TOLERANCE_PX
        left, right = pixels_between(low, high, width)
        low, high = min(a[4], b[4], c[4]) - EDGE_TOLERANCE_PX, max(a[4], b[4], c[4]) + EDGE_TOLERANCE_PX
        return pixels_between(low, high, height) if left <= right else (0, -1)
    return (0, height - 1) if max(a[2], b[2], c[2]) > 0 else (0, -1)


@compiled("i8(f8[:, ::1], u4[:, ::1], i8, i8, b1, f8[::1], i8, i8, f8[:, ::1], i4[:, ::1])")
def set_up(
    corners: FloatArray,
    triangles: Triangles,
    start: int,
    end: int,
    one_sided: bool,
    pinhole_px: FloatArray,
    height: int,
    width: int,
    # output
    planes: FloatArray,
    rows: IdImage,
) -> int:
    """Edge functions of those of successive triangles that may be in the image, and their number.

    A row of `planes` has, for each of the three edges, what the edge function is at the origin of the image and how it
    grows by column and by row. A row of `rows` has the index of the triangle, its first row and its last one.
    """
    n = 0
    x_by_col, y_by_row, cx, cy = 1.0 / pinhole_px[0], 1.0 / pinhole_px[1], pinhole_px[2], pinhole_px[3]
    for t in range(start, end):
        a, b, c = corner(corners, triangles[t, 0]), corner(corners, triangles[t, 1]), corner(corners, triangles[t, 2])
        top, bottom = rows_of(a, b, c, height, width)
        if top > bottom:
            continue
        p, q, r = (a[0], a[1], a[2]), (b[0], b[1], b[2]), (c[0], c[1], c[2])
        u, v, w = cross(q, r), cross(r, p), cross(p, q)
        volume_m3 = dot(p, u)
        if (-volume_m3 if one_sided else abs(volume_m3)) <= MIN_VOLUME_M3:
            continue
        rows[n, 0], rows[n, 1], rows[n, 2] = t, top, bottom
        for k, edge in enumerate((u, v, w)):
            by_col, by_row = edge[0] / volume_m3 * x_by_col, edge[1] / volume_m3 * y_by_row
            planes[n, 3 * k] = edge[2] / volume_m3 - (by_col * cx + by_row * cy)
            planes[n, 3 * k + 1] = by_col
            planes[n, 3 * k + 2] = by_row
        n += 1
    return n


@compiled("UniTuple(f8, 4)(f8, f8, f8, i8)")
def bounds_of(at_origin: float, by_col: float, by_row: float, width: int) -> Bounds:
    """The two lines `c + d row` that bound the columns where an edge function is not negative, as (c, d, c, d).

    The function is `at_origin + by_col * column + by_row * row`. The bound that it does not set is outside of the
    image.
    """
    slope = by_col if by_col != 0 else FLAT
    zero_at, shift = -at_origin / slope, -by_row / slope
    if slope > 0:
        return zero_at - EDGE_TOLERANCE_PX, shift, width, 0.0
    return -1.0, 0.0, zero_at + EDGE_TOLERANCE_PX, shift


@compiled("void(f8[:, ::1], i4[:, ::1], i8, i8, f8[::1], i4[::1])")
def draw(
    planes: FloatArray,
    rows: IdImage,
    n: int,
    width: int,
    # output
    inverse_depth: FloatArray,
    nearest: IdImage,
) -> None:
    """Draw the first n triangles where they are nearer than those before them."""
    for i in range(n):
        e = bounds_of(planes[i, 0], planes[i, 1], planes[i, 2], width)
        f = bounds_of(planes[i, 3], planes[i, 4], planes[i, 5], width)
        g = bounds_of(planes[i, 6], planes[i, 7], planes[i, 8], width)
        start = planes[i, 0] + planes[i, 3] + planes[i, 6]
        step = planes[i, 1] + planes[i, 4] + planes[i, 7]
        step_row = planes[i, 2] + planes[i, 5] + planes[i, 8]
        t = rows[i, 0]
        for row in range(rows[i, 1], rows[i, 2] + 1):
            low = max(e[0] + e[1] * row, f[0] + f[1] * row, g[0] + g[1] * row)
            high = min(e[2] + e[3] * row, f[2] + f[3] * row, g[2] + g[3] * row)
            left, right = pixels_between(low, high, width)
            inverse = start + step_row * row
            first = np.uint64(row * width + left)
            for k in range(right - left + 1):
                here = inverse + step * (left + k)
                pixel = first + np.uint64(k)
                if here > inverse_depth[pixel]:
                    inverse_depth[pixel] = here
                    nearest[pixel] = t


@compiled("b1(f8[::1], f8[::1])")
def is_outside(origin_m: FloatArray, sphere_m: FloatArray) -> bool:
    """Whether a point is outside of a sphere, given by centre and radius."""
    x, y, z = sphere_m[0] - origin_m[0], sphere_m[1] - origin_m[1], sphere_m[2] - origin_m[2]
    return bool(x * x + y * y + z * z > sphere_m[3] * sphere_m[3])


@compiled(
    "void(f8[:, ::1], f8[::1], f8[::1], f8[:, ::1], f8[:, ::1], u4[:, ::1], i4[::1], i4[::1], f8[:, ::1], b1[::1], i8,"
    "i8, f8[:, ::1], f8[:, ::1], i4[:, ::1], f8[::1], i4[::1])"
)
def rasterise(
    R_cam_world: FloatArray,
    origin_m: FloatArray,
    pinhole_px: FloatArray,
    inward: FloatArray,
    vertices_m: FloatArray,
    triangles: Triangles,
    first_vertex: IdImage,
    first_triangle: IdImage,
    spheres_m: FloatArray,
    is_closed: MaskImage,
    height: int,
    width: int,
    # buffers
    corners: FloatArray,
    planes: FloatArray,
    rows: IdImage,
    inverse_depth: FloatArray,
    # output
    nearest: IdImage,
) -> None:
    """Index of the nearest triangle of each pixel of a camera, and its inverse depth.

    The nearest triangle and the inverse depth keep their values where there is no nearer triangle. Faces that are
    turned away are left out if they belong to a closed surface that the camera is outside of.
    """
    for body in range(len(spheres_m)):
        if may_see(R_cam_world, origin_m, inward, spheres_m[body]):
            start, end = first_vertex[body], first_vertex[body + 1]
            project(R_cam_world, origin_m, pinhole_px, vertices_m[start:end], corners[start:end])
            one_sided = is_closed[body] & is_outside(origin_m, spheres_m[body])
            start, end = first_triangle[body], first_triangle[body + 1]
            n = set_up(corners, triangles, start, end, one_sided, pinhole_px, height, width, planes, rows)
            draw(planes, rows, n, width, inverse_depth, nearest)


@compiled("void(f8[::1], f4[::1])")
def invert(
    inverse_depth: FloatArray,
    # output
    depth_m: FloatImage,
) -> None:
    """Depth [m] of each pixel; +inf where the inverse is 0."""
    for i in range(len(depth_m)):
        depth_m[i] = 1.0 / inverse_depth[i]
