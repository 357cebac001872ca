"""The Warp kernels of the reprojection see what their NumPy twin sees, and give its values but for rounding.

Keys, weights and positions are equal bit for bit. Values are not: OpenCV 5 samples at exact positions (it does not
round them to 1/32 px), but where the processor can, it rounds once for a product and a sum together, the kernels once
for each. Three such pairs make a sample, each off by up to 2^-24 of the largest number that it is made of: a disparity,
or what stands for a hole. Where the camera comes nearer, disparity grows by the ratio of the distances, and such a
difference by its square.
"""

import dataclasses

import cv2
import numpy as np
import pytest
import warp as wp
from hypothesis import given
from hypothesis import strategies as st

from tests.temporal_scenes import ROOM, frames_of, method, noisy, run, walk
from voxdepth import VoxDepth, VoxDepthConfig
from voxdepth.errors import ConfigError, FrameError
from voxdepth.temporal.forward_warp import (
    FRACTION_BITS,
    SAME_SURFACE_PX,
    WEIGHT_BITS,
    Moved,
    Reprojection,
    _close_cracks,
)
from voxdepth.temporal.odometry import TrackingStatus
from voxdepth.temporal.warp_forward_warp import WarpReprojection
from voxdepth.temporal.working_resolution import LARGEST_PX, SMALLEST_PX, Scale
from voxdepth.types import Intrinsics

CAMERA = dataclasses.replace(Intrinsics.from_hfov(width_px=640, height_px=360, hfov_deg=80), baseline_m=0.095)
SCALES = [Scale.of(CAMERA, step) for step in (1, 2)]
TOLERANCE = 16 * 2.0**-24
"""Part of the largest number around by which values may differ: three roundings, made 3.5 times as large where the
nearest surface of a room comes to 0.28 of its distance, and a margin. 0.00009 px of 90 px, 0.001 px beside a hole."""

both_sizes = pytest.mark.parametrize("scale", SCALES, ids=["640x360", "320x180"])
each_device = pytest.mark.parametrize(
    "device",
    [
        "cpu",
        pytest.param(
            "cuda", marks=pytest.mark.skipif(not wp.is_cuda_available(), reason="Warp finds no CUDA device here")
        ),
    ],
)


def motion(*, turn_deg: tuple[float, ...] = (0, 0, 0), shift_m: tuple[float, ...] = (0, 0, 0)) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = cv2.Rodrigues(np.deg2rad(np.array(turn_deg, float)))[0]
    T[:3, 3] = shift_m
    return T


MOTIONS = {
    "none": np.eye(4),
    "aside": motion(shift_m=(0.2, -0.1, 0)),
    "a frame": motion(turn_deg=(0.4, -1.1, 0.3), shift_m=(0.03, 0.01, -0.12)),
    "a step nearer": motion(shift_m=(0, 0, -0.01)),
    "zoom": motion(shift_m=(0, 0, -2.0)),
    "back": motion(shift_m=(0, 0, 2.5)),
    "rolled": motion(turn_deg=(0, 0, 35)),
    "upside down": motion(turn_deg=(0, 0, 180)),
    "turned round": motion(turn_deg=(0, 180, 0)),
    "all behind": motion(shift_m=(0, 0, -1e4)),
}
OUT_OF_SIGHT = ("turned round", "all behind")


def noise(scale: Scale, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """No two neighbours are of one surface, and a third is empty."""
    rng = np.random.default_rng(seed)
    disparity_px = rng.uniform(0.5, 90, scale.shape).astype(np.float32)
    disparity_px[rng.random(scale.shape) < 0.3] = 0
    return disparity_px, rng.integers(0, 256, scale.shape).astype(np.uint8)


def room(scale: Scale, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A slanted ground, boxes before it, holes, and weights: from 2.5 m on."""
    rng = np.random.default_rng(seed)
    height, width = scale.shape
    v, u = np.mgrid[:height, :width] / height
    disparity_px = (3 + 8 * v + rng.uniform(-2, 2) * (u - 1)).astype(np.float32)
    for _ in range(12):
        top, left = rng.integers(0, height), rng.integers(0, width)
        disparity_px[top : top + height // 4, left : left + height // 5] = rng.uniform(3, 13)
    disparity_px[rng.random(scale.shape) < 0.05] = 0
    weight = rng.integers(1, 256, scale.shape).astype(np.uint8)
    weight[disparity_px == 0] = 0
    return disparity_px, weight


def uniform(scale: Scale, disparity_px: float, weight: int) -> tuple[np.ndarray, np.ndarray]:
    return np.full(scale.shape, disparity_px, np.float32), np.full(scale.shape, weight, np.uint8)


def single(scale: Scale) -> tuple[np.ndarray, np.ndarray]:
    disparity_px, weight = uniform(scale, 0, 0)
    disparity_px[100, 150], weight[100, 150] = 7.3, 42
    return disparity_px, weight


DEGENERATE = {
    "empty": lambda scale: uniform(scale, 0, 0),
    "one pixel": single,
    "weightless": lambda scale: uniform(scale, 9.7, 0),
    "only weight": lambda scale: uniform(scale, 0, 255),
    "largest": lambda scale: uniform(scale, LARGEST_PX, 255),
    "smallest": lambda scale: uniform(scale, SMALLEST_PX, 1),
    "endless": lambda scale: uniform(scale, 1e9, 255),
}


def assert_twins_agree(
    host: Reprojection, warp: WarpReprojection, image: tuple[np.ndarray, np.ndarray], T: np.ndarray
) -> tuple[Moved, np.ndarray]:
    """What the host moved, and what disparities were seen before they were replaced by samples."""
    expected, got = host.move(*image, T), warp.move(*image, T)
    np.testing.assert_array_equal(warp._keys.numpy(), host._buffer[1:-1, 1:-1])
    seen_px, weight = host._seen()
    _close_cracks(seen_px, weight)
    closed = (seen_px * 2**FRACTION_BITS).astype(np.uint32) << WEIGHT_BITS | weight
    np.testing.assert_array_equal(warp._closed.numpy(), closed)
    for name in ("weight", "source_x", "source_y"):
        np.testing.assert_array_equal(getattr(got, name), getattr(expected, name))
    assert got.disparity_px.dtype == expected.disparity_px.dtype
    largest_px, beside_hole = around(image[0], expected)
    assert_values_agree(got.disparity_px, expected.disparity_px, seen_px, TOLERANCE * largest_px, beside_hole)
    return expected, seen_px


def around(disparity_px: np.ndarray, moved: Moved) -> tuple[np.ndarray, np.ndarray]:
    """The largest number that the sample of each moved pixel is made of, or that it became, and if nothing is near."""
    taps_px = cv2.copyMakeBorder(disparity_px, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0)
    row = np.clip(np.rint(moved.source_y).astype(int) + 1, 0, taps_px.shape[0] - 1)
    col = np.clip(np.rint(moved.source_x).astype(int) + 1, 0, taps_px.shape[1] - 1)
    largest_px, least_px = (of(taps_px, np.ones((3, 3)))[row, col] for of in (cv2.dilate, cv2.erode))
    return np.maximum(largest_px, moved.disparity_px), least_px == 0


def assert_values_agree(
    got: np.ndarray, expected: np.ndarray, seen_px: np.ndarray, tolerance_px: np.ndarray, beside_hole: np.ndarray
) -> None:
    """Within the tolerance; if only one of them took the sample, that was as near to the bound of what is accepted.

    Beside a hole, a sample of which next to nothing is mixed with nothing may be refused by one of them alone.
    """
    difference_px = np.abs(got - expected)
    one_refused = (got == seen_px) != (expected == seen_px)
    tipped = one_refused & (np.abs(difference_px - SAME_SURFACE_PX) <= tolerance_px)
    assert ((difference_px <= tolerance_px) | tipped | (beside_hole & one_refused)).all()


def both(scale: Scale, device: str) -> tuple[Reprojection, WarpReprojection]:
    return Reprojection(scale), WarpReprojection(scale, device=device)


@each_device
@both_sizes
@pytest.mark.parametrize("name", MOTIONS)
def test_rooms_agree(name: str, scale: Scale, device: str) -> None:
    moved, seen_px = assert_twins_agree(*both(scale, device), room(scale, 1), MOTIONS[name])
    seen = seen_px > 0
    sampled = (moved.disparity_px != seen_px) & seen
    assert seen.mean() > 0.4 or (name in OUT_OF_SIGHT and not seen.any())
    assert sampled.sum() >= 0.7 * seen.sum()


@each_device
@both_sizes
@pytest.mark.parametrize("image", DEGENERATE)
def test_degenerate_images_agree(image: str, scale: Scale, device: str) -> None:
    host, warp = both(scale, device)
    for T in MOTIONS.values():
        assert_twins_agree(host, warp, DEGENERATE[image](scale), T)


@each_device
@both_sizes
@pytest.mark.parametrize("image", DEGENERATE)
def test_without_motion_degenerate_images_stay_but_for_what_is_too_near(image: str, scale: Scale, device: str) -> None:
    disparity_px, weight = DEGENERATE[image](scale)
    moved = WarpReprojection(scale, device=device).move(disparity_px, weight, np.eye(4))
    possible_px = np.where(disparity_px > LARGEST_PX, 0, disparity_px)
    np.testing.assert_allclose(moved.disparity_px, possible_px, rtol=0, atol=2 * 2.0**-FRACTION_BITS)
    np.testing.assert_array_equal(moved.weight, np.where(possible_px > 0, weight, 0))


@each_device
@both_sizes
@given(seed=st.integers(0, 1000), name=st.sampled_from(list(MOTIONS)))
def test_noise_agrees(seed: int, name: str, scale: Scale, device: str) -> None:
    _, seen_px = assert_twins_agree(*both(scale, device), noise(scale, seed), MOTIONS[name])
    assert seen_px.any() or name in OUT_OF_SIGHT


@each_device
def test_a_result_outlives_the_next_call(device: str) -> None:
    scale = SCALES[1]
    warp = WarpReprojection(scale, device=device)
    first = warp.move(*room(scale, 1), MOTIONS["a frame"])
    copies = {name: image.copy() for name, image in vars(first).items()}
    second = warp.move(*room(scale, 2), MOTIONS["rolled"])
    for name, copy in copies.items():
        np.testing.assert_array_equal(getattr(first, name), copy)
        assert (getattr(second, name) != copy).any()


@pytest.mark.parametrize("cut", [np.s_[:-1], np.s_[:, 1:], np.s_[0]])
def test_images_of_another_size_are_refused(cut: object) -> None:
    scale = SCALES[1]
    disparity_px, weight = room(scale, 1)
    warp = WarpReprojection(scale, device="cpu")
    with pytest.raises(FrameError, match=r"have shape \(180, 320\), got"):
        warp.move(disparity_px[cut], weight, np.eye(4))
    with pytest.raises(FrameError, match=r"have shape \(180, 320\), got"):
        warp.move(disparity_px, weight[cut], np.eye(4))


@each_device
@pytest.mark.parametrize("step", [1, 2])
def test_a_stream_is_corrected_alike(step: int, device: str) -> None:
    frames = [noisy(frame, seed=5) for frame in frames_of(ROOM, walk(8))]
    host, warp = method(memory_step=step), method(memory_step=step)
    warp._mover._reprojection = WarpReprojection(warp._scale, device=device)
    for expected, got in zip(run(host, frames), run(warp, frames), strict=True):
        # Rounding may tip a decision about a pixel here and there.
        assert np.mean(expected.source != got.source) < 1e-3
        assert np.mean(abs(expected.depth_m - got.depth_m) > 1e-3) < 1e-3
    assert expected.diagnostics.tracking is TrackingStatus.OK


@each_device
def test_the_configuration_decides_where_the_memory_is_moved(device: str) -> None:
    corrector = VoxDepth(CAMERA, VoxDepthConfig(device=device))
    expected = Reprojection if device == "cpu" else WarpReprojection
    assert type(corrector._method._mover._reprojection) is expected


@pytest.mark.skipif(wp.is_cuda_available(), reason="there is a GPU")
def test_without_a_gpu_cuda_is_refused_in_one_line() -> None:
    with pytest.raises(ConfigError, match="no CUDA device"):
        WarpReprojection(SCALES[1], device="cuda")
    with pytest.raises(ConfigError, match="no CUDA device"):
        VoxDepth(CAMERA, VoxDepthConfig(device="cuda"))
