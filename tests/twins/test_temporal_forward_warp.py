"""The Warp kernels of the forward warp agree with their NumPy twin up to the rounding of bilinear samples.

Z-buffer, weights and positions are equal bit for bit. Disparities are not: where the processor can, OpenCV rounds once
for a product and a sum, and the kernels round twice. A sample consists of three such pairs, each with an error of up to
2^-24 of its largest term. Where the camera approaches, disparity grows by the ratio of the distances, and the error by
its square.
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
    MAX_RESAMPLING_CHANGE_PX,
    WEIGHT_BITS,
    ForwardWarp,
    Warped,
    _close_cracks,
)
from voxdepth.temporal.forward_warp_gpu import GpuForwardWarp
from voxdepth.temporal.odometry import TrackingStatus
from voxdepth.temporal.working_resolution import MAX_DISPARITY_PX, MIN_DISPARITY_PX, WorkingResolution
from voxdepth.types import Intrinsics

CAMERA = dataclasses.replace(Intrinsics.from_hfov(width_px=640, height_px=360, hfov_deg=80), baseline_m=0.095)
RESOLUTIONS = [WorkingResolution.of(CAMERA, decimation) for decimation in (1, 2)]
TOLERANCE = 16 * 2.0**-24
"""Relative difference to the largest disparity of a neighbourhood: three roundings, 3.5 times as large where the
nearest surface of a room approaches to 0.28 of its distance, and a margin."""
HOLE_TOLERANCE_PX = 0.02
"""Difference beside a hole. A sample may contain up to 3e-5 of `HOLE_PX` along one side if the other side cancels
it."""

both_sizes = pytest.mark.parametrize("resolution", RESOLUTIONS, ids=["640x360", "320x180"])
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


def noise(resolution: WorkingResolution, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """No two neighbours are of one surface, and a third is empty."""
    rng = np.random.default_rng(seed)
    disparity_px = rng.uniform(0.5, 90, resolution.shape).astype(np.float32)
    disparity_px[rng.random(resolution.shape) < 0.3] = 0
    return disparity_px, rng.integers(0, 256, resolution.shape).astype(np.uint8)


def room(resolution: WorkingResolution, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A slanted ground, boxes before it, holes, and weights: from 2.5 m on."""
    rng = np.random.default_rng(seed)
    height, width = resolution.shape
    v, u = np.mgrid[:height, :width] / height
    disparity_px = (3 + 8 * v + rng.uniform(-2, 2) * (u - 1)).astype(np.float32)
    for _ in range(12):
        top, left = rng.integers(0, height), rng.integers(0, width)
        disparity_px[top : top + height // 4, left : left + height // 5] = rng.uniform(3, 13)
    disparity_px[rng.random(resolution.shape) < 0.05] = 0
    weight = rng.integers(1, 256, resolution.shape).astype(np.uint8)
    weight[disparity_px == 0] = 0
    return disparity_px, weight


def uniform(resolution: WorkingResolution, disparity_px: float, weight: int) -> tuple[np.ndarray, np.ndarray]:
    return np.full(resolution.shape, disparity_px, np.float32), np.full(resolution.shape, weight, np.uint8)


def single(resolution: WorkingResolution) -> tuple[np.ndarray, np.ndarray]:
    disparity_px, weight = uniform(resolution, 0, 0)
    disparity_px[100, 150], weight[100, 150] = 7.3, 42
    return disparity_px, weight


DEGENERATE = {
    "empty": lambda resolution: uniform(resolution, 0, 0),
    "one pixel": single,
    "weightless": lambda resolution: uniform(resolution, 9.7, 0),
    "only weight": lambda resolution: uniform(resolution, 0, 255),
    "largest": lambda resolution: uniform(resolution, MAX_DISPARITY_PX, 255),
    "smallest": lambda resolution: uniform(resolution, MIN_DISPARITY_PX, 1),
    "endless": lambda resolution: uniform(resolution, 1e9, 255),
}


def assert_twins_agree(
    host: ForwardWarp, warp: GpuForwardWarp, image: tuple[np.ndarray, np.ndarray], T: np.ndarray
) -> tuple[Warped, np.ndarray]:
    """The result of the host, and its splatted disparity."""
    expected, got = host.warp(*image, T), warp.warp(*image, T)
    np.testing.assert_array_equal(warp._keys.numpy(), host._z_buffer[1:-1, 1:-1])
    splatted_px, weight = host._read_z_buffer()
    _close_cracks(splatted_px, weight)
    closed = (splatted_px * 2**FRACTION_BITS).astype(np.uint32) << WEIGHT_BITS | weight
    np.testing.assert_array_equal(warp._closed.numpy(), closed)
    for name in ("weight", "source_x", "source_y"):
        np.testing.assert_array_equal(getattr(got, name), getattr(expected, name))
    assert got.disparity_px.dtype == expected.disparity_px.dtype
    largest_px, beside_hole = neighbourhood(image[0], expected)
    assert_disparities_agree(got.disparity_px, expected.disparity_px, splatted_px, largest_px, beside_hole)
    return expected, splatted_px


def neighbourhood(disparity_px: np.ndarray, warped: Warped) -> tuple[np.ndarray, np.ndarray]:
    """The largest disparity that the sample of each pixel consists of, or that it became, and whether a hole is
    near."""
    taps_px = cv2.copyMakeBorder(disparity_px, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0)
    row = np.clip(np.rint(warped.source_y).astype(int) + 1, 0, taps_px.shape[0] - 1)
    col = np.clip(np.rint(warped.source_x).astype(int) + 1, 0, taps_px.shape[1] - 1)
    largest_px, least_px = (of(taps_px, np.ones((3, 3)))[row, col] for of in (cv2.dilate, cv2.erode))
    return np.maximum(largest_px, warped.disparity_px), least_px == 0


def assert_disparities_agree(
    got: np.ndarray, expected: np.ndarray, splatted_px: np.ndarray, largest_px: np.ndarray, beside_hole: np.ndarray
) -> None:
    """Both are within the tolerance. If one of them rejected the sample, it was as near to the bound of the rejection.

    Beside a hole, either of them may reject a sample to which the hole contributes next to nothing.
    """
    tolerance_px = np.where(beside_hole, HOLE_TOLERANCE_PX, TOLERANCE * largest_px)
    difference_px = np.abs(got - expected)
    one_rejected = (got == splatted_px) != (expected == splatted_px)
    tipped = one_rejected & (np.abs(difference_px - MAX_RESAMPLING_CHANGE_PX) <= tolerance_px)
    assert ((difference_px <= tolerance_px) | tipped | (beside_hole & one_rejected)).all()


def both(resolution: WorkingResolution, device: str) -> tuple[ForwardWarp, GpuForwardWarp]:
    return ForwardWarp(resolution), GpuForwardWarp(resolution, device=device)


@each_device
@both_sizes
@pytest.mark.parametrize("name", MOTIONS)
def test_rooms_agree(name: str, resolution: WorkingResolution, device: str) -> None:
    warped, splatted_px = assert_twins_agree(*both(resolution, device), room(resolution, 1), MOTIONS[name])
    seen = splatted_px > 0
    sampled = (warped.disparity_px != splatted_px) & seen
    assert seen.mean() > 0.4 or (name in OUT_OF_SIGHT and not seen.any())
    assert sampled.sum() >= 0.7 * seen.sum()


@each_device
@both_sizes
@pytest.mark.parametrize("image", DEGENERATE)
def test_degenerate_images_agree(image: str, resolution: WorkingResolution, device: str) -> None:
    host, warp = both(resolution, device)
    for T in MOTIONS.values():
        assert_twins_agree(host, warp, DEGENERATE[image](resolution), T)


@each_device
@both_sizes
@pytest.mark.parametrize("image", DEGENERATE)
def test_without_motion_degenerate_images_stay_but_for_what_is_too_near(
    image: str, resolution: WorkingResolution, device: str
) -> None:
    disparity_px, weight = DEGENERATE[image](resolution)
    warped = GpuForwardWarp(resolution, device=device).warp(disparity_px, weight, np.eye(4))
    possible_px = np.where(disparity_px > MAX_DISPARITY_PX, 0, disparity_px)
    np.testing.assert_allclose(warped.disparity_px, possible_px, rtol=0, atol=2 * 2.0**-FRACTION_BITS)
    np.testing.assert_array_equal(warped.weight, np.where(possible_px > 0, weight, 0))


@each_device
@both_sizes
@given(seed=st.integers(0, 1000), name=st.sampled_from(list(MOTIONS)))
def test_noise_agrees(seed: int, name: str, resolution: WorkingResolution, device: str) -> None:
    _, splatted_px = assert_twins_agree(*both(resolution, device), noise(resolution, seed), MOTIONS[name])
    assert splatted_px.any() or name in OUT_OF_SIGHT


@each_device
def test_a_result_outlives_the_next_call(device: str) -> None:
    resolution = RESOLUTIONS[1]
    warp = GpuForwardWarp(resolution, device=device)
    first = warp.warp(*room(resolution, 1), MOTIONS["a frame"])
    copies = {name: image.copy() for name, image in vars(first).items()}
    second = warp.warp(*room(resolution, 2), MOTIONS["rolled"])
    for name, copy in copies.items():
        np.testing.assert_array_equal(getattr(first, name), copy)
        assert (getattr(second, name) != copy).any()


@pytest.mark.parametrize("cut", [np.s_[:-1], np.s_[:, 1:], np.s_[0]])
def test_images_of_another_size_are_rejected(cut: object) -> None:
    resolution = RESOLUTIONS[1]
    disparity_px, weight = room(resolution, 1)
    warp = GpuForwardWarp(resolution, device="cpu")
    with pytest.raises(FrameError, match=r"have shape \(180, 320\), got"):
        warp.warp(disparity_px[cut], weight, np.eye(4))
    with pytest.raises(FrameError, match=r"have shape \(180, 320\), got"):
        warp.warp(disparity_px, weight[cut], np.eye(4))


@each_device
@pytest.mark.parametrize("decimation", [1, 2])
def test_a_stream_is_corrected_alike(decimation: int, device: str) -> None:
    frames = [noisy(frame, seed=5) for frame in frames_of(ROOM, walk(8))]
    host, warp = method(decimation=decimation), method(decimation=decimation)
    warp._forward_warp = GpuForwardWarp(warp._resolution, device=device)
    for expected, got in zip(run(host, frames), run(warp, frames), strict=True):
        # Rounding may tip a decision about a pixel here and there.
        assert np.mean(expected.source != got.source) < 1e-3
        assert np.mean(abs(expected.depth_m - got.depth_m) > 1e-3) < 1e-3
    assert expected.diagnostics.status is TrackingStatus.OK


@each_device
def test_the_configuration_decides_where_the_memory_is_moved(device: str) -> None:
    corrector = VoxDepth(CAMERA, VoxDepthConfig(device=device))
    expected = ForwardWarp if device == "cpu" else GpuForwardWarp
    assert type(corrector._forward_warp) is expected


@pytest.mark.skipif(wp.is_cuda_available(), reason="there is a GPU")
def test_without_a_gpu_cuda_is_rejected_in_one_line() -> None:
    with pytest.raises(ConfigError, match="no CUDA device"):
        GpuForwardWarp(RESOLUTIONS[1], device="cuda")
    with pytest.raises(ConfigError, match="no CUDA device"):
        VoxDepth(CAMERA, VoxDepthConfig(device="cuda"))
