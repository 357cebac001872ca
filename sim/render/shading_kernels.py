"""Shading as compiled loops: seeded solid textures, a sun, haze and a cloudy sky.

Texture is a function of the point in the frame of its body, so it moves with the body, needs no images and is the
same in both cameras. Octaves of noise fade out before they become finer than the footprint of a pixel, which avoids
aliasing.

An image is shaded in spans, the parts of its rows that show one triangle. The points of all spans of a body lie behind
each other in the buffers, so the loops over octaves of noise run over many pixels at a time. Indices are unsigned where
compilers could not exclude that a negative one counts from the end, which would keep them from vectorising the loop.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import float32, int32, int64, uint8, uint32, void

from voxdepth.compiled import compiled, named_tuple
from voxdepth.types import FloatImage, GrayImage

from ..types import IdImage

Spans = npt.NDArray[np.int32]
"""First pixel, number of pixels, triangle, and place of the first pixel in the buffers, shape (n, 4)."""


class Lens(NamedTuple):
    """Projection and attitude of a camera."""

    width: int
    fx_px: np.float32
    fy_px: np.float32
    cx_px: np.float32
    cy_px: np.float32
    R_world_cam: FloatImage


class Looks(NamedTuple):
    """What decides how triangles and bodies look. Those after the last triangle and the last body are the sky."""

    normals: FloatImage
    """Unit vectors in the frames of the bodies, shape (T, 3)."""
    light: FloatImage
    """Light on each triangle from the sky and from the sun, shape (T, 2)."""
    body_of_triangle: IdImage
    """Shape (T + 1,)."""
    pattern: IdImage
    """Index into `PATTERNS`, shape (B + 1,)."""
    seed: npt.NDArray[np.uint32]
    """Shape (B + 1,)."""
    surface: FloatImage
    """Mean brightness and contrast, shape (B + 1, 2)."""


class Air(NamedTuple):
    """Distance at which haze hides 63 % of the light of a surface, brightness of the sky, and contrast of clouds."""

    haze_m: np.float32
    sky: np.float32
    clouds: np.float32


FLOATS, INDICES, TABLE = float32[::1], int32[::1], float32[:, ::1]
SPANS = int32[:, ::1]
LENS = named_tuple(Lens, int64, *[float32] * 4, TABLE)
LOOKS = named_tuple(Looks, TABLE, TABLE, INDICES, INDICES, uint32[::1], TABLE)
AIR = named_tuple(Air, *[float32] * 3)

PATTERNS = ("plain", "facade", "ground", "grass", "foliage", "bark", "snow", "sky")
FACADE = PATTERNS.index("facade")

NOISE = np.zeros((len(PATTERNS), 2, 6), np.float32)
"""Two fractal noises of each pattern: factors of the coordinates across and along the axis z and of the footprint of a
pixel, number of octaves, a shift of the seed, and strength."""
NOISE[PATTERNS.index("plain"), 0] = 1, 1, 1, 7, 0, 0.8
NOISE[PATTERNS.index("facade"), 0] = 1, 1, 1, 7, 0, 0.55
NOISE[PATTERNS.index("ground")] = (1, 1, 1, 7, 0, 0.55), (0.12, 0.12, 0.12, 3, 17, 0.35)
NOISE[PATTERNS.index("grass")] = (12, 12, 12, 3, 0, 0.9), (0.6, 0.6, 0.6, 4, 31, 0.6)
NOISE[PATTERNS.index("foliage")] = (7, 7, 7, 4, 0, 1.7), (2.8, 2.8, 0, 1, 31, 0.6 / 0.46)
NOISE[PATTERNS.index("bark"), 0] = 3, 0.6, 3, 6, 0, 1
NOISE[PATTERNS.index("snow")] = (0.25, 0.25, 0.25, 3, 0, 0.4), (1, 1, 1, 5, 31, 0.06)
NOISE[PATTERNS.index("sky"), 0] = 1, 1, 1, 6, 0, 1
LIMITS = np.full((len(PATTERNS), 2), (-np.inf, np.inf), np.float32)
"""Least and largest deviation of a pattern; between leaves are dark gaps."""
LIMITS[PATTERNS.index("foliage")] = -0.42, 0.55

OCTAVE_M, FINER, WEAKER, STRENGTH = np.array([2.0, 0.45, 0.93, 0.46], np.float32)
"""Size of the first octave of noise, ratios of the sizes and the weights of successive ones, and the first weight."""
FLOOR_M, WINDOW_M = np.array([3.2, 1.7], np.float32)
LEAST_FACING = np.float32(0.05)
"""Least cosine between a ray and the normal of a surface in the footprint of its pixel."""
HORIZON = np.float32(0.35)
"""Height above which the clouds are a plane, as a share of its distance."""
LOWEST_CLOUD, CLOUD_BASE, CLOUDS_M = np.array([-0.1, 0.3, 6.0], np.float32)
"""Height of a ray below which it meets no cloud, share of the clouds at the horizon, and height of their plane."""
BRIGHTER, DARKER_ABOVE = np.array([0.05, 0.25], np.float32)
PANE = np.array([0.22, 0.78, 0.30, 0.80], np.float32)
"""First and last column and row of the glass within a window, as shares of its size."""
PANE_FADE_M, DARKEST_PANE = np.array([0.35 * 1.7, 0.42], np.float32)
CHUNK_PX = 1024
"""Points whose octaves of noise are summed at once; they fit into the fastest memory."""
OPAQUE = np.float32(20)
"""Optical depth through which nothing is seen."""

ZERO, HALF, ONE, TWO, THREE, FOUR, SEVEN = np.array([0, 0.5, 1, 2, 3, 4, 7], np.float32)
SIXTY_FOUR, WHITE = np.array([64, 255], np.float32)
STEP_X, STEP_Y, STEP_Z, STEP_SEED = np.array([0x1DA6B343, 0x58163841, 0x4B1AB31F, 0x27D4EB2F], np.uint32)
MIX_1, MIX_2 = np.array([0x2C1B3C6D, 0x297A2D39], np.uint32)
SHIFT_1, SHIFT_2, SHIFT_3 = np.array([15, 13, 16], np.uint32)
TO_UNIT = np.float32(1 / 65535)


@compiled(float32(uint32))
def hash_to_unit(key: np.uint32) -> np.float32:
    """A pseudo-random number in 0..1 from a key."""
    h = np.uint32((key ^ (key >> SHIFT_1)) * MIX_1)
    h = np.uint32((h ^ (h >> SHIFT_2)) * MIX_2)
    return np.float32(np.int32(h >> SHIFT_3)) * TO_UNIT


@compiled(float32(float32))
def smoothstep(t: np.float32) -> np.float32:
    """Cubic interpolation from 0..1 to 0..1 with zero slope at both ends."""
    return np.float32(t * t * (THREE - TWO * t))


@compiled(float32(float32, float32, float32))
def lerp(a: np.float32, b: np.float32, t: np.float32) -> np.float32:
    """Linear interpolation from a to b."""
    return np.float32(a * (ONE - t) + b * t)


@compiled(float32(float32, float32, float32))
def clamp(x: np.float32, low: np.float32, high: np.float32) -> np.float32:
    """The nearest number between two limits."""
    return min(max(x, low), high)


@compiled(uint32(float32, uint32))
def lattice_key(floor: np.float32, step: np.uint32) -> np.uint32:
    """Contribution of one coordinate of a lattice point to its key."""
    return np.uint32(np.uint32(np.int32(floor)) * step)


@compiled(int64(INDICES, int64, INDICES, INDICES, SPANS, INDICES, INDICES))
def find_spans(
    triangle: IdImage,
    width: int,
    body_of_triangle: IdImage,
    id_of_body: IdImage,
    # output
    spans: Spans,
    place_of_body: IdImage,
    segment_id: IdImage,
) -> int:
    """Divide an image of triangle indices into spans, whose number it returns, and name the body of each pixel.

    The points of body b have the places from `place_of_body[b]` to `place_of_body[b + 1]`.
    """
    place_of_body[:] = 0
    count = first = 0
    while first < len(triangle):
        end, last = first + 1, first - first % width + width
        while end < last and triangle[end] == triangle[first]:
            end += 1
        body = body_of_triangle[triangle[first]]
        segment_id[first:end] = id_of_body[body]
        spans[count, 0], spans[count, 1], spans[count, 2] = first, end - first, triangle[first]
        place_of_body[body + 2] += end - first
        count, first = count + 1, end
    for body in range(2, len(place_of_body)):
        place_of_body[body] += place_of_body[body - 1]
    for i in range(count):
        body = body_of_triangle[spans[i, 2]]
        spans[i, 3] = place_of_body[body + 1]
        place_of_body[body + 1] += spans[i, 1]
    return count


@compiled(void(SPANS, FLOATS, LENS, LOOKS, float32[:, :, ::1], TABLE))
def locate(
    spans: Spans,
    depth_m: FloatImage,
    lens: Lens,
    looks: Looks,
    T_body_cam: FloatImage,
    # output
    points: FloatImage,
) -> None:
    """Points (x, y, z) [m] in the frames of their bodies, and the sharpness, the inverse of a pixel's size there [1/m].

    `T_body_cam` has the pose of the camera in the frame of each body.
    """
    width, fx, fy, cx, cy, _ = lens
    for i in range(len(spans)):
        first, size, triangle, place = spans[i, 0], spans[i, 1], spans[i, 2], spans[i, 3]
        if triangle == len(looks.normals):
            continue
        col, y = first % width, (np.float32(first // width) - cy) / fy
        T, n = T_body_cam[looks.body_of_triangle[triangle]], looks.normals[triangle]
        x0, y0, z0 = T[0, 3], T[1, 3], T[2, 3]
        right_x, right_y, right_z = T[0, 0], T[1, 0], T[2, 0]
        ahead_x, ahead_y, ahead_z = T[0, 1] * y + T[0, 2], T[1, 1] * y + T[1, 2], T[2, 1] * y + T[2, 2]
        pixel, at = np.uint64(first), np.uint64(place)
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


@compiled(void(SPANS, LENS, LOOKS, TABLE))
def locate_clouds(
    spans: Spans,
    lens: Lens,
    looks: Looks,
    # output
    points: FloatImage,
) -> None:
    """Places of the pixels without a surface on a plane of clouds, and their sharpness, as `locate` gives them."""
    width, fx, fy, cx, cy, R = lens
    for i in range(len(spans)):
        first, size, triangle, place = spans[i, 0], spans[i, 1], spans[i, 2], spans[i, 3]
        if triangle < len(looks.normals):
            continue
        col, y, at = first % width, (np.float32(first // width) - cy) / fy, np.uint64(place)
        for k in range(size):
            x = (np.float32(col + k) - cx) / fx
            length = np.sqrt(x * x + y * y + ONE)
            up = max((R[2, 0] * x + R[2, 1] * y + R[2, 2]) / length, LOWEST_CLOUD)
            scale = CLOUDS_M / (length * (up + HORIZON))
            points[0, at + np.uint64(k)] = (R[0, 0] * x + R[0, 1] * y + R[0, 2]) * scale
            points[1, at + np.uint64(k)] = (R[1, 0] * x + R[1, 1] * y + R[1, 2]) * scale
            points[2, at + np.uint64(k)] = ZERO
        for k in range(size):
            points[3, at + np.uint64(k)] = fx / (THREE * CLOUDS_M)


@compiled(void(SPANS, TABLE, LOOKS, FLOATS))
def draw_windows(
    spans: Spans,
    points: FloatImage,
    looks: Looks,
    # output
    detail: FloatImage,
) -> None:
    """Dark window panes on the sides of facades, each with its own brightness; the rest keeps its value."""
    for i in range(len(spans)):
        size, triangle, at = spans[i, 1], spans[i, 2], np.uint64(spans[i, 3])
        body = looks.body_of_triangle[triangle]
        if looks.pattern[body] != FACADE or abs(looks.normals[triangle, 2]) > HALF:
            continue
        n = looks.normals[triangle]
        along = 1 if abs(n[0]) > abs(n[1]) else 0
        side_key = lattice_key(np.trunc(THREE * n[0] + SEVEN * n[1]), STEP_Z) ^ np.uint32(looks.seed[body] * STEP_SEED)
        for k in range(size):
            u, v = points[along, at + np.uint64(k)] / WINDOW_M, points[2, at + np.uint64(k)] / FLOOR_M
            column, floor = np.floor(u), np.floor(v)
            in_column, in_floor = u - column, v - floor
            is_pane = (in_column >= PANE[0]) & (in_column <= PANE[1]) & (in_floor >= PANE[2]) & (in_floor <= PANE[3])
            key = np.uint32(lattice_key(column, STEP_X) ^ lattice_key(floor, STEP_Y) ^ side_key)
            fade = clamp(PANE_FADE_M * points[3, at + np.uint64(k)] - HALF, ZERO, ONE)
            shade = fade * (HALF * hash_to_unit(key) - DARKEST_PANE)
            detail[at + np.uint64(k)] = shade if is_pane else ZERO


@compiled(void(FLOATS, FLOATS, FLOATS, FLOATS, *[float32] * 4, uint32, FLOATS))
def add_octave(
    x_m: FloatImage,
    y_m: FloatImage,
    z_m: FloatImage,
    sharpness: FloatImage,
    across: np.float32,
    along: np.float32,
    reach_m: np.float32,
    weight: np.float32,
    seed: np.uint32,
    # output
    detail: FloatImage,
) -> None:
    """Add value noise about 0 on a lattice with frequencies `across` and `along` the axis z [1/m].

    It fades out where the footprint of a pixel, the inverse of the sharpness, grows from a half of `reach_m` to all of
    it.
    """
    seed_key = np.uint32(seed * STEP_SEED)
    for i in range(len(detail)):
        x, y, z = x_m[i] * across, y_m[i] * across, z_m[i] * along
        fx, fy, fz = np.floor(x), np.floor(y), np.floor(z)
        tx, ty, tz = smoothstep(x - fx), smoothstep(y - fy), smoothstep(z - fz)
        x_key, y0, z0 = lattice_key(fx, STEP_X), lattice_key(fy, STEP_Y), lattice_key(fz, STEP_Z)
        x0, x1 = np.uint32(x_key ^ seed_key), np.uint32(np.uint32(x_key + STEP_X) ^ seed_key)
        y1, z1 = np.uint32(y0 + STEP_Y), np.uint32(z0 + STEP_Z)
        low_near = lerp(hash_to_unit(np.uint32(x0 ^ y0 ^ z0)), hash_to_unit(np.uint32(x1 ^ y0 ^ z0)), tx)
        low_far = lerp(hash_to_unit(np.uint32(x0 ^ y1 ^ z0)), hash_to_unit(np.uint32(x1 ^ y1 ^ z0)), tx)
        high_near = lerp(hash_to_unit(np.uint32(x0 ^ y0 ^ z1)), hash_to_unit(np.uint32(x1 ^ y0 ^ z1)), tx)
        high_far = lerp(hash_to_unit(np.uint32(x0 ^ y1 ^ z1)), hash_to_unit(np.uint32(x1 ^ y1 ^ z1)), tx)
        noise = lerp(lerp(low_near, low_far, ty), lerp(high_near, high_far, ty), tz)
        fade = clamp(reach_m * sharpness[i] - ONE, ZERO, ONE)
        detail[i] += fade * weight * (noise - HALF)


@compiled(void(TABLE, int64, int64, int32, uint32, FLOATS))
def add_pattern(
    points: FloatImage,
    first: int,
    end: int,
    pattern: int,
    seed: np.uint32,
    # output
    detail: FloatImage,
) -> None:
    """Add the noise of a pattern to successive points, down to octaves of the smallest footprint of a pixel."""
    x_m, y_m, z_m, sharpness = points[0, first:end], points[1, first:end], points[2, first:end], points[3, first:end]
    sharpest = sharpness.max()
    for k in range(2):
        size_m, weight = OCTAVE_M, STRENGTH * NOISE[pattern, k, 5]
        for octave in range(int(NOISE[pattern, k, 3])):
            reach_m = HALF * size_m / NOISE[pattern, k, 2]
            if reach_m * sharpest <= ONE:
                break
            across, along = NOISE[pattern, k, 0] / size_m, NOISE[pattern, k, 1] / size_m
            key = np.uint32(seed + np.uint32(NOISE[pattern, k, 4]) + octave)
            add_octave(x_m, y_m, z_m, sharpness, across, along, reach_m, weight, key, detail[first:end])
            size_m *= FINER
            weight *= WEAKER


@compiled(void(TABLE, INDICES, LOOKS, FLOATS))
def add_textures(
    points: FloatImage,
    place_of_body: IdImage,
    looks: Looks,
    # output
    detail: FloatImage,
) -> None:
    """Add the relative deviation of the brightness of each point from the mean of its textured body."""
    for body in range(len(looks.pattern)):
        pattern, seed = looks.pattern[body], looks.seed[body]
        low, high = LIMITS[pattern, 0], LIMITS[pattern, 1]
        end_of_body = place_of_body[body + 1] if looks.surface[body, 1] > 0 else place_of_body[body]
        for first in range(place_of_body[body], end_of_body, CHUNK_PX):
            end = min(first + CHUNK_PX, end_of_body)
            add_pattern(points, first, end, pattern, seed, detail)
            own = detail[first:end]
            for i in range(len(own)):
                own[i] = clamp(own[i], low, high)


@compiled(float32(float32))
def transmittance(optical_depth: np.float32) -> np.float32:
    """`exp(-x)` of x >= 0, in a form that compilers vectorise: `exp(-x / 64)` by its series, and six squarings."""
    x = min(optical_depth, OPAQUE) / SIXTY_FOUR
    share = ONE - x * (ONE - x / TWO * (ONE - x / THREE * (ONE - x / FOUR)))
    for _ in range(6):
        share *= share
    return np.float32(share)


@compiled(void(SPANS, FLOATS, FLOATS, FLOATS, LOOKS, AIR, uint8[::1]))
def shade(
    spans: Spans,
    depth_m: FloatImage,
    detail: FloatImage,
    sunlit: FloatImage,
    looks: Looks,
    air: Air,
    # output
    gray: GrayImage,
) -> None:
    """Brightness of surfaces behind haze; `sunlit` is 0 in a shadow and 1 elsewhere."""
    for i in range(len(spans)):
        size, triangle, pixel, at = spans[i, 1], spans[i, 2], np.uint64(spans[i, 0]), np.uint64(spans[i, 3])
        if triangle == len(looks.normals):
            continue
        body = looks.body_of_triangle[triangle]
        brightness, contrast = looks.surface[body, 0], looks.surface[body, 1]
        from_sky, from_sun = looks.light[triangle, 0] * brightness, looks.light[triangle, 1] * brightness
        for k in range(size):
            lit = from_sky + from_sun * sunlit[pixel + np.uint64(k)]
            own = clamp(lit * (ONE + contrast * detail[at + np.uint64(k)]), ZERO, ONE)
            clear = transmittance(depth_m[pixel + np.uint64(k)] / air.haze_m)
            seen = clear * own + (ONE - clear) * air.sky
            gray[pixel + np.uint64(k)] = np.uint8(np.int32(clamp(seen, ZERO, ONE) * WHITE))


@compiled(void(SPANS, FLOATS, LENS, LOOKS, AIR, uint8[::1]))
def shade_sky(
    spans: Spans,
    detail: FloatImage,
    lens: Lens,
    looks: Looks,
    air: Air,
    # output
    gray: GrayImage,
) -> None:
    """Brightness of the sky, which is brighter at the horizon, with clouds at infinity."""
    width, fx, fy, cx, cy, R = lens
    for i in range(len(spans)):
        first, size, triangle = spans[i, 0], spans[i, 1], spans[i, 2]
        if triangle < len(looks.normals):
            continue
        col, y = first % width, (np.float32(first // width) - cy) / fy
        pixel, at = np.uint64(first), np.uint64(spans[i, 3])
        for k in range(size):
            x = (np.float32(col + k) - cx) / fx
            up = (R[2, 0] * x + R[2, 1] * y + R[2, 2]) / np.sqrt(x * x + y * y + ONE)
            cloud = air.clouds * detail[at + np.uint64(k)] * clamp(THREE * up + CLOUD_BASE, ZERO, ONE)
            seen = air.sky + BRIGHTER - DARKER_ABOVE * max(up, ZERO) + cloud
            gray[pixel + np.uint64(k)] = np.uint8(np.int32(clamp(seen, ZERO, ONE) * WHITE))
