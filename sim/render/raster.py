"""Rasterisation on a CPU, the fastest visibility backend for small images.

A pixel of direction d = (x, y, 1) sees the triangle with corners a, b, c in the camera frame if no edge function
`(b x c) . d`, `(c x a) . d`, `(a x b) . d`, each over the volume `a . (b x c)`, is negative there; their sum is the
inverse of its depth. All are linear in the pixel's column and row, so each row of a triangle is one span, and the
triangle need not be clipped at the image plane [1]_.

References:
    .. [1] Olano and Greer 1997, Triangle scan conversion using 2D homogeneous coordinates, doi:10.1145/258694.258723
"""

import threading
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import float32, float64, int32, int64, types, uint32, void

from voxdepth.arithmetic import matmul
from voxdepth.compiled import compile_all, compiled, compiled_part, named_tuple
from voxdepth.types import FloatArray, FloatImage, Intrinsics, MaskImage

from ..cpu import mapper
from ..types import Camera, IdImage, Pinhole
from .meshes import SceneMeshes, bounding_sphere, merged, normals
from .raycast import Hits

EDGE_TOLERANCE_PX = 1e-6
"""A pixel this near to an edge belongs to the triangles on both sides, which leaves no gap between them."""
NEAR_M = 1e-3
"""Triangles with a corner nearer than this, or behind the camera, may cover any row."""
MIN_VOLUME_M3 = 1e-15
"""Triangles with a smaller volume are seen edge-on or have no area, and are skipped."""
DEPTH_TOLERANCE = 1e-9
"""Share of a depth by which rounding might change the order of surfaces."""
FLAT = 2.0**-100
"""Slope that stands for 0. As a power of two it divides without rounding."""


class CameraView(NamedTuple):
    """Pose and projection of a camera."""

    R_cam_world: FloatArray
    origin_m: FloatArray
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    near_clip: tuple[float, float, float]
    """Largest inverse depth that is seen, at the origin of the image, and its growth by column and by row; the first is
    +inf for a camera that sees all."""
    height: int
    width: int


class Bodies(NamedTuple):
    """Bodies in the world frame as one mesh, in which the parts of each body are successive."""

    vertices_m: FloatArray
    triangles: npt.NDArray[np.uint32]
    faces: FloatArray
    """Normal of each triangle, and the distance of its plane from the origin against the normal, shape (T, 4)."""
    first_vertex: IdImage
    first_triangle: IdImage
    """Of each body, and the number of all."""


class Buffers(NamedTuple):
    """Buffers for a body; `corners` has room for all bodies."""

    corners: FloatArray
    """Position (x, y, z) [m] of each vertex in the camera frame, and its column and row [px], shape (V, 5)."""
    chosen: IdImage
    planes: FloatArray
    """For each of the three edges of a triangle, the edge function at the origin of the image and its growth by column
    and by row, shape (n, 9)."""
    rows: IdImage
    """Index of a triangle, and its first and last row, shape (n, 3)."""
    inverse_depth: FloatArray
    """Of each pixel of an image, which may be smaller."""


Vector = tuple[float, float, float]
Corner = tuple[float, float, float, float, float]
Box = tuple[int, int, int, int]
Bounds = tuple[float, float, float, float]
"""First and last row and column; a last one is before the first if there is none."""
FLOATS, INDICES, TABLE = float64[::1], int32[::1], float64[:, ::1]
VECTOR, BOUNDS, CORNER = (types.UniTuple(float64, n) for n in (3, 4, 5))
RANGE, BOX = types.UniTuple(int64, 2), types.UniTuple(int64, 4)
VIEW = named_tuple(CameraView, TABLE, FLOATS, *[float64] * 4, VECTOR, int64, int64)
BODIES = named_tuple(Bodies, TABLE, uint32[:, ::1], TABLE, INDICES, INDICES)
BUFFERS = named_tuple(Buffers, TABLE, INDICES, TABLE, int32[:, ::1], FLOATS)


@compiled_part(float64(VECTOR, VECTOR))
def dot(a: Vector, b: Vector) -> float:
    """Return the scalar product of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled(VECTOR(VECTOR, VECTOR))
def cross(a: Vector, b: Vector) -> Vector:
    """Return the vector product of two vectors."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@compiled(void(VIEW, TABLE, int64, int64, TABLE))
def project(
    view: CameraView,
    vertices_m: FloatArray,
    start: int,
    end: int,
    # output
    corners: FloatArray,
) -> None:
    """Place successive vertices in the camera frame and in the image, as `Buffers.corners`.

    Args:
        view: The camera.
        vertices_m: Vertices in the world frame, shape (V, 3).
        start: Index of the first vertex that is placed.
        end: Index after the last one.
        corners: As `Buffers.corners`, shape (V, 5); the rows from `start` to `end` are written.
    """
    R, at_m = view.R_cam_world, view.origin_m
    for i in range(start, end):
        p = (vertices_m[i, 0] - at_m[0], vertices_m[i, 1] - at_m[1], vertices_m[i, 2] - at_m[2])
        # A vertex at or behind the image plane gets a position without meaning, which `box_of` does not use.
        x, y = dot((R[0, 0], R[0, 1], R[0, 2]), p), dot((R[1, 0], R[1, 1], R[1, 2]), p)
        z = dot((R[2, 0], R[2, 1], R[2, 2]), p)
        corners[i, 0], corners[i, 1], corners[i, 2] = x, y, z
        corners[i, 3], corners[i, 4] = view.fx_px * x / z + view.cx_px, view.fy_px * y / z + view.cy_px


@compiled(CORNER(TABLE, uint32))
def corner(corners: FloatArray, i: np.uint32) -> Corner:
    """Return one of the corners that `project` has placed."""
    return corners[i, 0], corners[i, 1], corners[i, 2], corners[i, 3], corners[i, 4]


@compiled_part(int64(TABLE, int64, int64, FLOATS, types.boolean, INDICES))
def choose(
    faces: FloatArray,
    start: int,
    end: int,
    origin_m: FloatArray,
    is_one_sided: bool,
    # output
    chosen: IdImage,
) -> int:
    """List successive triangles, if one-sided only those turned towards the camera, and return their number.

    Args:
        faces: Planes of all triangles in the world frame, as `Bodies.faces`, shape (T, 4).
        start: Index of the first triangle.
        end: Index after the last one.
        origin_m: Position of the camera in the world frame, shape (3,).
        is_one_sided: Whether triangles that are turned away from the camera are left out.
        chosen: Indices of the triangles, of which as many are written as are returned.
    """
    n = 0
    x, y, z = origin_m[0], origin_m[1], origin_m[2]
    for t in range(start, end):
        chosen[n] = t
        n += not is_one_sided or faces[t, 0] * x + faces[t, 1] * y + faces[t, 2] * z + faces[t, 3] > 0
    return n


@compiled_part(RANGE(float64, float64, int64))
def pixels_between(low_px: float, high_px: float, size: int) -> tuple[int, int]:
    """Return the first and last pixel between two positions; the last is before the first if there is none."""
    low, high = max(low_px, 0.0), min(high_px, size - 1.0)
    if not low <= high:  # Also if a position is not a number.
        return 0, -1
    first = int(low)
    return first + (first < low), int(high)


@compiled_part(BOX(CORNER, CORNER, CORNER, int64, int64))
def box_of(a: Corner, b: Corner, c: Corner, height: int, width: int) -> Box:
    """Return the pixels that a triangle may cover.

    Args:
        a: A corner as a row of `Buffers.corners`: its position in the camera frame [m], and its column and row [px].
        b: The next corner.
        c: The last corner.
        height: Rows of the image.
        width: Columns of the image.

    Returns:
        First and last row, and first and last column.
    """
    if min(a[2], b[2], c[2]) <= NEAR_M:
        return (0, height - 1, 0, width - 1) if max(a[2], b[2], c[2]) > 0 else (0, -1, 0, -1)
    left, right = min(a[3], b[3], c[3]) - EDGE_TOLERANCE_PX, max(a[3], b[3], c[3]) + EDGE_TOLERANCE_PX
    top, bottom = min(a[4], b[4], c[4]) - EDGE_TOLERANCE_PX, max(a[4], b[4], c[4]) + EDGE_TOLERANCE_PX
    first_row, last_row = pixels_between(top, bottom, height)
    first_col, last_col = pixels_between(left, right, width)
    return first_row, last_row, first_col, last_col


@compiled_part(types.boolean(BOX, float64, int64, FLOATS))
def is_hidden(box: Box, least_depth_m: float, width: int, inverse_depth: FloatArray) -> bool:
    """Return whether something nearer than a triangle has been drawn in all pixels of its box, if there are any.

    Args:
        box: First and last row, and first and last column, as `box_of` returns them.
        least_depth_m: Depth of its nearest corner; one behind the camera hides nothing.
        width: Columns of the image.
        inverse_depth: What has been drawn [1/m], 0 where there is nothing, shape (H * W,).
    """
    inverse = (1 + DEPTH_TOLERANCE) / least_depth_m if least_depth_m > NEAR_M else np.inf
    for row in range(box[0], box[1] + 1):
        for col in range(box[2], box[3] + 1):
            if inverse_depth[row * width + col] < inverse:
                return False
    return True


@compiled(int64(VIEW, uint32[:, ::1], int64, FLOATS, BUFFERS))
def set_up(
    view: CameraView,
    triangles: npt.NDArray[np.uint32],
    n_chosen: int,
    inverse_depth: FloatArray,
    # output
    buffers: Buffers,
) -> int:
    """Find the edge functions and rows of those chosen triangles that may be seen, and return their number.

    Args:
        view: The camera.
        triangles: Vertex indices of all triangles, shape (T, 3).
        n_chosen: Number of triangles that `choose` has listed.
        inverse_depth: What has been drawn [1/m], 0 where there is nothing, shape (H * W,).
        buffers: `corners` and `chosen` are read, and as many rows of `planes` and `rows` are written as are returned.
    """
    n, corners, planes, rows = 0, buffers.corners, buffers.planes, buffers.rows
    for i in range(n_chosen):
        t = buffers.chosen[i]
        a, b, c = corner(corners, triangles[t, 0]), corner(corners, triangles[t, 1]), corner(corners, triangles[t, 2])
        box = box_of(a, b, c, view.height, view.width)
        if is_hidden(box, min(a[2], b[2], c[2]), view.width, inverse_depth):
            continue
        p, q, r = (a[0], a[1], a[2]), (b[0], b[1], b[2]), (c[0], c[1], c[2])
        u, v, w = cross(q, r), cross(r, p), cross(p, q)
        volume_m3 = dot(p, u)
        if abs(volume_m3) <= MIN_VOLUME_M3:
            continue
        scale = 1 / volume_m3
        x_by_col, y_by_row = scale / view.fx_px, scale / view.fy_px
        for k, edge in enumerate((u, v, w)):
            by_col, by_row = edge[0] * x_by_col, edge[1] * y_by_row
            planes[n, 3 * k] = edge[2] * scale - (by_col * view.cx_px + by_row * view.cy_px)
            planes[n, 3 * k + 1], planes[n, 3 * k + 2] = by_col, by_row
        rows[n, 0], rows[n, 1], rows[n, 2] = t, box[0], box[1]
        n += 1
    return n


@compiled_part(BOUNDS(float64, float64, float64, int64))
def bounds_of(at_origin: float, by_col: float, by_row: float, width: int) -> Bounds:
    """Return the two lines `c + d row` that bound the columns where an edge function is not negative, as (c, d, c, d).

    The function is `at_origin + by_col * column + by_row * row`. The bound that it does not set is outside of the
    image.

    Args:
        at_origin: The function at column 0 and row 0 [1/m].
        by_col: Its growth by column [1/m/px].
        by_row: Its growth by row [1/m/px].
        width: Columns of the image.
    """
    slope = 1 / (by_col if by_col != 0 else FLAT)
    zero_at, shift = -at_origin * slope, -by_row * slope
    if slope > 0:
        return zero_at - EDGE_TOLERANCE_PX, shift, width, 0.0
    return -1.0, 0.0, zero_at + EDGE_TOLERANCE_PX, shift


@compiled(void(TABLE, int32[:, ::1], int64, int64, VECTOR, FLOATS, INDICES))
def draw(
    planes: FloatArray,
    rows: IdImage,
    n: int,
    width: int,
    near_clip: Vector,
    # output
    inverse_depth: FloatArray,
    nearest: IdImage,
) -> None:
    """Draw the first n triangles of the buffers where they are seen and nearer than those before them.

    Args:
        planes: Edge functions as `Buffers.planes` [1/m], shape (n or more, 9).
        rows: As `Buffers.rows`, shape (n or more, 3).
        n: Number of triangles.
        width: Columns of the image.
        near_clip: As `CameraView.near_clip` [1/m].
        inverse_depth: What has been drawn [1/m], 0 where there is nothing, shape (H * W,); changed in place.
        nearest: Index of the triangle that has been drawn, shape (H * W,); changed in place.
    """
    for i in range(n):
        e = bounds_of(planes[i, 0], planes[i, 1], planes[i, 2], width)
        f = bounds_of(planes[i, 3], planes[i, 4], planes[i, 5], width)
        g = bounds_of(planes[i, 6], planes[i, 7], planes[i, 8], width)
        # The sum of the three edge functions is the inverse depth; the fourth bound is where the near plane cuts it.
        start = planes[i, 0] + planes[i, 3] + planes[i, 6]
        step = planes[i, 1] + planes[i, 4] + planes[i, 7]
        step_row = planes[i, 2] + planes[i, 5] + planes[i, 8]
        h = bounds_of(near_clip[0] - start, near_clip[1] - step, near_clip[2] - step_row, width)
        t = rows[i, 0]
        for row in range(rows[i, 1], rows[i, 2] + 1):
            low = max(e[0] + e[1] * row, f[0] + f[1] * row, g[0] + g[1] * row, h[0] + h[1] * row)
            high = min(e[2] + e[3] * row, f[2] + f[3] * row, g[2] + g[3] * row, h[2] + h[3] * row)
            left, right = pixels_between(low, high, width)
            inverse = start + step_row * row
            first = np.uint64(row * width + left)
            for k in range(right - left + 1):
                here = inverse + step * (left + k)
                pixel = first + np.uint64(k)
                before, triangle = inverse_depth[pixel], nearest[pixel]
                is_nearer = here > before
                inverse_depth[pixel] = here if is_nearer else before
                nearest[pixel] = t if is_nearer else triangle


@compiled(void(VIEW, BODIES, INDICES, types.boolean[::1], BUFFERS, float32[::1], INDICES))
def rasterise(
    view: CameraView,
    bodies: Bodies,
    order: IdImage,
    is_one_sided: MaskImage,
    buffers: Buffers,
    # output
    depth_m: FloatImage,
    nearest: IdImage,
) -> None:
    """Find depth and index of the nearest triangle of each pixel of a camera; +inf and T where there is none.

    One-sided bodies are drawn without the faces that are turned away from the camera. It is fastest with bodies in the
    order of their distances.

    Args:
        view: The camera.
        bodies: All bodies, B, where they are.
        order: Indices of the bodies that are drawn, shape (up to B,).
        is_one_sided: Whether a body is drawn one-sided, shape (B,).
        buffers: Room for intermediate results; the content does not matter.
        depth_m: Depth, shape (H * W,); written.
        nearest: Index of the triangle, shape (H * W,); written.
    """
    first_vertex, first_triangle = bodies.first_vertex, bodies.first_triangle
    inverse_depth = buffers.inverse_depth[: len(depth_m)]
    inverse_depth[:] = 0
    nearest[:] = len(bodies.triangles)
    for body in order:
        project(view, bodies.vertices_m, first_vertex[body], first_vertex[body + 1], buffers.corners)
        start, end = first_triangle[body], first_triangle[body + 1]
        n = choose(bodies.faces, start, end, view.origin_m, is_one_sided[body], buffers.chosen)
        n = set_up(view, bodies.triangles, n, inverse_depth, buffers)
        draw(buffers.planes, buffers.rows, n, view.width, view.near_clip, inverse_depth, nearest)
    for pixel in range(len(depth_m)):  # Where nothing was drawn, 1 / 0 is +inf.
        depth_m[pixel] = 1 / inverse_depth[pixel]


class Rasteriser:
    """A visibility backend that draws every triangle that may be in the image. It draws one batch at a time."""

    def __init__(self, meshes: SceneMeshes, threads: int) -> None:
        self._meshes = meshes
        self._map = mapper(threads)
        self._thread_local = threading.local()
        self._normals = [normals(mesh) for mesh in meshes.meshes]
        self._own_spheres_m = [bounding_sphere(mesh) for mesh in meshes.meshes]
        self._spheres_m = np.array(self._own_spheres_m)
        """Centre and radius of a sphere around each body in the world frame, shape (B, 4)."""
        scene = merged(meshes.meshes)
        self._bodies = Bodies(
            vertices_m=np.ascontiguousarray(scene.vertices_m),
            triangles=np.ascontiguousarray(scene.triangles),
            faces=np.empty((len(scene.triangles), 4)),
            first_vertex=_offsets(len(mesh.vertices_m) for mesh in meshes.meshes),
            first_triangle=_offsets(len(mesh.triangles) for mesh in meshes.meshes),
        )
        self._place(range(len(meshes.meshes)))
        compile_all()

    def first_hits(self, cameras: Sequence[Camera]) -> list[Hits]:
        """Return the first hits of the pixels of each camera, with the bodies at the poses that were read last."""
        self._place(self._meshes.moving)
        return list(self._map(self._drawn, cameras))

    def _place(self, moved: Iterable[int]) -> None:
        """Place some of the bodies where they are."""
        bodies = self._bodies
        for body in moved:
            R, position_m = self._meshes.R_world_body[body], self._meshes.position_m[body]
            vertices_m = bodies.vertices_m[bodies.first_vertex[body] : bodies.first_vertex[body + 1]]
            faces = bodies.faces[bodies.first_triangle[body] : bodies.first_triangle[body + 1]]
            vertices_m[:] = matmul(self._meshes.meshes[body].vertices_m, R.T) + position_m
            faces[:, :3] = matmul(self._normals[body], R.T)
            faces[:, 3] = -(faces[:, :3] * vertices_m[self._meshes.meshes[body].triangles[:, 0]]).sum(axis=1)
            self._spheres_m[body, :3] = matmul(R, self._own_spheres_m[body][:3]) + position_m

    def _drawn(self, camera: Camera) -> Hits:
        """Return the bodies whose spheres may be in the image, from the nearest on."""
        view = view_of(camera)
        center_m, radius_m = matmul(self._spheres_m[:, :3] - view.origin_m, view.R_cam_world.T), self._spheres_m[:, 3]
        is_inward = (matmul(center_m, _inward(camera.intrinsics).T) > -radius_m[:, None]).all(axis=1)
        may_see = (center_m[:, 2] > -radius_m) & is_inward
        order = np.argsort(center_m[:, 2] - radius_m, kind="stable").astype(np.int32)
        is_outside = (center_m**2).sum(axis=1) > radius_m**2
        order, is_one_sided = order[may_see[order]], self._meshes.is_closed & is_outside
        depth_m = np.empty(camera.intrinsics.shape, np.float32)
        nearest = np.empty(camera.intrinsics.shape, np.int32)
        buffers = self._buffers(depth_m.size)
        rasterise(view, self._bodies, order, is_one_sided, buffers, depth_m.reshape(-1), nearest.reshape(-1))
        return Hits(depth_m, nearest)

    def _buffers(self, size: int) -> Buffers:
        """Return a thread's buffers, for all vertices, the triangles of the largest body and the pixels of an image."""
        if not hasattr(self._thread_local, "buffers") or len(self._thread_local.buffers.inverse_depth) < size:
            most = int(np.diff(self._bodies.first_triangle).max())
            self._thread_local.buffers = Buffers(
                corners=np.empty((len(self._bodies.vertices_m), 5)),
                chosen=np.empty(most, np.int32),
                planes=np.empty((most, 9)),
                rows=np.empty((most, 3), np.int32),
                inverse_depth=np.empty(size),
            )
        buffers: Buffers = self._thread_local.buffers
        return buffers


def view_of(camera: Camera) -> CameraView:
    """Return a camera as the loops of rasterisation read it."""
    i, T = camera.intrinsics, camera.T_world_cam
    return CameraView(
        R_cam_world=np.ascontiguousarray(T[:3, :3].T, np.float64),
        origin_m=T[:3, 3].astype(np.float64),
        fx_px=i.fx_px,
        fy_px=i.fy_px,
        cx_px=i.cx_px,
        cy_px=i.cy_px,
        near_clip=_near_clip(camera),
        height=i.height_px,
        width=i.width_px,
    )


def _near_clip(camera: Camera) -> Vector:
    """Return the inverse depth at which the ray of a pixel passes the plane of a camera; see `CameraView.near_clip`."""
    if camera.clip_plane is None:
        return np.inf, 0.0, 0.0
    i, T, normal = camera.intrinsics, camera.T_world_cam, camera.clip_plane[:3]
    distance_m = -float(matmul(normal, T[:3, 3]) + camera.clip_plane[3])
    x, y, z = (matmul(T[:3, :3].T, normal) / distance_m).tolist()
    return z - x * i.cx_px / i.fx_px - y * i.cy_px / i.fy_px, x / i.fx_px, y / i.fy_px


def _inward(i: Intrinsics | Pinhole) -> FloatArray:
    """Return normals in the camera frame of the four planes that bound an image, shape (4, 3); they point inwards."""
    left, top = -i.cx_px / i.fx_px, -i.cy_px / i.fy_px
    right, bottom = (i.width_px - 1 - i.cx_px) / i.fx_px, (i.height_px - 1 - i.cy_px) / i.fy_px
    inward = np.array([[1, 0, -left], [-1, 0, right], [0, 1, -top], [0, -1, bottom]])
    return np.asarray(inward / np.linalg.norm(inward, axis=1, keepdims=True), np.float64)


def _offsets(lengths: Iterable[int]) -> IdImage:
    """Return where each of several successive parts begins, and the end of the last one."""
    return np.cumsum([0, *lengths], dtype=np.int32)
