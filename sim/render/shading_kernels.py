"""Shading of ray hits as a Warp kernel: seeded solid textures, a sun, haze and a cloudy sky.

Texture is a function of the point in the frame of its body, so it moves with the body, needs no images and is the
same in both cameras. Octaves of noise fade out before they become finer than the footprint of a pixel, which avoids
aliasing.
"""

# mypy: disable-error-code="no-untyped-def,type-arg,valid-type,untyped-decorator,no-any-return,index,misc"
from typing import Any

import warp as wp

from ..bodies import Weather

wp.set_module_options({"enable_backward": False})

FACADE = wp.constant(1)
GROUND = wp.constant(2)
GRASS = wp.constant(3)
FOLIAGE = wp.constant(4)
BARK = wp.constant(5)
SNOW = wp.constant(6)
PATTERNS = {"plain": 0, "facade": 1, "ground": 2, "grass": 3, "foliage": 4, "bark": 5, "snow": 6}

FLOOR_M = wp.constant(3.2)
WINDOW_M = wp.constant(1.7)

STEP_X = wp.constant(wp.uint32(0x1DA6B343))
STEP_Y = wp.constant(wp.uint32(0x58163841))
STEP_Z = wp.constant(wp.uint32(0x4B1AB31F))
STEP_SEED = wp.constant(wp.uint32(0x27D4EB2F))


@wp.struct
class ShadedBody:
    """Pose and surface of a body."""

    rotation: wp.mat33
    position: wp.vec3
    albedo: wp.float32
    texture: wp.float32
    pattern: wp.int32
    seed: wp.int32


@wp.struct
class Atmosphere:
    """The weather as the kernel reads it."""

    sun: wp.vec3
    ambient: wp.float32
    haze_m: wp.float32
    sky: wp.float32
    clouds: wp.float32
    exposure: wp.float32
    seed: wp.int32


def atmosphere(weather: Weather, seed: int) -> Any:
    """The weather for the kernel. The seed decides where the clouds are."""
    result = Atmosphere()
    result.sun = wp.vec3(*weather.to_sun)
    result.ambient, result.haze_m, result.sky = weather.ambient, weather.haze_m, weather.sky
    result.clouds, result.exposure, result.seed = weather.clouds, weather.exposure, seed
    return result


@wp.func
def hash_to_unit(key: wp.uint32):
    """A pseudo-random number in 0..1 from a key."""
    h = (key ^ (key >> wp.uint32(15))) * wp.uint32(0x2C1B3C6D)
    h = (h ^ (h >> wp.uint32(13))) * wp.uint32(0x297A2D39)
    return wp.float32(h >> wp.uint32(16)) * (1.0 / 65535.0)


@wp.func
def lattice_hash(x: wp.int32, y: wp.int32, z: wp.int32, seed: wp.int32):
    """A pseudo-random number in 0..1 from a lattice point and a seed."""
    return hash_to_unit(
        wp.uint32(x) * STEP_X ^ wp.uint32(y) * STEP_Y ^ wp.uint32(z) * STEP_Z ^ wp.uint32(seed) * STEP_SEED
    )


@wp.func
def smoothstep(t: wp.float32):
    """Cubic interpolation from 0..1 to 0..1 with zero slope at both ends."""
    return t * t * (3.0 - 2.0 * t)


@wp.func
def value_noise(p: wp.vec3, seed: wp.int32):
    """Value noise in 0..1 on a lattice of unit size."""
    fx = wp.floor(p[0])
    fy = wp.floor(p[1])
    fz = wp.floor(p[2])
    x0 = wp.uint32(wp.int32(fx)) * STEP_X ^ wp.uint32(seed) * STEP_SEED
    y0 = wp.uint32(wp.int32(fy)) * STEP_Y
    z0 = wp.uint32(wp.int32(fz)) * STEP_Z
    x1 = (wp.uint32(wp.int32(fx)) + wp.uint32(1)) * STEP_X ^ wp.uint32(seed) * STEP_SEED
    y1 = y0 + STEP_Y
    z1 = z0 + STEP_Z
    tx = smoothstep(p[0] - fx)
    ty = smoothstep(p[1] - fy)
    tz = smoothstep(p[2] - fz)
    near = wp.lerp(
        wp.lerp(hash_to_unit(x0 ^ y0 ^ z0), hash_to_unit(x1 ^ y0 ^ z0), tx),
        wp.lerp(hash_to_unit(x0 ^ y1 ^ z0), hash_to_unit(x1 ^ y1 ^ z0), tx),
        ty,
    )
    far = wp.lerp(
        wp.lerp(hash_to_unit(x0 ^ y0 ^ z1), hash_to_unit(x1 ^ y0 ^ z1), tx),
        wp.lerp(hash_to_unit(x0 ^ y1 ^ z1), hash_to_unit(x1 ^ y1 ^ z1), tx),
        ty,
    )
    return wp.lerp(near, far, tz)


@wp.func
def fractal_noise(p: wp.vec3, footprint_m: wp.float32, octaves: wp.int32, seed: wp.int32):
    """Octaves of value noise about 0, from 2 m down to the last octave or to the footprint of the pixel."""
    total = float(0.0)
    size = float(2.0)
    weight = float(0.46)
    octave = int(0)
    while octave < octaves and size > 2.0 * footprint_m:
        fade = wp.clamp(size / (2.0 * footprint_m) - 1.0, 0.0, 1.0)
        total += fade * weight * (value_noise(p * (1.0 / size), seed + octave) - 0.5)
        size *= 0.45
        weight *= 0.93
        octave += 1
    return total


@wp.func
def scaled_noise(scale: wp.float32, p: wp.vec3, footprint_m: wp.float32, octaves: wp.int32, seed: wp.int32):
    """Fractal noise that is finer by a factor."""
    return fractal_noise(p * scale, footprint_m * scale, octaves, seed)


@wp.func
def facade(p: wp.vec3, normal: wp.vec3, footprint_m: wp.float32, seed: wp.int32):
    """Dark window panes, each with its own brightness; 0 on the wall between them."""
    if wp.abs(normal[2]) > 0.5:
        return 0.0
    along = p[0]
    if wp.abs(normal[0]) > wp.abs(normal[1]):
        along = p[1]
    column = wp.floor(along / WINDOW_M)
    floor = wp.floor(p[2] / FLOOR_M)
    in_column = along / WINDOW_M - column
    in_floor = p[2] / FLOOR_M - floor
    if in_column < 0.22 or in_column > 0.78 or in_floor < 0.30 or in_floor > 0.80:
        return 0.0
    pane = lattice_hash(wp.int32(column), wp.int32(floor), wp.int32(3.0 * normal[0] + 7.0 * normal[1]), seed)
    fade = wp.clamp(0.35 * WINDOW_M / footprint_m - 0.5, 0.0, 1.0)
    return fade * (0.5 * pane - 0.42)


@wp.func
def grass(p: wp.vec3, footprint_m: wp.float32, seed: wp.int32):
    """Tufts of grass with bare patches."""
    patches = 0.6 * scaled_noise(0.6, p, footprint_m, 4, seed + 31)
    return 0.9 * scaled_noise(12.0, p, footprint_m, 3, seed) + patches


@wp.func
def foliage(p: wp.vec3, footprint_m: wp.float32, seed: wp.int32):
    """Bright leaves and dark gaps between them."""
    clumps = 0.6 * (value_noise(p * 1.4, seed + 31) - 0.5)
    return wp.clamp(1.7 * scaled_noise(7.0, p, footprint_m, 4, seed) + clumps, -0.42, 0.55)


@wp.func
def pattern_detail(pattern: wp.int32, p: wp.vec3, normal: wp.vec3, footprint_m: wp.float32, seed: wp.int32):
    """Relative deviation of the brightness of a surface from its mean, by its pattern."""
    if pattern == FACADE:
        return 0.55 * fractal_noise(p, footprint_m, 7, seed) + facade(p, normal, footprint_m, seed)
    if pattern == GROUND:
        return 0.55 * fractal_noise(p, footprint_m, 7, seed) + 0.35 * scaled_noise(0.12, p, footprint_m, 3, seed + 17)
    if pattern == GRASS:
        return grass(p, footprint_m, seed)
    if pattern == FOLIAGE:
        return foliage(p, footprint_m, seed)
    if pattern == BARK:
        return fractal_noise(wp.vec3(p[0] * 3.0, p[1] * 3.0, p[2] * 0.6), footprint_m * 3.0, 6, seed)
    if pattern == SNOW:
        return 0.4 * scaled_noise(0.25, p, footprint_m, 3, seed) + 0.06 * fractal_noise(p, footprint_m, 5, seed + 31)
    return 0.8 * fractal_noise(p, footprint_m, 7, seed)


@wp.func
def sky(direction: wp.vec3, footprint: wp.float32, air: Atmosphere):
    """Brightness of the sky, which is brighter at the horizon, with clouds at infinity."""
    d = wp.normalize(direction)
    p = wp.vec3(d[0] / (d[2] + 0.35), d[1] / (d[2] + 0.35), 0.0) * 6.0
    clouds = air.clouds * fractal_noise(p, footprint * 18.0, 6, air.seed)
    return air.sky + 0.05 - 0.25 * wp.max(d[2], 0.0) + clouds * wp.clamp(3.0 * d[2] + 0.3, 0.0, 1.0)


@wp.kernel
def shade(
    focal_px: wp.float32,
    air: Atmosphere,
    bodies: wp.array(dtype=ShadedBody),
    rays: wp.array2d(dtype=wp.float32),
    depth_m: wp.array(dtype=wp.float32),
    normals: wp.array(dtype=wp.vec3),
    body_index: wp.array(dtype=wp.int32),
    sunlit: wp.array(dtype=wp.float32),
    # output
    gray: wp.array(dtype=wp.uint8),
):
    """Brightness of the surface that each ray hits, or of the sky where the depth is infinite.

    Rays are (origin, direction) with a direction of unit depth, so the ray parameter is the depth. `sunlit` is 0 in a
    shadow and 1 elsewhere. Surfaces that face down receive less ambient light.
    """
    i = wp.tid()
    origin = wp.vec3(rays[i, 0], rays[i, 1], rays[i, 2])
    direction = wp.vec3(rays[i, 3], rays[i, 4], rays[i, 5])
    t = depth_m[i]
    if not wp.isfinite(t):
        gray[i] = wp.uint8(wp.clamp(sky(direction, 1.0 / focal_px, air), 0.0, 1.0) * 255.0)
        return
    body = bodies[body_index[i]]
    normal = wp.normalize(normals[i])
    facing = wp.abs(wp.dot(normal, wp.normalize(direction)))
    footprint_m = t / focal_px / wp.sqrt(wp.max(facing, 0.05))
    to_body = wp.transpose(body.rotation)
    p = to_body * (origin + t * direction - body.position)
    detail = float(0.0)
    if body.texture > 0.0:
        detail = pattern_detail(body.pattern, p, to_body * normal, footprint_m, body.seed)
    overhead = 0.8 + 0.2 * normal[2]
    lit = air.ambient * overhead + (1.0 - air.ambient) * sunlit[i] * wp.max(0.0, wp.dot(normal, air.sun))
    surface = wp.clamp(air.exposure * body.albedo * lit * (1.0 + 2.0 * body.texture * detail), 0.0, 1.0)
    clear = wp.exp(-t / air.haze_m)
    gray[i] = wp.uint8(wp.clamp(clear * surface + (1.0 - clear) * air.sky, 0.0, 1.0) * 255.0)
