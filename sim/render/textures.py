"""Seeded solid textures, windows and clouds, as functions of the point in the frame of its body.

A texture moves with the body, needs no images and is the same in both cameras. Octaves of noise fade out before they
become finer than the footprint of a pixel, which avoids aliasing. The points of a body lie behind each other in the
buffers, so the loops over octaves of noise run over many pixels at a time.

The buffers have a column for each of the P pixels of an image. `points`, shape (4, P), has the coordinates (x, y, z) of
its surface in the frame of the body [m], and the sharpness, which is the inverse of the pixel's footprint there [1/m].
`detail`, shape (P,), has the deviation of its brightness from the mean of the body, as a share of the mean.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import float32, int32, int64, uint32, void

from voxdepth.compiled import compiled, compiled_part, named_tuple
from voxdepth.types import FloatImage

from ..types import IdImage

Spans = npt.NDArray[np.int32]
"""The parts of the rows of an image that show one triangle: first pixel, number of pixels, triangle, and offset of the
first pixel in the buffers, shape (n, 4)."""


class Materials(NamedTuple):
    """Surfaces of triangles and bodies. Those after the last triangle and the last body are the sky."""

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


FLOATS, INDICES, TABLE = float32[::1], int32[::1], float32[:, ::1]
SPANS = int32[:, ::1]
MATERIALS = named_tuple(Materials, TABLE, TABLE, INDICES, INDICES, uint32[::1], TABLE)

FRACTALS: dict[str, list[tuple[float, ...]]] = {
    "plain": [(1, 1, 1, 7, 0, 0.8)],
    "facade": [(1, 1, 1, 7, 0, 0.55)],
    "ground": [(1, 1, 1, 7, 0, 0.55), (0.12, 0.12, 0.12, 3, 17, 0.35)],
    "grass": [(12, 12, 12, 3, 0, 0.9), (0.6, 0.6, 0.6, 4, 31, 0.6)],
    "foliage": [(7, 7, 7, 4, 0, 1.7), (2.8, 2.8, 0, 1, 31, 0.6 / 0.46)],
    "bark": [(3, 0.6, 3, 6, 0, 1)],
    "snow": [(0.25, 0.25, 0.25, 3, 0, 0.4), (1, 1, 1, 5, 31, 0.06)],
    "sky": [(1, 1, 1, 6, 0, 1)],
}
"""One or two fractal noises of each pattern: factors of the coordinates across and along the axis z and of the
footprint of a pixel, number of octaves, a shift of the seed, and strength."""
PATTERNS = tuple(FRACTALS)
FACADE = PATTERNS.index("facade")
NOISE = np.zeros((len(PATTERNS), 2, 6), np.float32)
for _k, _noises in enumerate(FRACTALS.values()):
    NOISE[_k, : len(_noises)] = _noises
LIMITS = np.full((len(PATTERNS), 2), (-np.inf, np.inf), np.float32)
"""Least and largest deviation of a pattern; between leaves are dark gaps."""
LIMITS[PATTERNS.index("foliage")] = -0.42, 0.55

OCTAVE_M, FINER, WEAKER, STRENGTH = np.array([2.0, 0.45, 0.93, 0.46], np.float32)
"""Size of the first octave of noise, ratios of the sizes and the weights of successive ones, and the first weight."""
FLOOR_M, WINDOW_M = np.array([3.2, 1.7], np.float32)
PANE = np.array([0.22, 0.78, 0.30, 0.80], np.float32)
"""First and last column and row of the glass within a window, as shares of its size."""
PANE_FADE_M, DARKEST_PANE = np.array([0.35 * 1.7, 0.42], np.float32)
CHUNK_PX = 1024
"""Points whose octaves of noise are summed at once; they fit into the fastest memory."""

ZERO, HALF, ONE, TWO, THREE, SEVEN = np.array([0, 0.5, 1, 2, 3, 7], np.float32)
STEP_X, STEP_Y, STEP_Z, STEP_SEED = np.array([0x1DA6B343, 0x58163841, 0x4B1AB31F, 0x27D4EB2F], np.uint32)
MIX_1, MIX_2 = np.array([0x2C1B3C6D, 0x297A2D39], np.uint32)
SHIFT_1, SHIFT_2, SHIFT_3 = np.array([15, 13, 16], np.uint32)
TO_UNIT = np.float32(1 / 65535)


@compiled_part(float32(uint32))
def hash_to_unit(key: np.uint32) -> np.float32:
    """Return a pseudo-random number in 0..1 from a key."""
    h = np.uint32((key ^ (key >> SHIFT_1)) * MIX_1)
    h = np.uint32((h ^ (h >> SHIFT_2)) * MIX_2)
    return np.float32(np.int32(h >> SHIFT_3)) * TO_UNIT


@compiled_part(float32(float32))
def smoothstep(t: np.float32) -> np.float32:
    """Return the cubic interpolation from 0..1 to 0..1 with zero slope at both ends."""
    return np.float32(t * t * (THREE - TWO * t))


@compiled_part(float32(float32, float32, float32))
def lerp(a: np.float32, b: np.float32, t: np.float32) -> np.float32:
    """Return the linear interpolation from a to b."""
    return np.float32(a * (ONE - t) + b * t)


@compiled(float32(float32, float32, float32))
def clamp(x: np.float32, low: np.float32, high: np.float32) -> np.float32:
    """Return the nearest number between two limits."""
    return min(max(x, low), high)


@compiled_part(uint32(float32, uint32))
def lattice_key(floor: np.float32, step: np.uint32) -> np.uint32:
    """Return the contribution of one coordinate of a lattice point to its key."""
    return np.uint32(np.uint32(np.int32(floor)) * step)


@compiled(void(SPANS, TABLE, MATERIALS, FLOATS))
def draw_windows(
    spans: Spans,
    points: FloatImage,
    materials: Materials,
    # output
    detail: FloatImage,
) -> None:
    """Draw dark window panes on the sides of facades, each with its own brightness; the rest keeps its value.

    Args:
        spans: The spans of the image, shape (n, 4).
        points: See the module, shape (4, P).
        materials: Those of all triangles and bodies.
        detail: See the module, shape (P,); changed in place.
    """
    for i in range(len(spans)):
        size, triangle, at = spans[i, 1], spans[i, 2], np.uint64(spans[i, 3])
        body = materials.body_of_triangle[triangle]
        if materials.pattern[body] != FACADE or abs(materials.normals[triangle, 2]) > HALF:
            continue
        n = materials.normals[triangle]
        along = 1 if abs(n[0]) > abs(n[1]) else 0
        side_key = lattice_key(np.trunc(THREE * n[0] + SEVEN * n[1]), STEP_Z) ^ np.uint32(
            materials.seed[body] * STEP_SEED
        )
        for k in range(size):
            u, v = points[along, at + np.uint64(k)] / WINDOW_M, points[2, at + np.uint64(k)] / FLOOR_M
            column, floor = np.floor(u), np.floor(v)
            in_column, in_floor = u - column, v - floor
            is_pane = (in_column >= PANE[0]) & (in_column <= PANE[1]) & (in_floor >= PANE[2]) & (in_floor <= PANE[3])
            key = np.uint32(lattice_key(column, STEP_X) ^ lattice_key(floor, STEP_Y) ^ side_key)
            fade = clamp(PANE_FADE_M * points[3, at + np.uint64(k)] - HALF, ZERO, ONE)
            shade = fade * (HALF * hash_to_unit(key) - DARKEST_PANE)
            detail[at + np.uint64(k)] = shade if is_pane else ZERO


@compiled_part(void(FLOATS, FLOATS, FLOATS, FLOATS, *[float32] * 4, uint32, FLOATS))
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
    """Add value noise about 0 on a lattice.

    It fades out where the footprint of a pixel, the inverse of the sharpness, grows from a half of `reach_m` to all of
    it.

    Args:
        x_m: Coordinate x of successive points, shape (n,).
        y_m: Their y, shape (n,).
        z_m: Their z, shape (n,).
        sharpness: Inverse of the footprint of a pixel there [1/m], shape (n,).
        across: Lattice points per metre along the axes x and y.
        along: Lattice points per metre along the axis z.
        reach_m: Footprint of a pixel at which the noise is gone.
        weight: Difference between the largest and the smallest value.
        seed: Its number; each octave has another one.
        detail: Of these points, shape (n,); the noise is added in place.
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


@compiled_part(void(TABLE, int64, int64, int32, uint32, FLOATS))
def add_pattern(
    points: FloatImage,
    first: int,
    end: int,
    pattern: int,
    seed: np.uint32,
    # output
    detail: FloatImage,
) -> None:
    """Add the noise of a pattern to successive points, down to octaves of the smallest footprint of a pixel.

    Args:
        points: See the module, shape (4, P).
        first: Column of the first point.
        end: Column after the last one.
        pattern: Index into `PATTERNS`.
        seed: That of the body.
        detail: See the module, shape (P,); changed in place from `first` to `end`.
    """
    x_m, y_m, z_m, sharpness = points[0, first:end], points[1, first:end], points[2, first:end], points[3, first:end]
    sharpest = ZERO
    for i in range(len(sharpness)):
        sharpest = max(sharpest, sharpness[i])
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


@compiled(void(TABLE, INDICES, MATERIALS, FLOATS))
def add_textures(
    points: FloatImage,
    offset_of_body: IdImage,
    materials: Materials,
    # output
    detail: FloatImage,
) -> None:
    """Add the relative deviation of the brightness of each point from the mean of its textured body.

    Args:
        points: See the module, shape (4, P).
        offset_of_body: Offset of each body and of the sky, and the number of all, shape (B + 2,).
        materials: Those of all bodies and of the sky.
        detail: See the module, shape (P,); changed in place.
    """
    for body in range(len(materials.pattern)):
        pattern, seed = materials.pattern[body], materials.seed[body]
        low, high = LIMITS[pattern, 0], LIMITS[pattern, 1]
        end_of_body = offset_of_body[body + 1] if materials.surface[body, 1] > 0 else offset_of_body[body]
        for first in range(offset_of_body[body], end_of_body, CHUNK_PX):
            end = min(first + CHUNK_PX, end_of_body)
            add_pattern(points, first, end, pattern, seed, detail)
            own = detail[first:end]
            for i in range(len(own)):
                own[i] = clamp(own[i], low, high)
