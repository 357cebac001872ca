"""Laws of the default method as a whole."""

from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np
import pytest

from tests.temporal_scenes import CAMERA, ROOM, frames_of, method, noisy, run, walk
from voxdepth import TemporalCorrector
from voxdepth.errors import ConfigError
from voxdepth.temporal.odometry import TrackingStatus
from voxdepth.temporal.working_resolution import MIN_SIDE_PX, WorkingResolution
from voxdepth.types import CorrectedDepth, FloatImage, Frame, Intrinsics, MaskImage, Source

DECIMATIONS = pytest.mark.parametrize("decimation", [1, 2])
ODD = Intrinsics.from_hfov(width_px=161, height_px=119, hfov_deg=70, baseline_m=0.1)
FOCAL_BASELINE = CAMERA.fx_px * 0.1
CLEAN = frames_of(ROOM, walk(8))
NOISY = [noisy(frame, 0) for frame in CLEAN]


def assert_well_formed(result: CorrectedDepth, camera: Intrinsics = CAMERA) -> None:
    """Check what holds for every result."""
    assert result.depth_m.shape == result.source.shape == result.confidence.shape == camera.shape
    assert (result.depth_m.dtype, result.source.dtype, result.confidence.dtype) == (np.float32, np.uint8, np.float32)
    assert np.isfinite(result.depth_m).all()
    assert (result.depth_m >= 0).all()
    assert result.confidence.min() >= 0
    assert result.confidence.max() <= 1
    np.testing.assert_array_equal(result.source == Source.INVALID, result.depth_m == 0)
    np.testing.assert_array_equal(result.confidence == 0, result.depth_m == 0)


def disparity_error_px(result: CorrectedDepth, frame: Frame) -> FloatImage:
    return np.asarray(abs(FOCAL_BASELINE / result.depth_m - FOCAL_BASELINE / frame.depth_m), np.float32)


def flat(frame: Frame, reach_px: int) -> MaskImage:
    """Pixels inside of the image whose surroundings have a linear disparity."""
    disparity_px = WorkingResolution.of(CAMERA, 1).disparity(frame.depth_m)
    bent_px = abs(cv2.Laplacian(disparity_px, cv2.CV_32F))
    window = np.ones((2 * reach_px + 1, 2 * reach_px + 1), np.uint8)
    inside = np.zeros(CAMERA.shape, bool)
    inside[2 * reach_px : -2 * reach_px, 2 * reach_px : -2 * reach_px] = True
    return inside & ~(cv2.dilate((bent_px > 0.001).astype(np.uint8), window) > 0)


@pytest.fixture
def usual_threads() -> Iterator[None]:
    before = cv2.getNumThreads()
    yield
    cv2.setNumThreads(before)


class TestNothingToCorrect:
    def test_a_still_camera_without_noise_gets_back_what_it_measured(self) -> None:
        still = [replace(CLEAN[0], stamp_s=float(i)) for i in range(4)]
        for result in run(method(decimation=1, smoothing_window_px=1), still):
            assert disparity_error_px(result, CLEAN[0]).max() < 2**-14  # disparities move in steps of that
            assert (result.source == Source.SENSOR).all()

    @DECIMATIONS
    def test_a_moving_camera_without_noise_gets_back_what_it_measured(self, decimation: int) -> None:
        for frame, result in zip(CLEAN, run(method(decimation=decimation), CLEAN), strict=True):
            error_px = disparity_error_px(result, frame)
            assert np.percentile(error_px, [50, 90]) == pytest.approx([0, 0], abs=0.1)
            assert error_px[flat(frame, 3 * decimation)].max() < 0.01
            assert_well_formed(result)


class TestNoise:
    @DECIMATIONS
    def test_it_brings_back_what_noise_has_hidden_and_names_the_sensor_only_where_it_measured(
        self, decimation: int
    ) -> None:
        result = run(method(decimation=decimation), NOISY)[-1]
        measured = NOISY[-1].depth_m > 0
        assert measured[result.source == Source.SENSOR].all()
        raw_px = abs(FOCAL_BASELINE / np.where(measured, NOISY[-1].depth_m, 1) - FOCAL_BASELINE / CLEAN[-1].depth_m)
        error_px = disparity_error_px(result, CLEAN[-1])
        assert np.median(error_px[measured]) < 0.5 * np.median(raw_px[measured])
        known = result.source == Source.MEMORY
        # At half resolution the borders of holes, half of their pixels here, have the source of their neighbours.
        assert np.mean(known[~measured]) > (0.9 if decimation == 1 else 0.6)
        assert np.median(error_px[known]) < 0.1

    @DECIMATIONS
    def test_without_filling_only_what_is_known_has_a_depth(self, decimation: int) -> None:
        filled, bare = (run(method(decimation=decimation, fill=fill), NOISY) for fill in ("all", "none"))
        assert [result.source.tobytes() for result in bare] != [result.source.tobytes() for result in filled]
        for full, result in zip(filled, bare, strict=True):
            assert set(np.unique(result.source)) <= {Source.INVALID, Source.SENSOR, Source.MEMORY}
            np.testing.assert_array_equal(result.source == Source.INVALID, full.source == Source.INPAINTED)
            known = result.source != Source.INVALID
            np.testing.assert_array_equal(result.depth_m[known], full.depth_m[known])

    @pytest.mark.parametrize("frames", [1, 3])
    def test_what_is_missing_beside_measured_pixels_is_of_the_memory_or_a_guess(self, frames: int) -> None:
        missing = np.zeros(CAMERA.shape, bool)
        missing[::6, ::6] = True  # one pixel of the four that one of the memory stands for
        depth_m = np.where(missing, np.float32(0), CLEAN[0].depth_m)
        still = [replace(CLEAN[0], depth_m=depth_m, stamp_s=float(i)) for i in range(frames)]
        source = run(method(decimation=2), still)[-1].source
        assert (source[~missing] == Source.SENSOR).all()
        of_memory = np.mean(source[missing] == Source.MEMORY)
        assert np.isin(source[missing], [Source.MEMORY, Source.INPAINTED]).all()
        assert of_memory == 0 if frames == 1 else of_memory > 0.9


class TestSymmetries:
    @DECIMATIONS
    @pytest.mark.parametrize("scale", [0.5, 4.0])  # powers of two, which round nothing otherwise
    def test_a_larger_world_seen_by_a_larger_camera_is_larger(self, scale: float, decimation: int) -> None:
        larger = replace(CAMERA, baseline_m=0.1 * scale)
        grown = [replace(frame, depth_m=frame.depth_m * np.float32(scale)) for frame in NOISY]
        ours, theirs = run(method(decimation=decimation), NOISY), run(method(larger, decimation=decimation), grown)
        for one, other in zip(ours, theirs, strict=True):
            np.testing.assert_allclose(other.depth_m / scale, one.depth_m, rtol=1e-4)
            np.testing.assert_array_equal(one.source, other.source)
            np.testing.assert_allclose(one.confidence, other.confidence, atol=1e-4)

    @DECIMATIONS
    @pytest.mark.parametrize("width_px", [160, 168])
    def test_a_mirrored_world_gives_the_mirrored_result(self, width_px: int, decimation: int) -> None:
        # 168 px are ten cells and a half: other corners are tracked in the mirror, so poses differ a little.
        camera = Intrinsics(
            fx_px=115, fy_px=115, cx_px=70, cy_px=59.5, width_px=width_px, height_px=120, baseline_m=0.1
        )
        mirrored = replace(camera, cx_px=width_px - 1 - camera.cx_px)
        frames = [noisy(frame, 0, camera=camera) for frame in frames_of(ROOM, walk(8), camera)]
        flipped = [replace(frame, gray=_flipped(frame.gray), depth_m=_flipped(frame.depth_m)) for frame in frames]
        ours = run(method(camera, decimation=decimation), frames)
        theirs = run(method(mirrored, decimation=decimation), flipped)
        for one, other in zip(ours, theirs, strict=True):
            assert np.mean(one.source == _flipped(other.source)) > 0.998  # fills at the bound of what is shown
            both = (one.depth_m > 0) & (_flipped(other.depth_m) > 0)
            difference_px = abs(11.5 / one.depth_m[both] - 11.5 / _flipped(other.depth_m)[both])
            assert np.percentile(difference_px, 98) < (0.002 if width_px == 160 else 0.02)
            assert np.mean(difference_px > 0.3) < (1e-4 if width_px == 160 else 5e-4)  # one pixel may tip

    @DECIMATIONS
    def test_the_number_of_threads_does_not_matter(self, decimation: int, usual_threads: None) -> None:
        streams = []
        for threads in (1, 2):
            cv2.setNumThreads(threads)
            streams.append(run(method(decimation=decimation), NOISY))
        for one, other in zip(*streams, strict=True):
            assert _bytes(one) == _bytes(other)


def _flipped(image: FloatImage) -> FloatImage:
    return np.ascontiguousarray(image[:, ::-1])


def _bytes(result: CorrectedDepth) -> tuple[bytes, ...]:
    arrays = (result.depth_m, result.source, result.confidence, result.diagnostics.T_frame_keyframe)
    return tuple(b"" if array is None else array.tobytes() for array in arrays)


class TestArrays:
    def test_what_it_says_of_the_first_and_the_next_frame(self) -> None:
        first, second = run(method(), NOISY[:2])
        assert first.diagnostics.facts() == {"tracking": "first_frame", "n_tracks": 0, "n_inliers": 0}
        assert first.diagnostics.T_frame_keyframe is None
        assert second.diagnostics.status is TrackingStatus.OK
        assert second.diagnostics.n_inliers > 40
        assert 0 < second.diagnostics.facts()["residual_px"] < 1
        assert second.diagnostics.T_frame_keyframe is not None
        np.testing.assert_allclose(second.diagnostics.T_frame_keyframe, np.linalg.inv(walk(2)[1]), atol=0.005)
        assert {"measure", "track", "warp", "fuse", "fill", "remember"} <= set(second.timings_s)


class TestSizes:
    SIZES = ((161, 119), (33, 25), (15, 9), (64, 8), (8, 8))

    @DECIMATIONS
    @pytest.mark.parametrize("baseline_m", [0.1, None])
    @pytest.mark.parametrize(("width_px", "height_px"), SIZES)
    def test_any_size_is_corrected(
        self, width_px: int, height_px: int, baseline_m: float | None, decimation: int
    ) -> None:
        camera = Intrinsics.from_hfov(width_px=width_px, height_px=height_px, hfov_deg=70, baseline_m=baseline_m)
        frames = frames_of(ROOM, walk(5), camera)
        holed = [_with_a_hole(frame) for frame in frames]
        corrector = method(camera, decimation=decimation, smoothing_window_px=1)
        for frame, result in zip(frames, run(corrector, holed), strict=True):
            assert_well_formed(result, camera)
            assert (result.depth_m > 0).all()
            assert np.median(abs(result.depth_m / frame.depth_m - 1)) < 0.01
        assert (result.diagnostics.status is TrackingStatus.OK) == (
            width_px == 161
        )  # twelve corners, one in each cell of 16 px, are needed

    @pytest.mark.parametrize(("width_px", "height_px"), [(7, 8), (8, 7)])
    def test_too_small_images_are_refused(self, width_px: int, height_px: int) -> None:
        camera = Intrinsics.from_hfov(width_px=width_px, height_px=height_px, hfov_deg=70, baseline_m=0.1)
        assert MIN_SIDE_PX == 8
        with pytest.raises(ConfigError, match=f"at least 8x8 pixels, got {width_px}x{height_px}"):
            method(camera)


def _with_a_hole(frame: Frame) -> Frame:
    depth_m = frame.depth_m.copy()
    depth_m[1:3, 2:4] = 0
    return replace(frame, depth_m=depth_m)


@pytest.mark.parametrize(("scale", "is_kept"), [(1.0, False), (3.0, True)])
def test_a_thin_pole_in_decimated_depth_is_kept_if_the_camera_says_how_it_was_matched(
    scale: float, is_kept: bool
) -> None:
    """A pole of 2 px moves 0.6 px of disparity before a wall: the noise of matched pixels, or two of decimated ones."""
    camera = replace(
        Intrinsics.from_hfov(width_px=160, height_px=90, hfov_deg=86, baseline_m=0.1), disparity_scale=scale
    )
    fB, rng = camera.fx_px * 0.1, np.random.default_rng(0)
    wall, pole = rng.integers(60, 200, camera.shape, np.uint8), rng.integers(20, 60, (90, 2), np.uint8)
    corrector = TemporalCorrector(camera)
    for k in range(10):
        columns = slice(100 - 2 * k, 102 - 2 * k)
        disparity_px, gray = np.full(camera.shape, 0.6), wall.copy()
        disparity_px[:, columns], gray[:, columns] = 1.2, pole
        depth_m = (fB / (disparity_px + rng.normal(0, 0.05, camera.shape))).astype(np.float32)
        shown_m = corrector.process(Frame(stamp_s=k / 10, gray=gray, depth_m=depth_m)).depth_m[:, columns]
    assert np.mean(np.abs(shown_m * 1.2 / fB - 1) < 0.2) == pytest.approx(float(is_kept), abs=0.05)
