"""The network as a corrector: its laws, whatever its weights are."""

from collections.abc import Iterator

import numpy as np
import pytest

from tests.baseline_frames import camera, frame, scene, texture
from voxdepth.baselines.learned import next_measured
from voxdepth.errors import ConfigError, FrameError
from voxdepth.networks import has_runtime
from voxdepth.registry import create_bare
from voxdepth.types import CORRECT_PX, CORRECT_SHARE, CorrectedDepth, Source

pytestmark = pytest.mark.skipif(not has_runtime(), reason="needs the extra learned")

SHAPE = (60, 80)
LARGE = (400, 640)
"""Images that are halved."""


def stream(shape: tuple[int, int] = SHAPE, factor: float = 1.0, frames: int = 4) -> Iterator[CorrectedDepth]:
    corrector = create_bare("learned", camera(shape))
    for index in range(frames):
        depth_m = np.float32(factor) * scene(index, shape)
        yield corrector.process(frame(depth_m, texture(0, shape), index=index))


@pytest.mark.parametrize("shape", [(8, 8), SHAPE, (33, 130), LARGE])
def test_every_pixel_gets_a_depth_between_what_was_measured(shape: tuple[int, int]) -> None:
    for index, result in enumerate(stream(shape)):
        seen_m = np.concatenate([scene(k, shape).ravel() for k in range(index + 1)])
        seen_m = seen_m[seen_m > 0]
        assert seen_m.min() * 0.999 <= result.depth_m.min() and result.depth_m.max() <= seen_m.max() * 1.001
        assert ((result.confidence > 0) & (result.confidence <= 1)).all()


def test_a_constant_stays_constant() -> None:
    corrector = create_bare("learned", camera(SHAPE))
    for index in range(3):
        depth_m = np.where(scene(index, SHAPE) > 0, np.float32(7.25), np.float32(0))
        result = corrector.process(frame(depth_m, texture(0, SHAPE), index=index))
        np.testing.assert_allclose(result.depth_m, 7.25, rtol=1e-5)


def test_a_scene_twice_as_far_is_filled_twice_as_far() -> None:
    near, far = next(stream()), next(stream(factor=2.0))
    np.testing.assert_allclose(far.depth_m, 2 * near.depth_m, rtol=1e-4)


def test_without_any_measurement_there_is_no_depth_and_then_that_of_the_past() -> None:
    corrector = create_bare("learned", camera(SHAPE))
    empty = frame(np.zeros(SHAPE, np.float32), texture(0, SHAPE))
    first = corrector.process(empty)
    assert not first.depth_m.any() and not first.source.any() and not first.confidence.any()
    corrector.process(frame(np.full(SHAPE, 5, np.float32), texture(0, SHAPE), index=1))
    later = corrector.process(frame(np.zeros(SHAPE, np.float32), texture(0, SHAPE), index=2))
    np.testing.assert_allclose(later.depth_m, 5, rtol=1e-5)
    assert set(np.unique(later.source)) <= {Source.MEMORY, Source.INPAINTED}


def test_the_source_tells_measured_pixels_from_others() -> None:
    for index, result in enumerate(stream()):
        np.testing.assert_array_equal(result.source == Source.SENSOR, scene(index, SHAPE) > 0)


def test_the_confidence_is_the_probability_of_a_right_depth_under_the_predicted_scale() -> None:
    from voxdepth.baselines.learned import interpreted

    disparity, log_scale = np.full((1, 1, 32, 32), 2.0, np.float32), np.full((1, 1, 32, 32), -3.0, np.float32)
    measured_px = np.full((20, 30), 8.0, np.float32)
    result = interpreted(disparity, log_scale, np.float32(4), measured_px, np.zeros_like(measured_px))
    draws = np.random.default_rng(0).laplace(0, np.exp(-3), 200_000)
    right = np.abs(draws) <= max(CORRECT_SHARE, CORRECT_PX / 8)
    np.testing.assert_allclose(result.disparity_px, 8)
    np.testing.assert_allclose(result.confidence, right.mean(), atol=0.005)


@pytest.mark.parametrize(("scale", "shown_px"), [(0.1, 4.0), (0.4, 8.0)])
def test_an_uncertain_prediction_replaces_no_measurement_but_fills_holes(scale: float, shown_px: float) -> None:
    from voxdepth.baselines.learned import interpreted

    predicted, log_scale = np.ones((1, 1, 32, 32), np.float32), np.full((1, 1, 32, 32), np.log(scale), np.float32)
    measured_px = np.full((20, 30), 8.0, np.float32)
    measured_px[:, :10], measured_px[:, 10:20] = 0, 2
    result = interpreted(predicted, log_scale, np.float32(4), measured_px, np.zeros_like(measured_px))
    assert (result.disparity_px[:, :10] == 4).all() and (result.disparity_px[:, 20:] == shown_px).all()


def test_the_next_measured_disparities_are_those_of_a_search() -> None:
    rng = np.random.default_rng(3)
    for shape in ((1, 1), (1, 9), (7, 1), (12, 17)):
        image_px = rng.random(shape, np.float32) * (rng.random(shape) < 0.3)
        found_px = next_measured(image_px.astype(np.float32))
        for row, col in np.ndindex(shape):
            line, column = image_px[row], image_px[:, col]
            directions = (line[col::-1], line[col:], column[row::-1], column[row:])
            expected_px = [next((float(value) for value in side if value > 0), 0.0) for side in directions]
            np.testing.assert_array_equal(found_px[:, row, col], np.array(expected_px, np.float32))


def test_the_same_stream_gives_the_same_bytes_and_reset_forgets() -> None:
    first = list(stream())
    corrector = create_bare("learned", camera(SHAPE))
    corrector.process(frame(np.full(SHAPE, 2, np.float32), texture(5, SHAPE)))
    corrector.reset()
    for index, expected in enumerate(first):
        result = corrector.process(frame(scene(index, SHAPE), texture(0, SHAPE), index=index))
        for name in ("depth_m", "source", "confidence"):
            assert getattr(result, name).tobytes() == getattr(expected, name).tobytes()


def test_extreme_depths_do_no_harm() -> None:
    corrector = create_bare("learned", camera(SHAPE))
    for index in range(3):
        depth_m = scene(index, SHAPE)
        depth_m[5:55:4, 5], depth_m[5:55:4, 60] = 1e-42, 3e38
        result = corrector.process(frame(depth_m, texture(0, SHAPE), index=index))
        assert np.isfinite(result.depth_m).all() and np.isfinite(result.confidence).all()


def test_bad_frames_and_small_cameras_are_refused() -> None:
    with pytest.raises(FrameError, match=r"shape \(60, 80\), got \(60, 81\)"):
        create_bare("learned", camera(SHAPE)).process(frame(scene(0, (60, 81))))
    with pytest.raises(ConfigError, match="'learned' needs images of at least 8x8 pixels, got 40x7"):
        create_bare("learned", camera((7, 40)))
