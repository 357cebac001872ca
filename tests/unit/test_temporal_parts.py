"""Parts of the default method: resolution, measurement, upsampling, smoothing, confidence and the memory's warp."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from tests.temporal_scenes import CAMERA, ROOM, depth_of, frame_of, pose, render
from voxdepth.geometry import inverse_rigid
from voxdepth.temporal.confidence import (
    FILL_ERROR_PX,
    FILL_ODDS,
    MEASURED_ODDS,
    SENSOR_NOISE_PX,
    estimate_confidence,
)
from voxdepth.temporal.forward_warp import ForwardWarp
from voxdepth.temporal.fusion import PixelClass
from voxdepth.temporal.measurement import Measurement, measure
from voxdepth.temporal.memory import DRIFT_DECIMATION, WEIGHT_UNIT, Memory
from voxdepth.temporal.roughness import roughness
from voxdepth.temporal.smoothing import NOISE_PX, smooth_guided
from voxdepth.temporal.upsampling import DisparityEstimate, ImagePool, OutputImages, Upsampler
from voxdepth.temporal.working_resolution import (
    MAX_DISPARITY_PX,
    MAX_FULL_RESOLUTION_PX,
    WorkingResolution,
    default_decimation,
)
from voxdepth.types import FloatArray, FloatImage, Frame, GrayImage, Intrinsics, Source

ODD = Intrinsics.from_hfov(width_px=161, height_px=119, hfov_deg=70, baseline_m=0.1)


def measurement_of(full_px: FloatImage, decimation: int, camera: Intrinsics = CAMERA) -> Measurement:
    resolution = WorkingResolution.of(camera, decimation)
    frame = Frame(stamp_s=0, gray=np.zeros(camera.shape, np.uint8), depth_m=depth_of(resolution, full_px))
    return measure(frame, resolution)


def constant(value: float, camera: Intrinsics = CAMERA) -> FloatImage:
    return np.full(camera.shape, value, np.float32)


class TestMeasurement:
    @pytest.mark.parametrize("decimation", [1, 2])
    @pytest.mark.parametrize("camera", [CAMERA, ODD], ids=["even", "odd"])
    def test_constant_stays_constant(self, camera: Intrinsics, decimation: int) -> None:
        new = measurement_of(constant(6.5, camera), decimation, camera)
        np.testing.assert_array_equal(
            new.disparity_px, np.full(WorkingResolution.of(camera, decimation).shape, 6.5, np.float32)
        )
        np.testing.assert_array_equal(new.weight, WEIGHT_UNIT)
        assert new.gray.shape == new.disparity_px.shape

    @pytest.mark.parametrize(
        ("four", "one"),
        [
            ((6, 6.2, 6.4, 0), 6.2),
            ((6, 6.1, 6.2, 6.3), 6.15),
            ((0, 150, 150.5, 0), 150.25),
            ((0, 0, 0, 150), 150),
            ((4, 4, 4, 9), 4),
            ((9, 4, 9, 9), 9),
            ((0, 9, 9, 4), 9),
        ],
    )
    def test_a_decimated_pixel_is_the_mean_of_the_larger_surface(self, four: tuple[float, ...], one: float) -> None:
        full_px = np.tile(np.array(four, np.float32).reshape(2, 2), (60, 80))
        np.testing.assert_allclose(measurement_of(full_px, 2).disparity_px, one, rtol=1e-6)

    @pytest.mark.parametrize("decimation", [1, 2])
    @pytest.mark.parametrize("side_px", [1, 3, 4])
    def test_near_specks_are_removed(self, side_px: int, decimation: int) -> None:
        full_px = constant(6)
        full_px[20 : 20 + side_px * decimation, 30 : 30 + side_px * decimation] = 20
        new = measurement_of(full_px, decimation)
        expected_px = np.full_like(new.disparity_px, 6)
        expected_px[20 // decimation : 20 // decimation + side_px, 30 // decimation : 30 // decimation + side_px] = 0
        np.testing.assert_array_equal(new.disparity_px, expected_px)
        np.testing.assert_array_equal(new.weight > 0, new.disparity_px > 0)

    @pytest.mark.parametrize("decimation", [1, 2])
    @pytest.mark.parametrize(("side_px", "disparity_px"), [(5, 20.0), (3, 2.0)], ids=["large", "far"])
    def test_larger_and_farther_surfaces_stay(self, side_px: int, disparity_px: float, decimation: int) -> None:
        full_px = constant(6)
        block = np.s_[20 : 20 + side_px * decimation, 30 : 30 + side_px * decimation]
        full_px[block] = disparity_px
        np.testing.assert_array_equal(
            measurement_of(full_px, decimation).disparity_px, full_px[::decimation, ::decimation]
        )

    @pytest.mark.parametrize("decimation", [1, 2])
    def test_a_far_speck_alone_in_a_hole_is_removed_if_it_lies_beyond_the_scene(self, decimation: int) -> None:
        full_px = constant(6)
        full_px[40:80, 60:100] = 0
        speckle = np.s_[60 : 60 + 2 * decimation, 80 : 80 + 2 * decimation]
        working = np.s_[60 // decimation : 60 // decimation + 2, 80 // decimation : 80 // decimation + 2]
        for disparity_px, stays in ((2.0, False), (5.7, True)):
            full_px[speckle] = disparity_px
            expected_px = disparity_px if stays else 0
            np.testing.assert_allclose(measurement_of(full_px, decimation).disparity_px[working], expected_px)
        full_px[speckle], full_px[:10] = 2, 1.5  # now the scene is deeper
        np.testing.assert_array_equal(measurement_of(full_px, decimation).disparity_px[working], 2)

    def test_lonely_pixels_stay(self) -> None:
        # Without a larger surface around there is nothing that contradicts them.
        lonely_px = np.zeros(CAMERA.shape, np.float32)
        lonely_px[::20, ::20] = 8
        np.testing.assert_array_equal(measurement_of(lonely_px, 1).disparity_px, lonely_px)

    @pytest.mark.parametrize("decimation", [1, 2])
    def test_a_slanted_surface_has_no_speckles(self, decimation: int) -> None:
        row, col = np.indices(CAMERA.shape)
        full_px = np.asarray(5 + 0.4 * row + 0.2 * col, np.float32)
        assert (measurement_of(full_px, decimation).disparity_px > 0).all()

    @pytest.mark.parametrize("decimation", [1, 2])
    def test_weights_fall_at_the_border_of_a_hole(self, decimation: int) -> None:
        full_px = constant(6)
        full_px[40:60, 40:60] = 0
        weight = measurement_of(full_px, decimation).weight[50 // decimation]
        assert weight[50 // decimation] == 0
        beside, away = weight[60 // decimation], weight[60 // decimation + 3]
        assert beside == round(WEIGHT_UNIT * 0.6**4)  # two of five columns are missing
        assert away == WEIGHT_UNIT

    @pytest.mark.parametrize(("count", "share"), [(1, 0.25), (2, 0.5), (3, 0.75), (4, 1.0)])
    def test_the_weight_of_a_decimated_pixel_depends_on_its_valid_pixels(self, count: int, share: float) -> None:
        full_px = np.zeros(CAMERA.shape, np.float32)
        for row, col in ((0, 0), (1, 1), (0, 1), (1, 0))[:count]:
            full_px[row::2, col::2] = 6
        np.testing.assert_allclose(measurement_of(full_px, 2).weight, WEIGHT_UNIT * share**2, atol=0.6)


def shown_from(full_px: FloatImage, estimate: DisparityEstimate, camera: Intrinsics = CAMERA) -> OutputImages:
    """The output from estimates at half resolution, by a measurement at full resolution."""
    resolution = WorkingResolution.of(camera, 2)
    return Upsampler(camera.shape, resolution).show(depth_of(resolution, full_px), estimate)


def merged_px(full_px: FloatImage, half_px: FloatImage, kind: GrayImage, camera: Intrinsics = CAMERA) -> FloatImage:
    """The upsampled disparity, without the confidence."""
    shown = shown_from(full_px, DisparityEstimate(half_px, kind, np.ones_like(half_px)), camera)
    return WorkingResolution.of(camera, 2).disparity(shown.depth_m)


def as_fused(half_px: FloatImage) -> GrayImage:
    return np.full(half_px.shape, PixelClass.FUSED, np.uint8)


class TestUpsampling:
    @staticmethod
    def stepped() -> tuple[FloatImage, FloatImage]:
        """Two surfaces at full and half size, the first with noise; their edge goes through the half pixels 40."""
        clean_px = np.where(np.arange(CAMERA.width_px) < 81, np.float32(5), np.float32(12))
        half_px = measurement_of(np.broadcast_to(clean_px, CAMERA.shape).copy(), 2).disparity_px
        noise_px = 0.25 * (-1) ** np.indices(CAMERA.shape).sum(0)
        return np.asarray(clean_px + noise_px, np.float32), half_px

    @pytest.mark.parametrize("camera", [CAMERA, ODD], ids=["even", "odd"])
    def test_measured_pixels_keep_their_measurement(self, camera: Intrinsics) -> None:
        resolution = WorkingResolution.of(camera, 2)
        full_px = resolution.disparity(render(ROOM, pose(), camera)[1])
        half_px = measurement_of(full_px, 2, camera).disparity_px
        shown_px = merged_px(full_px, half_px, np.full(resolution.shape, PixelClass.MEASURED, np.uint8), camera)
        rows, cols = 2 * resolution.height_px, 2 * resolution.width_px
        np.testing.assert_allclose(shown_px[:rows, :cols], full_px[:rows, :cols], rtol=3e-7)
        assert shown_px.shape == full_px.shape

    def test_a_last_odd_row_or_column_shows_its_measurement_and_else_its_neighbour(self) -> None:
        full_px, shape = np.full(ODD.shape, np.float32(6)), WorkingResolution.of(ODD, 2).shape
        full_px[-1, :20], full_px[30:40, -1] = 3, 0
        kinds = np.full(shape, PixelClass.MEASURED, np.uint8)
        shown = shown_from(
            full_px, DisparityEstimate(np.full(shape, np.float32(6)), kinds, np.ones(shape, np.float32)), ODD
        )
        resolution = WorkingResolution.of(ODD, 2)
        expected_px = np.where(full_px > 0, full_px, np.float32(6))
        np.testing.assert_allclose(resolution.disparity(shown.depth_m), expected_px, rtol=1e-6)
        np.testing.assert_array_equal(shown.source, np.where(full_px > 0, Source.SENSOR, Source.INPAINTED))

    @pytest.mark.parametrize("kind", [PixelClass.UNMEASURED, PixelClass.FUSED, PixelClass.REMEMBERED])
    def test_surfaces_are_interpolated_linearly(self, kind: PixelClass) -> None:
        full_px = np.random.default_rng(0).uniform(0, 20, CAMERA.shape).astype(np.float32)
        row, col = np.indices(CAMERA.shape)
        plane_px = np.asarray(5 + 0.1 * row + 0.05 * col, np.float32)
        half_px = np.asarray(0.5 * (plane_px[::2, ::2] + plane_px[1::2, 1::2]), np.float32)
        shown_px = merged_px(full_px, half_px, np.full(half_px.shape, kind, np.uint8))
        np.testing.assert_allclose(shown_px[1:-1, 1:-1], plane_px[1:-1, 1:-1], atol=1e-5)
        # Beside the middle of the outermost pixels of memory nothing is extrapolated.
        np.testing.assert_allclose(shown_px, plane_px, atol=0.5 * (0.1 + 0.05) + 1e-5)

    def test_discontinuities_keep_measurements_of_the_same_surface(self) -> None:
        full_px, half_px = self.stepped()
        full_px[40, 80], full_px[41, 80] = 9.0, 0.0  # an outlier and a hole
        assert half_px[0, 40] == 5  # of as many pixels of two surfaces the farther one
        expected_px = np.repeat(np.repeat(half_px, 2, axis=0), 2, axis=1)
        at_edge = np.s_[:, 80:84]  # half pixels with another surface beside them
        expected_px[at_edge] = full_px[at_edge]
        expected_px[:, 81] = expected_px[40:42, 80] = 5  # that was measured of something else, or not at all
        np.testing.assert_allclose(merged_px(full_px, half_px, as_fused(half_px)), expected_px, atol=1e-5)

    def test_discontinuities_are_not_interpolated(self) -> None:
        _, half_px = self.stepped()
        shown_px = merged_px(np.zeros(CAMERA.shape, np.float32), half_px, as_fused(half_px))
        np.testing.assert_allclose(shown_px, np.repeat(np.repeat(half_px, 2, axis=0), 2, axis=1), rtol=3e-7)

    def test_holes_of_the_measurement_are_filled(self) -> None:
        full_px = constant(6)
        full_px[40:61, 40:61] = 0
        half_px = np.full((60, 80), 6.25, np.float32)
        kind = np.full(half_px.shape, PixelClass.MEASURED, np.uint8)
        np.testing.assert_allclose(merged_px(full_px, half_px, kind), np.where(full_px > 0, full_px, 6.25), rtol=3e-7)

    @pytest.mark.parametrize("size", [(120, 160), (121, 160), (120, 161), (121, 161)])
    def test_source_and_confidence_repeat_those_of_working_pixels(self, size: tuple[int, int]) -> None:
        rng, camera = np.random.default_rng(0), replace(CAMERA, height_px=size[0], width_px=size[1])
        kind = np.where(rng.random((60, 80)) < 0.5, PixelClass.REMEMBERED, PixelClass.UNMEASURED).astype(np.uint8)
        estimate = DisparityEstimate(np.full((60, 80), 8, np.float32), kind, rng.random((60, 80)).astype(np.float32))
        shown = shown_from(constant(0, camera), estimate, camera)
        row, col = np.indices(size)
        at = np.minimum(row // 2, 59), np.minimum(col // 2, 79)
        np.testing.assert_array_equal(shown.confidence, estimate.confidence[at])
        remembered = estimate.pixel_class[at] == PixelClass.REMEMBERED
        np.testing.assert_array_equal(shown.source, np.where(remembered, Source.MEMORY, Source.INPAINTED))

    def test_fills_of_low_confidence_are_not_shown(self) -> None:
        rng, resolution = np.random.default_rng(1), WorkingResolution.of(CAMERA, 1)
        kind = rng.integers(0, len(PixelClass), CAMERA.shape).astype(np.uint8)
        confidence = rng.choice(np.array([0.1, 0.49, 0.5, 0.51, 0.9], np.float32), CAMERA.shape)
        estimate = DisparityEstimate(constant(8), kind, confidence)
        shown = Upsampler(CAMERA.shape, resolution).show(constant(0), estimate, 0.5)
        hidden = np.isin(kind, [PixelClass.UNMEASURED, PixelClass.MEASURED]) & (estimate.confidence < 0.5)
        np.testing.assert_array_equal(shown.source == Source.INVALID, hidden)
        np.testing.assert_array_equal(shown.depth_m == 0, hidden)
        np.testing.assert_array_equal(shown.confidence == 0, hidden)


class TestSmoothing:
    @pytest.mark.parametrize("size_px", [1, 3, 5, 7])
    def test_constant_stays_constant_and_an_offset_commutes(self, size_px: int) -> None:
        np.testing.assert_allclose(smooth_guided(constant(40), size_px), 40, atol=1e-3)
        noisy_px = np.random.default_rng(0).normal(6, 0.5, CAMERA.shape).astype(np.float32)
        np.testing.assert_allclose(
            smooth_guided(noisy_px + np.float32(2), size_px), smooth_guided(noisy_px, size_px) + 2, atol=1e-3
        )

    def test_what_is_unknown_stays_unknown(self) -> None:
        holed_px = constant(6)
        holed_px[40, 50] = 0
        np.testing.assert_array_equal(smooth_guided(holed_px, 5) == 0, holed_px == 0)

    def test_a_plane_stays_a_plane_inside(self) -> None:
        row, col = np.mgrid[: CAMERA.height_px, : CAMERA.width_px]
        plane_px = np.asarray(5 + 0.1 * row + 0.05 * col, np.float32)
        np.testing.assert_allclose(smooth_guided(plane_px, 5)[2:-2, 2:-2], plane_px[2:-2, 2:-2], atol=1e-3)

    def test_noise_is_removed_and_an_edge_is_kept(self) -> None:
        step_px = constant(5)
        step_px[:, 80:] = 12
        noisy_px = step_px + np.random.default_rng(1).normal(0, 0.1, CAMERA.shape).astype(np.float32)
        error_px = smooth_guided(noisy_px, 5) - step_px
        assert np.std(error_px[:, :70]) < 0.04
        np.testing.assert_allclose(error_px[:, 76:84], 0, atol=0.5)

    def test_nothing_overshoots_by_rounding(self) -> None:
        noise_px = np.random.default_rng(4).normal(0, 0.05, CAMERA.shape).astype(np.float32)
        error_px = smooth_guided(np.float32(900) + noise_px, 5) - 900
        assert abs(error_px).max() <= abs(noise_px).max()

    def test_half_of_the_difference_to_the_mean_stays_where_the_window_varies_as_much_as_the_noise(self) -> None:
        varied_px = np.random.default_rng(2).normal(6, 0.4, (5, 5))
        varied_px = np.asarray(6 + (varied_px - 6) * NOISE_PX / varied_px.std(), np.float32)
        smoothed_px = smooth_guided(varied_px, 5)
        mean_px = varied_px.mean()
        assert smoothed_px[2, 2] - mean_px == pytest.approx((varied_px[2, 2] - mean_px) / 2, abs=1e-3)


def confidence_of(
    disparity_px: float,
    kind: PixelClass = PixelClass.MEASURED,
    weight: int = WEIGHT_UNIT,
    probability: float = 1.0,
    *,
    error_growth: float = 1.0,
    roughness_px: float = 0.1,
) -> float:
    """The confidence of one pixel; only a fill has a probability below 1."""
    numbers = (np.full((1, 1), value, np.float32) for value in (error_growth, probability, roughness_px))
    levels = (np.full((1, 1), value, np.uint8) for value in (kind, weight))
    return float(estimate_confidence(np.full((1, 1), disparity_px, np.float32), *levels, *numbers)[0, 0])


class TestConfidence:
    def test_the_odds_are_those_of_the_tables(self) -> None:
        measured = MEASURED_ODDS * 3 * 2 / (0.1 + SENSOR_NOISE_PX)  # three measurements, 5 % of 40 px
        assert confidence_of(40, weight=3 * WEIGHT_UNIT) == pytest.approx(measured / (1 + measured), abs=1e-6)
        q = 0.6 * 2 / (2 + float(FILL_ERROR_PX))
        filled = FILL_ODDS * q / (1 - q) / (0.1 + SENSOR_NOISE_PX)
        fill = confidence_of(40, PixelClass.UNMEASURED, 0, 0.6)
        assert fill == pytest.approx(filled / (1 + filled), abs=1e-6)

    @pytest.mark.parametrize("kind", PixelClass)
    def test_it_grows_with_evidence_and_disparity_and_falls_with_roughness(self, kind: PixelClass) -> None:
        probability = 0.5 if kind is PixelClass.UNMEASURED else 1.0
        by_weight = [confidence_of(20, kind, weight, probability) for weight in range(1, 193)]
        assert (np.diff(by_weight) > 0).all() == (kind is not PixelClass.UNMEASURED)
        by_disparity = [confidence_of(near_px, kind, 64, probability) for near_px in np.linspace(5, 12, 30)]
        assert (np.diff(by_disparity) > 0).all()
        far = [confidence_of(far_px, kind, 64, probability) for far_px in np.linspace(0.1, 5, 30)]
        assert np.ptp(far) == 0  # a quarter of a pixel is 5 % of 5 px
        rough = [confidence_of(20, kind, 64, probability, roughness_px=px) for px in np.linspace(0, 4, 30)]
        assert (np.diff(rough) < 0).all()

    def test_only_a_remembered_disparity_is_less_certain_when_its_error_is_magnified(self) -> None:
        for kind in (PixelClass.FUSED, PixelClass.MEASURED):
            assert confidence_of(20, kind, error_growth=9) == confidence_of(20, kind)
        assert confidence_of(20, PixelClass.REMEMBERED, error_growth=9) < confidence_of(20, PixelClass.REMEMBERED)
        assert 0 < confidence_of(20, PixelClass.REMEMBERED, error_growth=1000) < 0.05

    def test_nothing_is_certain_or_without_any_confidence(self) -> None:
        assert confidence_of(1000, PixelClass.FUSED, 255, roughness_px=0) < 1
        assert confidence_of(0.01, PixelClass.UNMEASURED, 0, 0.01, roughness_px=4) > 0


class TestRoughness:
    def of(self, disparity_px: FloatImage, decimation: int) -> FloatImage:
        resolution = WorkingResolution.of(CAMERA, decimation)
        return roughness(depth_of(WorkingResolution.of(CAMERA, 1), disparity_px), resolution)

    @pytest.mark.parametrize("decimation", [1, 2])
    def test_a_plane_has_none_and_noise_has_its_own(self, decimation: int) -> None:
        row, col = np.mgrid[: CAMERA.height_px, : CAMERA.width_px]
        plane_px = np.asarray(20 + 0.1 * row + 0.05 * col, np.float32)
        assert self.of(plane_px, decimation).max() < 1e-3
        noisy_px = plane_px + np.random.default_rng(0).normal(0, 0.1, CAMERA.shape).astype(np.float32)
        rough_px = self.of(noisy_px, decimation)
        assert rough_px.shape == WorkingResolution.of(CAMERA, decimation).shape
        # The mean of |N(0, 6 s^2)| is s sqrt(12 / pi).
        assert rough_px.mean() == pytest.approx(0.1 * np.sqrt(12 / np.pi), rel=0.05)

    @pytest.mark.parametrize("decimation", [1, 2])
    def test_it_is_that_of_the_place_and_deep_in_a_hole_that_of_the_image(self, decimation: int) -> None:
        half_px = constant(20)
        half_px[:, 80:] += np.random.default_rng(0).normal(0, 0.2, (120, 80)).astype(np.float32)
        rough_px = self.of(half_px, decimation)
        assert rough_px[:, : 60 // decimation].max() < 0.05 < 0.2 < rough_px[:, 100 // decimation :].min()
        half_px[:, :80] = 0
        inside = self.of(half_px, decimation)[:, : 60 // decimation]
        assert inside.min() == pytest.approx(rough_px[:, 100 // decimation :].mean(), rel=0.15)

    @pytest.mark.parametrize("decimation", [1, 2])
    def test_an_image_without_depth_is_smooth(self, decimation: int) -> None:
        assert not self.of(constant(0), decimation).any()


def warp(memory: Memory, forward_warp: ForwardWarp, T_frame_memory: FloatArray) -> Memory:
    """The memory as a new frame sees it, after a motion."""
    return memory.seen_by(forward_warp.warp(memory.disparity_px, memory.weight, T_frame_memory))


@pytest.mark.parametrize("decimation", [1, 2])
@pytest.mark.parametrize("camera", [CAMERA, ODD], ids=["even", "odd"])
def test_a_warped_memory_shows_the_scene_from_the_new_pose(camera: Intrinsics, decimation: int) -> None:
    resolution, there = WorkingResolution.of(camera, decimation), pose(0.1, 0.02, 0.15, yaw=2, roll=1)
    here, now = (measure(frame, resolution) for frame in (frame_of(ROOM, T, camera=camera) for T in (pose(), there)))
    empty = Memory.empty(here.gray)
    memory = empty._replace(disparity_px=here.disparity_px, weight=here.weight)
    warped = warp(memory, ForwardWarp(resolution), inverse_rigid(there))
    known = cv2.erode((warped.weight > 0).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    assert known.mean() > 0.75
    change = abs(warped.gray.astype(int) - now.gray)[known]
    unmoved = abs(here.gray.astype(int) - now.gray)[known]
    assert np.median(change) <= 2 * decimation  # halving blurs, and not twice in the same way
    assert np.median(unmoved) > 10
    assert np.mean(abs(warped.disparity_px - now.disparity_px)[known] < 0.05) > 0.9


@pytest.mark.parametrize("shift_px", [0, 12, -8])
def test_the_drift_is_warped_with_the_memory(shift_px: int) -> None:
    resolution = WorkingResolution.of(CAMERA, 1)
    gray = np.zeros(CAMERA.shape, np.uint8)
    empty = Memory.empty(gray)
    row, col = np.indices(empty.drift_px.shape)
    drift_px = (0.01 * row - 0.02 * col).astype(np.float32)
    memory = empty._replace(
        disparity_px=constant(8), weight=np.full(CAMERA.shape, WEIGHT_UNIT, np.uint8), drift_px=drift_px
    )
    step_m = shift_px / 8 * 0.1  # a step of a baseline shifts by the disparity
    warped = warp(memory, ForwardWarp(resolution), inverse_rigid(pose(step_m)))
    source_col = col + shift_px / DRIFT_DECIMATION
    seen = (source_col >= 0) & (source_col <= col.max())
    np.testing.assert_allclose(warped.drift_px[seen], (0.01 * row - 0.02 * source_col)[seen], atol=1e-5)


@pytest.mark.parametrize("shift_px", [0, 12, -8])
def test_ages_and_looks_are_warped_with_their_surfaces(shift_px: int) -> None:
    row, col = np.indices(CAMERA.shape)
    age, gray = ((3 * row + col) % 251).astype(np.uint8), ((row + 5 * col) % 256).astype(np.uint8)
    known = np.full(CAMERA.shape, WEIGHT_UNIT, np.uint8)
    seen_px = (2 + row + 0.1 * col).astype(np.float32)
    memory = Memory.empty(gray)._replace(disparity_px=constant(8), weight=known, age=age, seen_px=seen_px)
    step_m = shift_px / 8 * 0.1  # a step of a baseline shifts by the disparity
    warped = warp(memory, ForwardWarp(WorkingResolution.of(CAMERA, 1)), inverse_rigid(pose(step_m)))
    seen = (col + shift_px >= 0) & (col + shift_px < CAMERA.width_px)
    for image, of in ((warped.age, age), (warped.gray, gray), (warped.seen_px, seen_px)):
        np.testing.assert_array_equal(image[seen], np.roll(of, -shift_px, axis=1)[seen])


def test_what_is_nearer_than_any_sensor_sees_is_invalid() -> None:
    nearest_m = CAMERA.fx_px * 0.1 / MAX_DISPARITY_PX
    depth_m = np.array([[0.2, 0.5, 0.9, 1.1]], np.float32) * np.float32(nearest_m)
    disparity_px = WorkingResolution.of(CAMERA, 1).disparity(depth_m)
    np.testing.assert_allclose(disparity_px, [[0, 0, 0, MAX_DISPARITY_PX / 1.1]], rtol=1e-5)


@pytest.mark.parametrize(("width", "height"), [(160, 120), (161, 119), (33, 25)])
def test_a_pixel_of_half_size_looks_between_its_four(width: int, height: int) -> None:
    middle = {"cx_px": 0.44 * width, "cy_px": 0.51 * height}
    camera = Intrinsics(fx_px=100, fy_px=90, width_px=width, height_px=height, **middle)
    full, half = WorkingResolution.of(camera, 1), WorkingResolution.of(camera, 2)
    assert half.shape == (height // 2, width // 2)
    for row, col in ((0, 0), (3, 5), (11, 15)):
        ray = np.linalg.solve(half.K, [col, row, 1])
        np.testing.assert_allclose(full.K @ ray, [2 * col + 0.5, 2 * row + 0.5, 1])


def test_large_images_are_remembered_at_half_their_size() -> None:
    largest_px = MAX_FULL_RESOLUTION_PX // 400
    for width_px, height_px, decimation in (
        (160, 120, 1), (400, largest_px, 1), (400, largest_px + 1, 2), (640, 360, 2), (1024, 1024, 2),
    ):  # fmt: skip
        camera = Intrinsics.from_hfov(width_px=width_px, height_px=height_px, hfov_deg=70)
        assert default_decimation(camera) == decimation, f"{width_px} x {height_px}"


def address(image: np.ndarray) -> int:
    return int(image.__array_interface__["data"][0])


def test_memory_is_used_again_when_nobody_holds_the_image_or_a_part_of_it() -> None:
    pool = ImagePool((3, 5), np.uint8)
    image = pool.image()
    before = address(image)
    del image
    assert address(pool.image()) == before
    part = pool.image()[1:, ::2].T.view(np.int8)
    buffer = memoryview(pool.image()).cast("B")
    held = pool.image()
    held[...], part[...] = 1, 2
    for _ in range(10):
        pool.image()[...] = 3
    assert (held == 1).all() and (part == 2).all()
    assert len(buffer) == 15 and set(buffer) != {3}
