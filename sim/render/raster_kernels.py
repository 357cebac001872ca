"""Triangle rasterisation as Warp kernels.

A pixel of direction d = (x, y, 1) sees the triangle with corners a, b, c in the camera frame if no edge function
`(b x c) . d`, `(c x a) . d`, `(a x b) . d`, each over the volume `a . (b x c)`, is negative there; their sum is the
inverse of its depth. All are linear in the pixel's column and row, so each row of a triangle is one span, and the
triangle need not be clipped at the image plane (Olano and Greer 1997, "Triangle scan conversion using 2D homogeneous
coordinates", doi:10.1145/258694.258723).
"""

# mypy: disable-error-code="no-untyped-def,type-arg,valid-type,untyped-decorator,no-any-return,index,misc"
# mypy: disable-error-code="operator,arg-type,call-overload,attr-defined"
import warp as wp

wp.set_module_options({"enable_backward": False})

EDGE_TOLERANCE_PX = wp.constant(wp.float64(1e-6))
"""A pixel this near to an edge belongs to the triangles on both sides, which leaves no gap between them."""
NEAR_M = wp.constant(wp.float64(1e-3))
"""Triangles with a corner nearer than this, or behind the camera, may cover any row."""
MIN_VOLUME_M3 = wp.constant(wp.float64(1e-15))
"""Triangles with a smaller volume are seen edge-on or have no area, and are skipped."""
ZERO = wp.constant(wp.float64(0.0))


@wp.struct
class View:
    """Pose, projection and bounding planes of a camera; the normals of the planes point inwards."""

    R_cam_world: wp.mat33d
    origin_m: wp.vec3d
    focal_px: wp.vec2d
    center_px: wp.vec2d
    inward: wp.types.matrix(shape=(4, 3), dtype=wp.float64)


@wp.func
def may_see(view: View, sphere_m: wp.vec4d):
    """Whether a part of a sphere, given by centre and radius, may be in the image."""
    c = view.R_cam_world * (wp.vec3d(sphere_m[0], sphere_m[1], sphere_m[2]) - view.origin_m)
    return c[2] > -sphere_m[3] and wp.min(view.inward * c) > -sphere_m[3]


@wp.func
def rows_of(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d, pa: wp.vec2d, pb: wp.vec2d, pc: wp.vec2d, height: int, width: int):
    """First and last row that a triangle may cover; the last row is before the first if it covers none."""
    if wp.min(a[2], wp.min(b[2], c[2])) > NEAR_M:
        low = wp.min(pa, wp.min(pb, pc))
        high = wp.max(pa, wp.max(pb, pc))
        left = wp.max(wp.ceil(low[0] - EDGE_TOLERANCE_PX), ZERO)
        right = wp.min(wp.floor(high[0] + EDGE_TOLERANCE_PX), wp.float64(width - 1))
        top = wp.max(wp.ceil(low[1] - EDGE_TOLERANCE_PX), ZERO)
        bottom = wp.min(wp.floor(high[1] + EDGE_TOLERANCE_PX), wp.float64(height - 1))
        if left > right or top > bottom:
            return wp.vec2i(0, -1)
        return wp.vec2i(int(top), int(bottom))
    if wp.max(a[2], wp.max(b[2], c[2])) <= ZERO:
        return wp.vec2i(0, -1)
    return wp.vec2i(0, height - 1)


@wp.func
def span_of(
    row: int, by_col: wp.vec3d, by_row: wp.vec3d, at_origin: wp.vec3d, zero_at: wp.vec3d, shift: wp.vec3d, width: int
):
    """First and last column of a row in which no edge function is negative.

    The edge functions are zero in the columns `zero_at + shift * row`.
    """
    low = ZERO
    high = wp.float64(width - 1)
    for i in range(3):
        bound = zero_at[i] + shift[i] * wp.float64(row)
        if by_col[i] > ZERO:
            low = wp.max(low, bound - EDGE_TOLERANCE_PX)
        elif by_col[i] < ZERO:
            high = wp.min(high, bound + EDGE_TOLERANCE_PX)
        elif at_origin[i] + by_row[i] * wp.float64(row) < ZERO:
            high = wp.float64(-1.0)
    if low > high:
        return wp.vec2i(0, -1)
    return wp.vec2i(int(wp.ceil(low)), int(wp.floor(high)))


@wp.func
def draw(
    t: int,
    a: wp.vec3d,
    b: wp.vec3d,
    c: wp.vec3d,
    rows: wp.vec2i,
    view: View,
    # output
    inverse_depth: wp.array2d(dtype=wp.float64),
    nearest: wp.array2d(dtype=wp.int32),
):
    """Draw triangle t where it is nearer than the triangles before it."""
    volume_m3 = wp.dot(a, wp.cross(b, c))
    if wp.abs(volume_m3) <= MIN_VOLUME_M3:
        return
    edges = wp.matrix_from_rows(wp.cross(b, c), wp.cross(c, a), wp.cross(a, b)) / volume_m3
    by_col = edges * wp.vec3d(wp.float64(1.0) / view.focal_px[0], ZERO, ZERO)
    by_row = edges * wp.vec3d(ZERO, wp.float64(1.0) / view.focal_px[1], ZERO)
    at_origin = edges * wp.vec3d(ZERO, ZERO, wp.float64(1.0))
    at_origin -= by_col * view.center_px[0] + by_row * view.center_px[1]
    step = by_col[0] + by_col[1] + by_col[2]
    step_row = by_row[0] + by_row[1] + by_row[2]
    start = at_origin[0] + at_origin[1] + at_origin[2]
    zero_at = -wp.cw_div(at_origin, by_col)
    shift = -wp.cw_div(by_row, by_col)
    for row in range(rows[0], rows[1] + 1):
        cols = span_of(row, by_col, by_row, at_origin, zero_at, shift, inverse_depth.shape[1])
        inverse = start + step_row * wp.float64(row)
        for col in range(cols[0], cols[1] + 1):
            here = inverse + step * wp.float64(col)
            if here > inverse_depth[row, col]:
                inverse_depth[row, col] = here
                nearest[row, col] = t


@wp.kernel
def rasterise(
    views: wp.array(dtype=View),
    vertices_m: wp.array(dtype=wp.vec3d),
    triangles: wp.array(dtype=wp.vec3i),
    first_vertex: wp.array(dtype=wp.int32),
    first_triangle: wp.array(dtype=wp.int32),
    spheres_m: wp.array(dtype=wp.vec4d),
    # buffers
    in_camera_m: wp.array2d(dtype=wp.vec3d),
    projected_px: wp.array2d(dtype=wp.vec2d),
    inverse_depth: wp.array3d(dtype=wp.float64),
    # output
    nearest: wp.array3d(dtype=wp.int32),
):
    """One thread per camera: index of the nearest triangle of each pixel, -1 for none, and its inverse depth."""
    k = wp.tid()
    view = views[k]
    height = nearest.shape[1]
    width = nearest.shape[2]
    for row in range(height):
        for col in range(width):
            inverse_depth[k, row, col] = ZERO
            nearest[k, row, col] = -1
    for body in range(spheres_m.shape[0]):
        if may_see(view, spheres_m[body]):
            for i in range(first_vertex[body], first_vertex[body + 1]):
                p = view.R_cam_world * (vertices_m[i] - view.origin_m)
                in_camera_m[k, i] = p
                projected_px[k, i] = wp.cw_mul(view.focal_px, wp.vec2d(p[0], p[1])) / p[2] + view.center_px
            for t in range(first_triangle[body], first_triangle[body + 1]):
                corner = triangles[t]
                a = in_camera_m[k, corner[0]]
                b = in_camera_m[k, corner[1]]
                c = in_camera_m[k, corner[2]]
                pa = projected_px[k, corner[0]]
                pb = projected_px[k, corner[1]]
                pc = projected_px[k, corner[2]]
                rows = rows_of(a, b, c, pa, pb, pc, height, width)
                if rows[0] <= rows[1]:
                    draw(t, a, b, c, rows, view, inverse_depth[k], nearest[k])


@wp.kernel
def resolve(
    vertices_m: wp.array(dtype=wp.vec3d),
    triangles: wp.array(dtype=wp.vec3i),
    body_of_triangle: wp.array(dtype=wp.int32),
    no_body: int,
    inverse_depth: wp.array(dtype=wp.float64),
    nearest: wp.array(dtype=wp.int32),
    # output
    depth_m: wp.array(dtype=wp.float32),
    normal: wp.array(dtype=wp.vec3),
    body_index: wp.array(dtype=wp.int32),
):
    """One thread per pixel: depth, normal and body of its nearest triangle."""
    pixel = wp.tid()
    t = nearest[pixel]
    if t < 0:
        depth_m[pixel] = wp.inf
        normal[pixel] = wp.vec3(0.0, 0.0, 0.0)
        body_index[pixel] = no_body
        return
    corner = triangles[t]
    a = vertices_m[corner[0]]
    depth_m[pixel] = wp.float32(wp.float64(1.0) / inverse_depth[pixel])
    normal[pixel] = wp.vec3(wp.cross(vertices_m[corner[1]] - a, vertices_m[corner[2]] - a))
    body_index[pixel] = body_of_triangle[t]
