"""Each loop of shading gives the numbers of its NumPy twin."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.render import shading_kernels as kernels
from voxdepth.compiled import compile_all

SEEDS = st.integers(0, 2**31)
HEIGHT, WIDTH = 6, 9
SIZE = HEIGHT * WIDTH
PINHOLE_PX = np.array([7.0, 8.0, 4.2, 2.7], np.float32)
N_TRIANGLES, N_BODIES = 5, 3
BODY_OF_TRIANGLE = np.array([0, 0, 1, 2, 2, 3], np.int32)
"""The last triangle and the last body stand for the sky."""
IDS = np.array([7, 3, 11, -1], np.int32)
PATTERN = np.array([kernels.PATTERNS.index(name) for name in ("facade", "foliage", "bark", "sky")], np.int32)
SURFACE = np.array([[0.6, 2.0], [0.5, 0.0], [0.9, 1.0], [0.0, 1.0]], np.float32)
SEED = np.array([3, 1 << 29, 17, 99], np.uint32)
IMAGES = {
    "one triangle": np.zeros(SIZE, np.int32),
    "sky": np.full(SIZE, N_TRIANGLES, np.int32),
    "checkered": np.arange(SIZE, dtype=np.int32) % (N_TRIANGLES + 1),
}


@pytest.fixture(autouse=True, scope="module")
def _compiled() -> None:
    compile_all()


def lens(rotation: np.ndarray) -> kernels.Lens:
    return kernels.Lens(WIDTH, *PINHOLE_PX, np.ascontiguousarray(rotation, np.float32))


def looks(**changes: np.ndarray) -> kernels.Looks:
    nothing = np.zeros((N_TRIANGLES, 3), np.float32), np.zeros((N_TRIANGLES, 2), np.float32)
    return kernels.Looks(*nothing, BODY_OF_TRIANGLE, PATTERN, SEED, SURFACE)._replace(**changes)


def image_of_triangles(seed: int) -> np.ndarray:
    """Patches of triangles; the seeds below 3 give the degenerate images."""
    if seed < len(IMAGES):
        return list(IMAGES.values())[seed]
    rng = np.random.default_rng(seed)
    patches = rng.integers(0, N_TRIANGLES + 1, (HEIGHT, WIDTH // 3)).astype(np.int32)
    return np.repeat(patches, 3, axis=1).reshape(-1)


def spans_of(triangle: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    spans = np.empty((SIZE, 4), np.int32)
    places, segment_id = np.empty(len(IDS) + 1, np.int32), np.empty(SIZE, np.int32)
    n = kernels.find_spans(triangle, WIDTH, BODY_OF_TRIANGLE, IDS, spans, places, segment_id)
    return spans[:n], places, segment_id


def place_of_pixel(spans: np.ndarray) -> np.ndarray:
    place = np.full(SIZE, -1)
    for first, size, _, at in spans:
        place[first : first + size] = np.arange(at, at + size)
    return place


def random_pose(rng: np.random.Generator) -> np.ndarray:
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return np.column_stack([q * np.linalg.det(q), rng.uniform(-5, 5, 3)]).astype(np.float32)


def rays() -> np.ndarray:
    """Directions of unit depth, shape (SIZE, 3)."""
    row, col = np.divmod(np.arange(SIZE), WIDTH)
    fx, fy, cx, cy = PINHOLE_PX.astype(np.float64)
    return np.stack([(col - cx) / fx, (row - cy) / fy, np.ones(SIZE)], axis=1)


def unit_normals(rng: np.random.Generator) -> np.ndarray:
    normals = rng.normal(size=(N_TRIANGLES, 3))
    return (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)


@given(SEEDS)
def test_spans_cover_the_image_and_their_points_are_sorted_by_body(seed: int) -> None:
    triangle = image_of_triangles(seed)
    spans, places, segment_id = spans_of(triangle)
    rows = triangle.reshape(HEIGHT, WIDTH)
    begins = np.column_stack([np.ones(HEIGHT, np.bool_), rows[:, 1:] != rows[:, :-1]]).ravel()
    first = np.flatnonzero(begins)
    np.testing.assert_array_equal(spans[:, 0], first)
    np.testing.assert_array_equal(spans[:, 1], np.diff([*first, SIZE]))
    np.testing.assert_array_equal(spans[:, 2], triangle[first])
    body = BODY_OF_TRIANGLE[triangle]
    np.testing.assert_array_equal(place_of_pixel(spans)[np.argsort(body, kind="stable")], np.arange(SIZE))
    np.testing.assert_array_equal(places[:-1], [(body < k).sum() for k in range(len(IDS))])
    np.testing.assert_array_equal(segment_id, IDS[body])


@given(SEEDS)
def test_points_in_the_frames_of_their_bodies(seed: int) -> None:
    rng = np.random.default_rng(seed)
    triangle, depth_m, normals = image_of_triangles(seed), rng.uniform(0.3, 90, SIZE), unit_normals(rng)
    poses = np.stack([random_pose(rng) for _ in range(N_BODIES)])
    spans, _, _ = spans_of(triangle)
    points = np.full((4, SIZE), 5, np.float32)
    kernels.locate(spans, depth_m.astype(np.float32), lens(np.eye(3)), looks(normals=normals), poses, points)
    place = place_of_pixel(spans)
    for pixel, direction in enumerate(rays()):
        if triangle[pixel] == N_TRIANGLES:
            assert (points[:, place[pixel]] == 5).all()
            continue
        pose, normal = poses[BODY_OF_TRIANGLE[triangle[pixel]]].astype(np.float64), normals[triangle[pixel]]
        expected = pose[:, :3] @ (direction * depth_m[pixel]) + pose[:, 3]
        np.testing.assert_allclose(points[:3, place[pixel]], expected, atol=1e-4)
        facing = abs(normal @ pose[:, :3] @ direction) / np.linalg.norm(direction)
        sharpness = PINHOLE_PX[0] / depth_m[pixel] * np.sqrt(max(facing, 0.05))
        np.testing.assert_allclose(points[3, place[pixel]], sharpness, rtol=1e-4)


@given(SEEDS)
def test_clouds_are_a_plane_above_the_horizon(seed: int) -> None:
    rng = np.random.default_rng(seed)
    triangle, rotation = image_of_triangles(seed), random_pose(rng)[:, :3]
    spans, _, _ = spans_of(triangle)
    points = np.full((4, SIZE), 5, np.float32)
    kernels.locate_clouds(spans, lens(rotation), looks(), points)
    at = place_of_pixel(spans)[triangle == N_TRIANGLES]
    d = (rays() @ rotation.T.astype(np.float64))[triangle == N_TRIANGLES]
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    expected = 6 * d[:, :2] / (np.maximum(d[:, 2:], -0.1) + 0.35)
    np.testing.assert_allclose(points[:2, at].T, expected, atol=1e-4)
    assert (points[2, at] == 0).all()
    np.testing.assert_allclose(points[3, at], PINHOLE_PX[0] / 18, rtol=1e-6)
    assert (points[:, np.setdiff1d(np.arange(SIZE), at)] == 5).all()


def hashed(key: np.ndarray) -> np.ndarray:
    h = ((key ^ (key >> 15)) * 0x2C1B3C6D) & 0xFFFFFFFF
    h = ((h ^ (h >> 13)) * 0x297A2D39) & 0xFFFFFFFF
    return np.asarray((h >> 16) / 65535)


def lattice(x: np.ndarray, y: np.ndarray, z: np.ndarray, seed: int) -> np.ndarray:
    """A pseudo-random number in 0..1 for each lattice point."""
    steps = 0x1DA6B343, 0x58163841, 0x4B1AB31F
    key = np.full(np.shape(x), seed * 0x27D4EB2F & 0xFFFFFFFF)
    for coordinate, step in zip((x, y, z), steps, strict=True):
        key ^= np.asarray(coordinate, np.int64) * step & 0xFFFFFFFF
    return hashed(key)


def value_noise(p: np.ndarray, seed: int) -> np.ndarray:
    """Value noise of points, shape (3, n)."""
    base = np.floor(p)
    t = p - base
    t = t * t * (3 - 2 * t)
    total = np.zeros(p.shape[1])
    for corner in np.ndindex(2, 2, 2):
        weight = np.prod([t[k] if corner[k] else 1 - t[k] for k in range(3)], axis=0)
        total += weight * lattice(*(base[k] + corner[k] for k in range(3)), seed)
    return total


@pytest.mark.parametrize("n", [0, 1, 7, 16, 100])
@given(SEEDS, st.floats(0.1, 9), st.floats(0.1, 9), st.sampled_from([0.02, 0.3, 2.0, np.inf]))
def test_an_octave_of_noise(n: int, seed: int, across: float, along: float, reach_m: float) -> None:
    rng = np.random.default_rng(seed)
    points = rng.uniform(-30, 30, (3, n)).astype(np.float32)
    points[:, : n // 3] = np.rint(points[:, : n // 3])  # on the lattice
    sharpness = rng.uniform(0.1, 9, n).astype(np.float32)
    detail = rng.uniform(-1, 1, n).astype(np.float32)
    frequency = np.array([across, across, along], np.float32)
    p = (points * frequency[:, None]).astype(np.float64)
    fade = np.clip(reach_m * sharpness - 1, 0, 1)
    expected = detail + fade * 0.4 * (value_noise(p, seed) - 0.5)
    numbers = (np.float32(x) for x in (across, along, reach_m, 0.4))
    kernels.add_octave(*points, sharpness, *numbers, np.uint32(seed), detail)
    np.testing.assert_allclose(detail, expected, atol=1e-4)


@pytest.mark.parametrize("pattern", range(len(kernels.PATTERNS)))
@given(SEEDS)
def test_patterns_are_sums_of_octaves_within_limits(pattern: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    n, before = 40, 6
    points = rng.uniform(-9, 9, (4, n)).astype(np.float32)
    points[3] = rng.uniform(0.5, 400, n)
    expected = np.zeros(n)
    for across, along, footprint, octaves, shift, strength in kernels.NOISE[pattern].astype(np.float64):
        size_m, weight = 2.0, 0.46
        for octave in range(int(octaves)):
            scale = np.array([[across], [across], [along]]) / size_m
            reach = np.inf if footprint == 0 else size_m / (2 * footprint)
            fade = np.clip(reach * points[3] - 1, 0, 1)
            noise = value_noise((points[:3] * scale.astype(np.float32)).astype(np.float64), seed + int(shift) + octave)
            expected += strength * weight * fade * (noise - 0.5)
            size_m, weight = size_m * 0.45, weight * 0.93
    detail = np.zeros(n, np.float32)
    places = np.array([0, before, n], np.int32)
    own = looks(
        pattern=np.full(2, pattern, np.int32),
        seed=np.full(2, seed, np.uint32),
        surface=np.array([[0.5, 0.0], [0.5, 1.0]], np.float32),
    )
    kernels.add_textures(points, places, own, detail)
    assert (detail[:before] == 0).all(), "the first body has no contrast"
    expected = np.clip(expected, *kernels.LIMITS[pattern])
    np.testing.assert_allclose(detail[before:], expected[before:], atol=2e-3)


@given(SEEDS)
def test_windows_of_facades(seed: int) -> None:
    rng = np.random.default_rng(seed)
    triangle, points = image_of_triangles(seed), rng.uniform(-30, 30, (4, SIZE)).astype(np.float32)
    points[3] = rng.uniform(0.1, 9, SIZE)
    normals = np.eye(3, dtype=np.float32)[rng.integers(3, size=N_TRIANGLES)] * rng.choice([-1, 1])
    normals = np.ascontiguousarray(normals, np.float32)
    spans, _, _ = spans_of(triangle)
    detail = np.full(SIZE, 5, np.float32)
    kernels.draw_windows(spans, points, looks(normals=normals), detail)
    for pixel, at in enumerate(place_of_pixel(spans)):
        body = BODY_OF_TRIANGLE[triangle[pixel]]
        normal = normals[triangle[pixel]] if body < N_BODIES else np.zeros(3)
        if PATTERN[body] != kernels.FACADE or abs(normal[2]) > 0.5:
            assert detail[at] == 5
            continue
        across = points[1 if abs(normal[0]) > abs(normal[1]) else 0, at] / np.float32(1.7)
        up = points[2, at] / np.float32(3.2)
        side = int(3 * normal[0] + 7 * normal[1])
        pane = lattice(*(np.array([k]) for k in (np.floor(across), np.floor(up), side)), int(SEED[body]))[0]
        is_glass = 0.22 <= across % 1 <= 0.78 and 0.3 <= up % 1 <= 0.8
        fade = np.clip(0.35 * 1.7 * points[3, at] - 0.5, 0, 1)
        np.testing.assert_allclose(detail[at], fade * (0.5 * pane - 0.42) if is_glass else 0, atol=1e-5)


def test_transmittance_is_an_exponential() -> None:
    depths = np.array([0, 1e-6, 0.01, 0.3, 1, 2.5, 7, 19.9, 20, 500, np.inf], np.float32)
    shares = [kernels.transmittance(np.float32(depth)) for depth in depths]
    np.testing.assert_allclose(shares, np.exp(-depths.astype(np.float64)), rtol=1e-3, atol=1e-5)


@given(SEEDS, st.floats(0.5, 1e6))
def test_brightness_of_surfaces(seed: int, haze_m: float) -> None:
    rng = np.random.default_rng(seed)
    triangle, depth_m = image_of_triangles(seed), rng.uniform(0.3, 90, SIZE).astype(np.float32)
    detail, lit = rng.uniform(-2, 2, SIZE).astype(np.float32), rng.integers(0, 2, SIZE).astype(np.float32)
    light = rng.uniform(0, 1, (N_TRIANGLES, 2)).astype(np.float32)
    spans, _, _ = spans_of(triangle)
    gray = np.full(SIZE, 5, np.uint8)
    air = kernels.Air(np.float32(haze_m), np.float32(0.7), np.float32(0))
    kernels.shade(spans, depth_m, detail, lit, looks(light=light), air, gray)
    light = np.vstack([light, [0, 0]])
    brightness, contrast = SURFACE[BODY_OF_TRIANGLE[triangle]].T
    own = (light[triangle, 0] + light[triangle, 1] * lit) * brightness * (1 + contrast * detail[place_of_pixel(spans)])
    clear = np.exp(-depth_m / haze_m)
    expected = 255 * np.clip(clear * np.clip(own, 0, 1) + (1 - clear) * 0.7, 0, 1)
    seen = triangle != N_TRIANGLES
    assert (np.abs(gray - np.floor(expected)) <= (np.abs(expected - np.rint(expected)) < 0.01))[seen].all()
    assert (gray[~seen] == 5).all()


@given(SEEDS)
def test_brightness_of_the_sky(seed: int) -> None:
    rng = np.random.default_rng(seed)
    triangle, rotation = image_of_triangles(seed), random_pose(rng)[:, :3]
    detail = rng.uniform(-2, 2, SIZE).astype(np.float32)
    spans, _, _ = spans_of(triangle)
    gray = np.full(SIZE, 5, np.uint8)
    air = kernels.Air(np.float32(100), np.float32(0.8), np.float32(0.22))
    kernels.shade_sky(spans, detail, lens(rotation), looks(), air, gray)
    d = rays() @ rotation.T.astype(np.float64)
    up = d[:, 2] / np.linalg.norm(d, axis=1)
    clouds = 0.22 * detail[place_of_pixel(spans)] * np.clip(3 * up + 0.3, 0, 1)
    expected = 255 * np.clip(0.85 - 0.25 * np.maximum(up, 0) + clouds, 0, 1)
    seen = triangle == N_TRIANGLES
    assert (np.abs(gray - np.floor(expected)) <= (np.abs(expected - np.rint(expected)) < 0.01))[seen].all()
    assert (gray[~seen] == 5).all()
