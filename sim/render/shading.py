"""Brightness of the triangles that a camera sees, by their materials, the sun and the atmosphere.

An image is shaded in spans, the parts of its rows that show one triangle. In the compiled loops, indices are unsigned
where compilers could not exclude that a negative one counts from the end, which would keep them from vectorising.
"""

from typing import NamedTuple

import numpy as np
from numba import float32, int32, int64, uint8, void

from voxdepth.compiled import compiled, compiled_part, named_tuple
from voxdepth.types import FloatImage, GrayImage

from ..seeds import Purpose, stream
from ..types import Camera, IdImage
from ..world import World
from .meshes import SceneMeshes, normals
from .textures import FLOATS, INDICES, MATERIALS, ONE, PATTERNS, SPANS, TABLE, THREE, TWO, ZERO, Materials, Spans, clamp


class Projection(NamedTuple):
    """Projection and attitude of a camera."""

    width: int
    fx_px: np.float32
    fy_px: np.float32
    cx_px: np.float32
    cy_px: np.float32
    R_world_cam: FloatImage


class Atmosphere(NamedTuple):
    """Distance at which haze hides 63 % of the light of a surface, brightness of the sky, and contrast of clouds."""

    haze_m: np.float32
    sky: np.float32
    clouds: np.float32


PROJECTION = named_tuple(Projection, int64, *[float32] * 4, TABLE)
ATMOSPHERE = named_tuple(Atmosphere, *[float32] * 3)

LEAST_FACING = np.float32(0.05)
"""Least cosine between a ray and the normal of a surface in the footprint of its pixel."""
HORIZON = np.float32(0.35)
"""Height above which the clouds are a plane, as a share of its distance."""
LOWEST_CLOUD, CLOUD_BASE, CLOUDS_M = np.array([-0.1, 0.3, 6.0], np.float32)
"""Height of a ray below which it meets no cloud, share of the clouds at the horizon, and height of their plane."""
BRIGHTER, DARKER_ABOVE = np.array([0.05, 0.25], np.float32)
OPAQUE = np.float32(20)
"""Optical depth through which nothing is seen."""
FOUR, SIXTY_FOUR, WHITE = np.array([4, 64, 255], np.float32)


@compiled(void(SPANS, FLOATS, PROJECTION, MATERIALS, float32[:, :, ::1], TABLE))
def locate(
    spans: Spans,
    depth_m: FloatImage,
    projection: Projection,
    materials: Materials,
    T_body_cam: FloatImage,
    # output
    points: FloatImage,
) -> None:
    """Find each pixel's point in the frame of its body [m], and its sharpness, the inverse of its size there [1/m].

    Pixels without a surface see a plane of clouds.

    Args:
        spans: The spans of the image, shape (n, 4).
        depth_m: Depth of each pixel, shape (H * W,); unused where there is no surface.
        projection: The camera.
        materials: Those of all triangles and bodies.
        T_body_cam: Pose of the camera in the frame of each body, shape (B, 3, 4).
        points: Rows x, y, z and sharpness, a column per entry of the buffers, shape (4, H * W); written.
    """
    width, fx, fy, cx, cy, R = projection
    for i in range(len(spans)):
        first, size, triangle, offset = spans[i, 0], spans[i, 1], spans[i, 2], spans[i, 3]
        col, y = first % width, (np.float32(first // width) - cy) / fy
        pixel, at = np.uint64(first), np.uint64(offset)
        if triangle == len(materials.normals):
            for k in range(size):
                x = (np.float32(col + k) - cx) / fx
                length = np.sqrt(x * x + y * y + ONE)
                up = max((R[2, 0] * x + R[2, 1] * y + R[2, 2]) / length, LOWEST_CLOUD)
                scale = CLOUDS_M / (length * (up + HORIZON))
                points[0, at + np.uint64(k)] = (R[0, 0] * x + R[0, 1] * y + R[0, 2]) * scale
                points[1, at + np.uint64(k)] = (R[1, 0] * x + R[1, 1] * y + R[1, 2]) * scale
                points[2, at + np.uint64(k)] = ZERO
                points[3, at + np.uint64(k)] = fx / (THREE * CLOUDS_M)
            continue
        # The ray of a pixel is `x * right + ahead`, where only x changes along a row.
        T, n = T_body_cam[materials.body_of_triangle[triangle]], materials.normals[triangle]
        x0, y0, z0 = T[0, 3], T[1, 3], T[2, 3]
        right_x, right_y, right_z = T[0, 0], T[1, 0], T[2, 0]
        ahead_x, ahead_y, ahead_z = T[0, 1] * y + T[0, 2], T[1, 1] * y + T[1, 2], T[2, 1] * y + T[2, 2]
        for k in range(size):
            x, depth = (np.float32(col + k) - cx) / fx, depth_m[pixel + np.uint64(k)]
            points[0, at + np.uint64(k)] = x0 + depth * (right_x * x + ahead_x)
            points[1, at + np.uint64(k)] = y0 + depth * (right_y * x + ahead_y)
            points[2, at + np.uint64(k)] = z0 + depth * (right_z * x + ahead_z)
        n_right = n[0] * right_x + n[1] * right_y + n[2] * right_z
        n_ahead = n[0] * ahead_x + n[1] * ahead_y + n[2] * ahead_z
        for k in range(size):
            x, depth = (np.float32(col + k) - cx) / fx, depth_m[pixel + np.uint64(k)]
            facing = abs(n_right * x + n_ahead) / np.sqrt(x * x + y * y + ONE)
            points[3, at + np.uint64(k)] = fx / depth * np.sqrt(max(facing, LEAST_FACING))


@compiled_part(float32(float32))
def transmittance(optical_depth: np.float32) -> np.float32:
    """Return `exp(-x)` of x >= 0, in a form that compilers vectorise: `exp(-x / 64)` by its series, squared 6 times."""
    x = min(optical_depth, OPAQUE) / SIXTY_FOUR
    share = ONE - x * (ONE - x / TWO * (ONE - x / THREE * (ONE - x / FOUR)))
    for _ in range(6):
        share *= share
    return np.float32(share)


@compiled(void(SPANS, FLOATS, FLOATS, FLOATS, PROJECTION, MATERIALS, ATMOSPHERE, uint8[::1]))
def shade(
    spans: Spans,
    depth_m: FloatImage,
    detail: FloatImage,
    sunlit: FloatImage,
    projection: Projection,
    materials: Materials,
    atmosphere: Atmosphere,
    # output
    gray: GrayImage,
) -> None:
    """Find the brightness of surfaces behind haze.

    The sky is brighter at the horizon, with clouds at infinity.

    Args:
        spans: The spans of the image, shape (n, 4).
        depth_m: Depth of each pixel, shape (H * W,).
        detail: Deviation of the brightness by texture, windows or clouds, as the buffers have it, shape (H * W,).
        sunlit: 1 where the sun reaches a pixel's surface and 0 in a shadow, shape (H * W,).
        projection: The camera.
        materials: Those of all triangles and bodies, with light.
        atmosphere: Haze and sky.
        gray: Image of 8 bits, shape (H * W,); written.
    """
    width, fx, fy, cx, cy, R = projection
    for i in range(len(spans)):
        size, triangle, pixel, at = spans[i, 1], spans[i, 2], np.uint64(spans[i, 0]), np.uint64(spans[i, 3])
        if triangle == len(materials.normals):
            col, y = spans[i, 0] % width, (np.float32(spans[i, 0] // width) - cy) / fy
            for k in range(size):
                x = (np.float32(col + k) - cx) / fx
                up = (R[2, 0] * x + R[2, 1] * y + R[2, 2]) / np.sqrt(x * x + y * y + ONE)
                cloud = atmosphere.clouds * detail[at + np.uint64(k)] * clamp(THREE * up + CLOUD_BASE, ZERO, ONE)
                seen = atmosphere.sky + BRIGHTER - DARKER_ABOVE * max(up, ZERO) + cloud
                gray[pixel + np.uint64(k)] = np.uint8(np.int32(clamp(seen, ZERO, ONE) * WHITE))
            continue
        body = materials.body_of_triangle[triangle]
        brightness, contrast = materials.surface[body, 0], materials.surface[body, 1]
        from_sky, from_sun = materials.light[triangle, 0] * brightness, materials.light[triangle, 1] * brightness
        for k in range(size):
            lit = from_sky + from_sun * sunlit[pixel + np.uint64(k)]
            own = clamp(lit * (ONE + contrast * detail[at + np.uint64(k)]), ZERO, ONE)
            clear = transmittance(depth_m[pixel + np.uint64(k)] / atmosphere.haze_m)
            seen = clear * own + (ONE - clear) * atmosphere.sky
            gray[pixel + np.uint64(k)] = np.uint8(np.int32(clamp(seen, ZERO, ONE) * WHITE))


def spans_of(triangle: IdImage, body_of_triangle: IdImage) -> tuple[Spans, IdImage]:
    """Divide an image of triangle indices, shape (H, W), into spans.

    The second result has the offset of each body in the buffers, and the number of all pixels: body b has the
    columns from the entry b to the entry b + 1.
    """
    spans = np.empty((count_spans(triangle), 4), np.int32)
    offset_of_body = np.zeros(int(body_of_triangle[-1]) + 2, np.int32)
    find_spans(triangle, body_of_triangle, spans, offset_of_body)
    return spans, offset_of_body


@compiled(int64(int32[:, ::1]))
def count_spans(triangle: IdImage) -> int:
    """Return the number of the parts of rows that show one triangle."""
    height, width = triangle.shape
    n: int = height
    for row in range(height):
        for col in range(width - 1):
            n += triangle[row, col] != triangle[row, col + 1]
    return n


@compiled(void(int32[:, ::1], INDICES, SPANS, INDICES))
def find_spans(
    triangle: IdImage,
    body_of_triangle: IdImage,
    # output
    spans: Spans,
    offset_of_body: IdImage,
) -> None:
    """Find the spans in the order of the image, and their offsets in the buffers, where each body's are successive.

    Args:
        triangle: Index of the triangle of each pixel, shape (H, W); T is the sky.
        body_of_triangle: Index of its body, shape (T + 1,); B is the sky.
        spans: As `Spans`, shape (n, 4), with a row per span as `count_spans` counts them; written.
        offset_of_body: See `spans_of`, shape (B + 2,); zeros that are written.
    """
    height, width = triangle.shape
    n = 0
    for row in range(height):
        first = 0
        for col in range(width):
            if col + 1 == width or triangle[row, col] != triangle[row, col + 1]:
                spans[n, 0], spans[n, 1], spans[n, 2] = row * width + first, col + 1 - first, triangle[row, col]
                offset_of_body[body_of_triangle[triangle[row, col]] + 1] += col + 1 - first
                first = col + 1
                n += 1
    for body in range(1, len(offset_of_body)):
        offset_of_body[body] += offset_of_body[body - 1]
    next_offset = offset_of_body.copy()
    for i in range(n):
        body = body_of_triangle[spans[i, 2]]
        spans[i, 3] = next_offset[body]
        next_offset[body] += spans[i, 1]


def projection_of(camera: Camera) -> Projection:
    """Return a camera as the loops of shading read it."""
    i = camera.intrinsics
    fx, fy, cx, cy = (np.float32(x) for x in (i.fx_px, i.fy_px, i.cx_px, i.cy_px))
    return Projection(i.width_px, fx, fy, cx, cy, camera.T_world_cam[:3, :3].astype(np.float32))


def materials_of(world: World, meshes: SceneMeshes) -> Materials:
    """Return the materials of a world's bodies, in the order of their meshes, and of the sky; without light."""
    seed, weather, n = world.scene.seed, world.scene.weather, len(meshes.body_ids)
    surfaces = [world.surfaces[body] for body in meshes.body_ids]
    seeds = stream(seed, Purpose.SURFACE, 0).integers(1 << 30, size=n)
    cloud_seed = stream(seed, Purpose.SURFACE, 1).integers(1 << 30)
    patterns = [*(own.pattern for own in surfaces), "sky"]
    surface = [*((weather.exposure * own.albedo, 2 * own.texture) for own in surfaces), (0, 1)]
    return Materials(
        normals=np.concatenate([normals(mesh) for mesh in meshes.meshes]).astype(np.float32),
        light=np.empty((len(meshes.body_of_triangle), 2), np.float32),
        body_of_triangle=np.append(meshes.body_of_triangle, np.int32(n)),
        pattern=np.array([PATTERNS.index(pattern) for pattern in patterns], np.int32),
        seed=np.array([*seeds, cloud_seed], np.uint32),
        surface=np.array(surface, np.float32),
    )
