"""Shading of ray hits as a Warp kernel: seeded solid textures, a low sun, haze and a cloudy sky.

Texture is a function of the point in the frame of its body, so it moves with the body, needs no images and is the
same in both cameras. Octaves fade out before they fall below the footprint of a pixel: what is left is what a camera
of that resolution could see.
"""

# mypy: disable-error-code="no-untyped-def,type-arg,valid-type,untyped-decorator,no-any-return,index,misc"
import warp as wp

wp.set_module_options({"enable_backward": False})

PLAIN = wp.constant(0)
FACADE = wp.constant(1)
GROUND = wp.constant(2)
PATTERNS = {"plain": 0, "facade": 1, "ground": 2}

FLOOR_M = wp.constant(3.2)
WINDOW_M = wp.constant(1.7)
HAZE_M = wp.constant(260.0)
AMBIENT = wp.constant(0.55)
EXPOSURE = wp.constant(1.25)
HORIZON = wp.constant(0.80)


@wp.struct
class BodyLook:
    """How a body is placed and looks."""

    rotation: wp.mat33
    position: wp.vec3
    albedo: wp.float32
    texture: wp.float32
    pattern: wp.int32
    seed: wp.int32


@wp.func
def hashed(x: wp.int32, y: wp.int32, z: wp.int32, seed: wp.int32):
    """A number in 0..1 that depends on a lattice point and a seed only."""
    h = wp.uint32(x) * wp.uint32(0x1DA6B343) ^ wp.uint32(y) * wp.uint32(0x58163841)
    h = h ^ wp.uint32(z) * wp.uint32(0x4B1AB31F) ^ wp.uint32(seed) * wp.uint32(0x27D4EB2F)
    h = (h ^ (h >> wp.uint32(15))) * wp.uint32(0x2C1B3C6D)
    h = (h ^ (h >> wp.uint32(12))) * wp.uint32(0x297A2D39)
    h = h ^ (h >> wp.uint32(15))
    return wp.float32(h & wp.uint32(0xFFFF)) / 65535.0


@wp.func
def value_noise(p: wp.vec3, seed: wp.int32):
    """Smooth noise in 0..1 with features of unit size."""
    fx = wp.floor(p[0])
    fy = wp.floor(p[1])
    fz = wp.floor(p[2])
    x = wp.int32(fx)
    y = wp.int32(fy)
    z = wp.int32(fz)
    tx = wp.smoothstep(0.0, 1.0, p[0] - fx)
    ty = wp.smoothstep(0.0, 1.0, p[1] - fy)
    tz = wp.smoothstep(0.0, 1.0, p[2] - fz)
    near = wp.lerp(
        wp.lerp(hashed(x, y, z, seed), hashed(x + 1, y, z, seed), tx),
        wp.lerp(hashed(x, y + 1, z, seed), hashed(x + 1, y + 1, z, seed), tx),
        ty,
    )
    far = wp.lerp(
        wp.lerp(hashed(x, y, z + 1, seed), hashed(x + 1, y, z + 1, seed), tx),
        wp.lerp(hashed(x, y + 1, z + 1, seed), hashed(x + 1, y + 1, z + 1, seed), tx),
        ty,
    )
    return wp.lerp(near, far, tz)


@wp.func
def grain(p: wp.vec3, footprint_m: wp.float32, seed: wp.int32):
    """Octaves of noise about 0, from 2 m down to the footprint of the pixel."""
    total = float(0.0)
    size = float(2.0)
    weight = float(0.46)
    octave = int(0)
    while octave < 7 and size > 2.0 * footprint_m:
        fade = wp.clamp(size / (2.0 * footprint_m) - 1.0, 0.0, 1.0)
        total += fade * weight * (value_noise(p * (1.0 / size), seed + octave) - 0.5)
        size *= 0.45
        weight *= 0.93
        octave += 1
    return total


@wp.func
def facade(p: wp.vec3, normal: wp.vec3, footprint_m: wp.float32, seed: wp.int32):
    """Windows in a wall: darker panes, each with its own reflection. 0 where there is wall."""
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
    pane = hashed(wp.int32(column), wp.int32(floor), wp.int32(3.0 * normal[0] + 7.0 * normal[1]), seed)
    fade = wp.clamp(0.35 * WINDOW_M / footprint_m - 0.5, 0.0, 1.0)
    return fade * (0.5 * pane - 0.42)


@wp.func
def sky(direction: wp.vec3, footprint: wp.float32, seed: wp.int32):
    """Brightness of the sky: lighter at the horizon, with clouds infinitely far away."""
    d = wp.normalize(direction)
    p = wp.vec3(d[0] / (d[2] + 0.35), d[1] / (d[2] + 0.35), 0.0) * 6.0
    clouds = grain(p, footprint * 6.0, seed)
    return HORIZON + 0.05 - 0.25 * wp.max(d[2], 0.0) + 0.22 * clouds * wp.clamp(3.0 * d[2] + 0.3, 0.0, 1.0)


@wp.kernel
def shade(
    rays: wp.array2d(dtype=wp.float32),
    focal_px: wp.float32,
    sun: wp.vec3,
    sky_seed: wp.int32,
    depth_m: wp.array(dtype=wp.float32),
    normals: wp.array(dtype=wp.vec3),
    body_index: wp.array(dtype=wp.int32),
    looks: wp.array(dtype=BodyLook),
    # output
    gray: wp.array(dtype=wp.uint8),
):
    """Brightness of each ray: of what it hit, or of the sky where the depth is infinite.

    Rays are (origin, direction) with a direction of unit depth, so the ray parameter is the depth.
    """
    i = wp.tid()
    origin = wp.vec3(rays[i, 0], rays[i, 1], rays[i, 2])
    direction = wp.vec3(rays[i, 3], rays[i, 4], rays[i, 5])
    t = depth_m[i]
    if not wp.isfinite(t):
        gray[i] = wp.uint8(wp.clamp(sky(direction, 1.0 / focal_px, sky_seed), 0.0, 1.0) * 255.0)
        return
    look = looks[body_index[i]]
    normal = wp.normalize(normals[i])
    facing = wp.abs(wp.dot(normal, wp.normalize(direction)))
    footprint_m = t / focal_px / wp.max(facing, 0.15)
    to_body = wp.transpose(look.rotation)
    p = to_body * (origin + t * direction - look.position)
    detail = grain(p, footprint_m, look.seed)
    if look.pattern == FACADE:
        detail = 0.55 * detail + facade(p, to_body * normal, footprint_m, look.seed)
    elif look.pattern == GROUND:
        detail = 0.55 * detail + 0.35 * grain(p * 0.12, footprint_m * 0.12, look.seed + 17)
    lit = AMBIENT + (1.0 - AMBIENT) * wp.max(0.0, wp.dot(normal, sun))
    surface = wp.clamp(EXPOSURE * look.albedo * lit * (1.0 + 2.0 * look.texture * detail), 0.0, 1.0)
    clear = wp.exp(-t / HAZE_M)
    gray[i] = wp.uint8(wp.clamp(clear * surface + (1.0 - clear) * HORIZON, 0.0, 1.0) * 255.0)
