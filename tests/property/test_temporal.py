"""Laws of the default method on random inputs."""

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.temporal_scenes import CAMERA, depth_of, fuse, pose
from voxdepth.temporal.fusion import FILLING_WEIGHT_PER_FRAME, MAX_WEIGHT, RELIABLE_WEIGHT, PixelClass
from voxdepth.temporal.measurement import Measurement
from voxdepth.temporal.memory import WEIGHT_UNIT, Memory
from voxdepth.temporal.pose_fit import fit_pose, project
from voxdepth.temporal.working_resolution import WorkingResolution
from voxdepth.types import FloatImage, Intrinsics

seeds = st.integers(0, 10_000)
angle = st.floats(-6, 6)
length = st.floats(-0.25, 0.25)
fills = st.sampled_from(["none", "likely", "all"])
RESOLUTION = WorkingResolution.of(CAMERA, 1)


def patches(rng: np.random.Generator, shape: tuple[int, int], holes: float) -> FloatImage:
    """Disparity of a few rectangles [px], noisy, with holes."""
    disparity_px = np.full(shape, rng.uniform(1, 20))
    for _ in range(4):
        top, left = rng.integers(0, shape[0]), rng.integers(0, shape[1])
        disparity_px[top : top + 12, left : left + 15] = rng.uniform(1, 40)
    disparity_px += rng.normal(0, 0.3, shape)
    return np.where(rng.random(shape) < holes, 0, np.maximum(disparity_px, 0.2)).astype(np.float32)


@given(seeds, st.floats(0.05, 2), st.floats(20, 900), st.sampled_from([1, 2]))
def test_depth_survives_the_way_through_disparity(
    seed: int, baseline_m: float, focal_px: float, decimation: int
) -> None:
    camera = replace(CAMERA, baseline_m=baseline_m, fx_px=focal_px, fy_px=focal_px)
    resolution, rng = WorkingResolution.of(camera, decimation), np.random.default_rng(seed)
    depth_m = rng.uniform(resolution.focal_baseline_px_m / 900, 200, CAMERA.shape).astype(np.float32)
    depth_m[rng.random(depth_m.shape) < 0.2] = 0
    np.testing.assert_allclose(depth_of(resolution, resolution.disparity(depth_m)), depth_m, rtol=1e-6)


@given(seeds, st.floats(0, 0.9), st.floats(0, 0.9))
@settings(max_examples=20)
def test_every_pixel_is_one_kind_of_thing(seed: int, holes: float, forgotten: float) -> None:
    rng, shape = np.random.default_rng(seed), (48, 64)
    old_px, new_px = patches(rng, shape, forgotten), patches(rng, shape, holes)
    new_px = np.where(rng.random(shape) < 0.5, new_px, old_px + (new_px > 0) * rng.normal(0, 0.3, shape))
    new_px = np.where(rng.random(shape) < holes, 0, np.maximum(new_px, 0)).astype(np.float32)
    weight = np.where(old_px > 0, rng.integers(1, MAX_WEIGHT + 1, shape), 0).astype(np.uint8)
    old_gray, new_gray = (rng.integers(60, 140, shape, np.uint8) for _ in range(2))
    age = rng.integers(1, 256, shape, np.uint8)
    memory = Memory.empty(old_gray)._replace(disparity_px=old_px, weight=weight, age=age)
    valid = new_px > 0
    new_weight = np.where(new_px > 0, rng.integers(1, WEIGHT_UNIT + 1, shape), 0).astype(np.uint8)
    new = Measurement(disparity_px=new_px, weight=new_weight, gray=new_gray)
    fused, after = fuse(memory, new)
    kind, shown_px = fused.pixel_class, fused.disparity_px
    np.testing.assert_array_equal(kind == PixelClass.UNMEASURED, shown_px == 0)
    assert (kind <= max(PixelClass)).all()
    np.testing.assert_array_equal(shown_px[kind == PixelClass.MEASURED], new_px[kind == PixelClass.MEASURED])
    np.testing.assert_array_equal(shown_px[kind == PixelClass.REMEMBERED], old_px[kind == PixelClass.REMEMBERED])
    assert (weight[kind == PixelClass.REMEMBERED] >= RELIABLE_WEIGHT).all()
    averaged = kind == PixelClass.FUSED
    assert (shown_px[averaged] >= np.minimum(old_px, new_px)[averaged] - 1e-4).all()
    assert (shown_px[averaged] <= np.maximum(old_px, new_px)[averaged] + 1e-4).all()
    assert (kind[valid] != PixelClass.UNMEASURED).all()
    np.testing.assert_array_equal(kind[~valid], PixelClass.UNMEASURED)
    np.testing.assert_array_equal(fused.remembered_px[valid], 0)
    remembered = fused.remembered_px > 0
    np.testing.assert_array_equal(fused.remembered_px[remembered], old_px[remembered])
    assert (weight >= np.minimum(np.rint(FILLING_WEIGHT_PER_FRAME * age), RELIABLE_WEIGHT))[remembered].all()
    assert (after.age > 0).all()
    assert after.weight.max() <= MAX_WEIGHT
    np.testing.assert_array_equal(after.weight > 0, after.disparity_px > 0)


@given(seeds, angle, angle, length, length, length)
def test_a_third_of_wrong_points_does_not_move_the_camera(
    seed: int, yaw: float, pitch: float, x: float, y: float, z: float
) -> None:
    rng = np.random.default_rng(seed)
    camera = Intrinsics(fx_px=200, fy_px=200, cx_px=160, cy_px=90, width_px=320, height_px=180)
    T, points_m = pose(x, y, z, yaw=yaw / 2, pitch=pitch / 2), rng.uniform([-2, -1.5, 2], [2, 1.5, 8], (90, 3))
    right_px = project(points_m @ T[:3, :3].T + T[:3, 3], camera)
    seen_px = right_px.copy()
    seen_px[:30] += rng.uniform(20, 60, (30, 2)) * rng.choice([-1, 1], (30, 2))
    fit = fit_pose(points_m, seen_px, camera, np.eye(4), 1.0)
    found_px = project(points_m @ fit.T_target_source[:3, :3].T + fit.T_target_source[:3, 3], camera)
    assert np.hypot(*(found_px - right_px).T).mean() < 0.05
    assert fit.n_inliers == 60
