"""Holes whose surface was seen before: their laws, a slow reference, and cases worked out by hand."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from voxdepth.errors import FrameError
from voxdepth.geometry import inverse_rigid
from voxdepth.metrics import SeenBefore
from voxdepth.metrics.seen_before import FRAMES
from voxdepth.types import FloatArray, FloatImage, Intrinsics, MaskImage

CAMERA = Intrinsics.from_hfov(width_px=24, height_px=16, hfov_deg=80)
STRIP = Intrinsics(fx_px=10, fy_px=10, cx_px=0, cy_px=0, width_px=8, height_px=1)
NONE, EVERYWHERE = np.zeros(CAMERA.shape, bool), np.ones(CAMERA.shape, bool)
Images = tuple[MaskImage, FloatImage, FloatArray, FloatImage]


def at(x_m: float = 0.0, z_m: float = 0.0, yaw_rad: float = 0.0) -> FloatArray:
    T_world_cam = np.eye(4)
    T_world_cam[0, [0, 2]] = np.cos(yaw_rad), np.sin(yaw_rad)
    T_world_cam[2, [0, 2]] = -np.sin(yaw_rad), np.cos(yaw_rad)
    T_world_cam[[0, 2], 3] = x_m, z_m
    return T_world_cam


def wall(depth_m: float, intrinsics: Intrinsics = CAMERA) -> FloatImage:
    return np.full(intrinsics.shape, depth_m, np.float32)


def hilly(seed: int) -> list[Images]:
    """Frames of a camera that wanders before bumps, with random holes and wrong measurements."""
    rng = np.random.default_rng(seed)
    frames = []
    for _ in range(5):
        truth_m = rng.uniform(4.9, 5.2, CAMERA.shape).astype(np.float32)
        truth_m[rng.random(truth_m.shape) < 0.05] = np.inf
        known_m = np.where(np.isfinite(truth_m), truth_m, 1)
        raw_m = (known_m * rng.choice([0, 0.9, 1, 1.04], truth_m.shape)).astype(np.float32)
        pose = at(rng.uniform(-1, 1), rng.uniform(-0.2, 0.2), rng.uniform(-0.3, 0.3))
        frames.append((rng.random(truth_m.shape) < 0.4, truth_m, pose, raw_m))
    return frames


def seen_slowly(past: list[Images], now: Images, intrinsics: Intrinsics) -> MaskImage:
    """Slow reference: one pixel after the other, in double precision."""
    holes, truth_m, T_world_cam, _ = now
    fx, fy, cx, cy = intrinsics.fx_px, intrinsics.fy_px, intrinsics.cx_px, intrinsics.cy_px
    seen = np.zeros(intrinsics.shape, bool)
    for row, col in np.argwhere(holes & np.isfinite(truth_m)):
        z_m = float(truth_m[row, col])
        point = T_world_cam @ [(col - cx) / fx * z_m, (row - cy) / fy * z_m, z_m, 1]
        for _, past_m, pose, raw_m in past:
            x, y, z, _ = inverse_rigid(pose) @ point
            u, v = round(fx * x / z + cx), round(fy * y / z + cy)
            if z > 0 and 0 <= u < intrinsics.width_px and 0 <= v < intrinsics.height_px and np.isfinite(past_m[v, u]):
                there_m = float(past_m[v, u])
                right = raw_m[v, u] > 0 and abs(raw_m[v, u] - there_m) <= 0.05 * there_m
                seen[row, col] |= bool(right) and abs(z - there_m) <= 0.02 * there_m + 0.02
    return seen


@settings(max_examples=10)
@given(st.integers(0, 10_000))
def test_the_split_equals_a_slow_reference(seed: int) -> None:
    frames = hilly(seed)
    splitter = SeenBefore(CAMERA)
    for k, frame in enumerate(frames):
        seen, _ = splitter.split(*frame)
        np.testing.assert_array_equal(seen, seen_slowly(frames[:k], frame, CAMERA))
    assert 0 < seen.sum() < frame[0].sum()


@given(st.integers(0, 10_000))
def test_seen_and_never_share_out_the_holes_with_a_surface(seed: int) -> None:
    splitter = SeenBefore(CAMERA)
    for holes, truth_m, pose, raw_m in hilly(seed):
        seen, never = splitter.split(holes, truth_m, pose, raw_m)
        assert not (seen & never).any()
        np.testing.assert_array_equal(seen | never, holes & np.isfinite(truth_m))


@pytest.mark.parametrize(("raw_m", "was_seen"), [(5.24, True), (4.76, True), (5.3, False), (0.0, False)])
def test_a_surface_counts_as_seen_when_raw_was_within_5_percent(raw_m: float, was_seen: bool) -> None:
    splitter = SeenBefore(CAMERA)
    splitter.split(NONE, wall(5), at(), wall(raw_m))
    seen, never = splitter.split(EVERYWHERE, wall(5), at(), wall(0))
    assert seen.all() == was_seen
    assert never.all() != was_seen


@pytest.mark.parametrize(("depth_m", "same"), [(5.11, True), (5.13, False), (4.87, False)])
def test_a_surface_is_the_same_within_2_percent_and_2_cm(depth_m: float, same: bool) -> None:
    splitter = SeenBefore(CAMERA)
    splitter.split(NONE, wall(5), at(), wall(5))
    seen, _ = splitter.split(EVERYWHERE, wall(depth_m), at(), wall(0))
    assert (seen.all(), seen.any()) == (same, same)


@pytest.mark.parametrize(("frames_between", "remembered"), [(FRAMES - 1, True), (FRAMES, False)])
def test_only_the_last_n_frames_count(frames_between: int, remembered: bool) -> None:
    splitter = SeenBefore(CAMERA)
    splitter.split(NONE, wall(5), at(), wall(5))
    for _ in range(frames_between):
        splitter.split(NONE, wall(5), at(), wall(0))
    seen, _ = splitter.split(EVERYWHERE, wall(5), at(), wall(0))
    assert seen.all() == remembered


def test_images_are_neither_changed_nor_kept() -> None:
    splitter = SeenBefore(CAMERA)
    holes, truth_m, raw_m = NONE.copy(), wall(5), wall(5)
    splitter.split(holes, truth_m, at(), raw_m)
    for image, expected in ((holes, NONE), (truth_m, wall(5)), (raw_m, wall(5))):
        np.testing.assert_array_equal(image, expected)
    truth_m[:] = raw_m[:] = 9
    seen, _ = splitter.split(EVERYWHERE, wall(5), at(), wall(0))
    assert seen.all()


def test_images_of_another_camera_are_refused() -> None:
    with pytest.raises(FrameError, match=r"camera \(16, 24\), holes \(1, 8\)"):
        SeenBefore(CAMERA).split(np.zeros((1, 8), bool), wall(5, STRIP), at(), wall(5, STRIP))
