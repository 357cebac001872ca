"""Each loop over the images of the default method gives the bits of its NumPy twin."""

from collections.abc import Iterable

import numpy as np
import pytest

from tests.temporal_scenes import pose
from tests.twins import numpy_temporal as twins
from tests.twins.images import IMAGES, Shape, each_image, each_shape, spoiled
from voxdepth.geometry import inverse_rigid
from voxdepth.temporal import forward_warp, fusion, measurement, smoothing
from voxdepth.temporal import memory as memories
from voxdepth.temporal.confidence import estimate_confidence
from voxdepth.temporal.forward_warp import ForwardWarp, Warped
from voxdepth.temporal.fusion import Comparison, Fused, PixelClass, Rules, TemporalFusionConfig
from voxdepth.temporal.measurement import Measurement
from voxdepth.temporal.memory import Memory, coarse_shape
from voxdepth.temporal.working_resolution import WorkingResolution
from voxdepth.types import FloatImage, GrayImage, Intrinsics

FOCAL_BASELINE_PX_M = 30.3


def rng_of(shape: Shape, purpose: int = 0) -> np.random.Generator:
    return np.random.default_rng([*shape, purpose])


def camera_of(shape: Shape) -> Intrinsics:
    focal_px, (height, width) = 0.8 * max(shape), shape
    cx, cy = 0.47 * width, 0.52 * height
    return Intrinsics(
        fx_px=focal_px, fy_px=1.1 * focal_px, cx_px=cx, cy_px=cy, width_px=width, height_px=height, baseline_m=0.1
    )


def bytes_of(shape: Shape, purpose: int) -> GrayImage:
    return rng_of(shape, purpose).integers(0, 256, shape, np.uint8)


def weights_of(disparity_px: FloatImage, purpose: int, most: int) -> GrayImage:
    """Random weights; many are the smallest, the largest, or just enough for something. 0 where nothing is measured."""
    rng = rng_of(disparity_px.shape, purpose)
    weight = np.where(
        rng.random(disparity_px.shape) < 0.4,
        rng.choice([1, min(10, most), min(64, most), most], disparity_px.shape),
        rng.integers(1, most + 1, disparity_px.shape),
    )
    return np.where(disparity_px > 0, weight, 0).astype(np.uint8)


def require_equal(actual: Iterable[np.ndarray], expected: Iterable[np.ndarray]) -> None:
    for one, other in zip(actual, expected, strict=True):
        np.testing.assert_array_equal(one, other)


@each_shape
@each_image
def test_depth_and_disparity(image: str, shape: Shape) -> None:
    disparity_px, resolution = IMAGES[image](rng_of(shape), shape), WorkingResolution.of(camera_of(shape), 1)
    depth_m = resolution.depth(disparity_px)
    require_equal([depth_m], [twins.depth(disparity_px, resolution.focal_baseline_px_m)])
    too_near_m = np.where(rng_of(shape, 1).random(shape) < 0.1, np.float32(1e-4), depth_m)
    require_equal([resolution.disparity(too_near_m)], [twins.disparity(too_near_m, resolution.focal_baseline_px_m)])


class TestMeasurement:
    @each_shape
    @each_image
    def test_decimation(self, image: str, shape: Shape) -> None:
        depth_m = twins.depth(IMAGES[image](rng_of(shape), shape), FOCAL_BASELINE_PX_M)
        half = shape[0] // 2, shape[1] // 2
        disparity_px, validity = spoiled(half), spoiled(half, np.uint8)
        measurement._decimate(depth_m, FOCAL_BASELINE_PX_M, disparity_px, validity)
        require_equal([disparity_px, validity], twins.decimate(depth_m, FOCAL_BASELINE_PX_M))


def measured_px_of(memory_px: FloatImage, image: str) -> FloatImage:
    """A measurement of the kind of an image; parts of it are of the surface of the memory, or just out of tolerance."""
    shape = memory_px.shape
    rng = rng_of(shape, 3)
    other_px = IMAGES[image](rng, shape)
    near_px = memory_px + rng.choice(np.array([-1.5, -1, -0.25, 0, 0.25, 1, 1.5], np.float32), shape)
    return np.where((rng.random(shape) < 0.7) & (other_px > 0), np.clip(near_px, 0, 1000), other_px)


CONFIGS = {
    "default": TemporalFusionConfig(),
    "fast decay": TemporalFusionConfig(decay_outlier=8, decay_free_space=15, decay_occluded=15, max_evidence=15),
    "no evidence needed": TemporalFusionConfig(min_evidence=0.01, min_evidence_per_frame=0.01, min_coherence=1),
    "much evidence needed": TemporalFusionConfig(min_evidence=30, min_evidence_per_frame=30, max_gray_change_hole=1e3),
    "no averaging": TemporalFusionConfig(max_evidence=0.01, max_drift_px=1e-3, drift_gain=1, relative_tolerance=0),
}


@pytest.mark.parametrize("config", CONFIGS.values(), ids=CONFIGS)
@pytest.mark.parametrize("seen", ["holes", "small surfaces", "extreme"])
@pytest.mark.parametrize("shape", [(1, 1), (33, 46)], ids=str)
@each_image
class TestFusion:
    @pytest.fixture
    def memory(self, image: str, shape: Shape) -> Memory:
        disparity_px = IMAGES[image](rng_of(shape), shape)
        age = rng_of(shape, 1).choice(np.array([1, 2, 7, 254, 255], np.uint8), shape)
        drift_px = rng_of(shape, 2).normal(0, 0.2, coarse_shape(shape)).astype(np.float32)
        seen_px = disparity_px * rng_of(shape, 14).choice(np.array([0, 0.3, 1, 1.2], np.float32), shape)
        filled_px = np.zeros_like(disparity_px)
        weight = weights_of(disparity_px, 1, 240)
        return Memory(disparity_px, weight, bytes_of(shape, 1), seen_px, age, drift_px, filled_px)

    @pytest.fixture
    def measurement(self, memory: Memory, seen: str) -> Measurement:
        disparity_px, rng = measured_px_of(memory.disparity_px, seen), rng_of(memory.gray.shape, 4)
        is_other = rng.random(memory.gray.shape) < 0.3
        gray = np.where(is_other, bytes_of(memory.gray.shape, 2), memory.gray)
        return Measurement(disparity_px, weights_of(disparity_px, 2, 16), gray)

    def test_differences(self, memory: Memory, measurement: Measurement, config: TemporalFusionConfig) -> None:
        shape = memory.gray.shape
        overlap, difference_px = spoiled(shape, np.uint8), spoiled(shape)
        fusion._subtract(memory, measurement, Rules.of(config), overlap, difference_px)
        require_equal([overlap, difference_px], twins.subtract(memory, measurement, config))

    def test_contradictions(self, memory: Memory, measurement: Measurement, config: TemporalFusionConfig) -> None:
        shape = memory.gray.shape
        overlap, _ = twins.subtract(memory, measurement, config)
        bias_px, share = rng_of(shape, 5).normal(0, 0.4, shape).astype(np.float32), bytes_of(shape, 6)
        masks = tuple(spoiled(shape, np.uint8) for _ in range(3))
        fusion._find_contradictions(memory, measurement, overlap, bias_px, share, Rules.of(config), *masks)
        require_equal(masks, twins.find_contradictions(memory, measurement, overlap, bias_px, share, config))

    def test_drift(self, memory: Memory, seen: str, config: TemporalFusionConfig) -> None:
        before_px, rng = memory.drift_px, rng_of(memory.gray.shape, 7)
        mean_px = rng.normal(0, 0.4, before_px.shape).astype(np.float32)
        mean_count = IMAGES[seen](rng, before_px.shape).clip(0, 255)
        drift_px, factor = spoiled(before_px.shape), spoiled(before_px.shape)
        fusion._update_drift(before_px, mean_px, mean_count, Rules.of(config), drift_px, factor)
        require_equal([drift_px, factor], twins.update_drift(before_px, mean_px, mean_count, config))

    def test_pixels(self, memory: Memory, measurement: Measurement, config: TemporalFusionConfig) -> None:
        shape = memory.gray.shape
        max_gray_change = float(rng_of(shape, 13).choice([0, 100, 254.5, 1e9]))
        overlap, _ = twins.subtract(memory, measurement, config)
        factor = rng_of(shape, 8).choice(np.array([0, 0.3, 1], np.float32), shape)
        comparison = Comparison(
            overlap * (bytes_of(shape, 9) > 128), *(bytes_of(shape, purpose) for purpose in (10, 11)), factor
        )
        fused, updated = Fused.buffer(shape), Memory.buffer(shape)
        for array in (*fused, *updated):
            array.fill(77)
        fusion._fuse_pixels(
            memory, measurement, comparison, bytes_of(shape, 12), max_gray_change, Rules.of(config), fused, updated,
        )  # fmt: skip
        twin_fused, twin_updated = twins.fuse_pixels(
            memory, measurement, comparison, bytes_of(shape, 12), max_gray_change, config
        )
        require_equal(fused, twin_fused)
        require_equal(updated[:5], twin_updated[:5])

    def test_all_steps(self, memory: Memory, measurement: Measurement, config: TemporalFusionConfig) -> None:
        fused, updated = fusion.fuse(memory, measurement, config)
        twin_fused, twin_updated = twins.fuse(memory, measurement, config)
        require_equal(fused, twin_fused)
        require_equal(updated[:6], twin_updated[:6])


@pytest.mark.parametrize("values", [[0], [255], [3, 200], range(256)], ids=len)
@pytest.mark.parametrize("shape", [(1, 1), (4, 5), (5, 5), (33, 46)], ids=str)
def test_the_median_of_a_sparse_image(shape: Shape, values: list[int]) -> None:
    gray = rng_of(shape).choice(np.array(values, np.uint8), shape)
    assert fusion._sparse_median(gray) == twins.sparse_median(gray)


MOTIONS = {
    "none": np.eye(4),
    "all": inverse_rigid(pose(0.1, -0.04, 0.2, yaw=-3, pitch=2, roll=7)),
    "forward": inverse_rigid(pose(0.02, 0.03, 0.4)),
    "back": inverse_rigid(pose(0.0, 0.01, -0.5)),
    "far aside": inverse_rigid(pose(100.0)),
    "turned round": inverse_rigid(pose(yaw=180)),
}


@pytest.mark.parametrize("T", MOTIONS.values(), ids=MOTIONS)
@each_shape
@each_image
class TestForwardWarp:
    @pytest.fixture
    def disparity_px(self, image: str, shape: Shape) -> FloatImage:
        return IMAGES[image](rng_of(shape), shape)

    @pytest.fixture
    def weight(self, disparity_px: FloatImage) -> GrayImage:
        return weights_of(disparity_px, 1, 255)

    @pytest.fixture
    def resolution(self, shape: Shape) -> WorkingResolution:
        return WorkingResolution.of(camera_of(shape), 1)

    def test_splatting(
        self, disparity_px: FloatImage, weight: GrayImage, resolution: WorkingResolution, T: np.ndarray
    ) -> None:
        height, width = disparity_px.shape
        keys, marked_px = np.zeros((height + 2, width + 2), np.uint32), spoiled(disparity_px.shape)
        forward = twins.reprojection(resolution, T)
        forward_warp._splat(disparity_px, weight, forward, keys, marked_px)
        twin_keys, twin_marked_px = twins.splat(disparity_px, weight, forward)
        require_equal([keys, marked_px], [twin_keys, twin_marked_px])
        read_px, read_weight = spoiled(disparity_px.shape), spoiled(disparity_px.shape, np.uint8)
        forward_warp._read_keys(keys, read_px, read_weight)
        require_equal([read_px, read_weight], twins.read_keys(keys))

    def test_tracing_back(
        self, disparity_px: FloatImage, weight: GrayImage, resolution: WorkingResolution, T: np.ndarray
    ) -> None:
        closed_px, closed_weight = np.roll(disparity_px, 1, axis=1), np.roll(weight, 1, axis=1)
        warped = Warped.buffer(disparity_px.shape)
        np.copyto(warped.disparity_px, disparity_px)
        np.copyto(warped.weight, weight)
        backward = twins.reprojection(resolution, T)
        forward_warp._trace_back(closed_px, closed_weight, backward, warped)
        require_equal(warped, twins.trace_back(disparity_px, weight, closed_px, closed_weight, backward))

    def test_resampling(self, disparity_px: FloatImage, resolution: WorkingResolution, T: np.ndarray) -> None:
        forward, backward = twins.reprojection(resolution, T), twins.reprojection(resolution, inverse_rigid(T))
        ratio = twins.move(backward, disparity_px)[2]
        noise_px = rng_of(disparity_px.shape, 2).normal(0, 0.5, disparity_px.shape).astype(np.float32)
        is_hole = rng_of(disparity_px.shape, 3).random(disparity_px.shape) < 0.2
        sampled_px = np.where(is_hole, forward_warp.HOLE_PX, disparity_px * ratio + noise_px)
        resampled_px = disparity_px.copy()
        forward_warp._resample(sampled_px, backward, forward[2, 3], resampled_px)
        require_equal([resampled_px], [twins.resample(sampled_px, disparity_px, backward, forward)])

    def test_all_steps(
        self, disparity_px: FloatImage, weight: GrayImage, resolution: WorkingResolution, T: np.ndarray
    ) -> None:
        warped = ForwardWarp(resolution).warp(disparity_px, weight, T)
        require_equal(warped, twins.warp(disparity_px, weight, resolution, T))


@pytest.mark.parametrize("shape", [(2, 2), (5, 7), (33, 46)], ids=str)
def test_positions_of_the_drift(shape: Shape) -> None:
    position, coarse = rng_of(shape).uniform(-50, 300, shape).astype(np.float32), spoiled(coarse_shape(shape))
    memories._decimate_position(position, coarse)
    require_equal([coarse], [twins.decimate_position(position)])


@each_shape
@each_image
def test_confidence(image: str, shape: Shape) -> None:
    disparity_px, rng = IMAGES[image](rng_of(shape), shape), rng_of(shape, 1)
    pixel_class, probability = rng.choice(np.array(PixelClass, np.uint8), shape), rng.random(shape, np.float32)
    magnification = rng.choice(np.array([1, 1.5, 40, 1e9], np.float32), shape)
    pixels = disparity_px, pixel_class, bytes_of(shape, 2), magnification, probability
    np.testing.assert_allclose(estimate_confidence(*pixels), twins.confidence(*pixels), rtol=1e-5, atol=1e-6)


@each_shape
@each_image
def test_smoothing(image: str, shape: Shape) -> None:
    disparity_px, smoothed_px = IMAGES[image](rng_of(shape), shape), spoiled(shape)
    mean_px = IMAGES[image](rng_of(shape, 1), shape)
    square_px2 = np.square(mean_px) + rng_of(shape, 2).choice(np.array([-1e-3, 0, 0.2, 50], np.float32), shape)
    smoothing._smooth(disparity_px, mean_px, square_px2, 0.3**2, smoothed_px)
    require_equal([smoothed_px], [twins.smooth(disparity_px, mean_px, square_px2, 0.3**2)])
