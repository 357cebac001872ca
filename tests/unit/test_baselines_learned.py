"""The network as a corrector: its laws, whatever its weights are."""

from collections.abc import Iterator

import numpy as np
import pytest

from tests.baseline_frames import camera, frame, scene, texture
from voxdepth.baselines.learned import interpreted, landing_in, landing_of, next_measured, optical_flow, taken
from voxdepth.errors import ConfigError
from voxdepth.networks import has_runtime
from voxdepth.registry import create_bare
from voxdepth.types import CORRECT_PX, CORRECT_SHARE, CorrectedDepth, Source

pytestmark = pytest.mark.skipif(not has_runtime(), reason="needs the extra learned")

SHAPE = (60, 80)
LARGE = (400, 640)
"""Images that are halved."""


def stream(shape: tuple[int, int] = SHAPE) -> Iterator[CorrectedDepth]:
    corrector = create_bare("learned", camera(shape, focal_px=max(80, shape[1])))
    for index in range(4):
        yield corrector.process(frame(scene(index, shape), texture(0, shape), index=index))


@pytest.mark.parametrize("shape", [(8, 8), SHAPE, (33, 130), LARGE])
def test_every_pixel_gets_a_depth_between_what_was_measured(shape: tuple[int, int]) -> None:
    for index, result in enumerate(stream(shape)):
        seen_m = np.concatenate([scene(k, shape).ravel() for k in range(index + 1)])
        seen_m = seen_m[seen_m > 0]
        assert seen_m.min() * 0.999 <= result.depth_m.min() and result.depth_m.max() <= seen_m.max() * 1.001
        assert ((result.confidence > 0) & (result.confidence <= 1)).all()


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
    disparity, log_scale = np.full((1, 1, 32, 32), 2.0, np.float32), np.full((1, 1, 32, 32), -3.0, np.float32)
    measured_px = np.full((20, 30), 8.0, np.float32)
    result = interpreted(disparity, log_scale, np.float32(4), measured_px, np.zeros_like(measured_px))
    draws = np.random.default_rng(0).laplace(0, np.exp(-3), 200_000)
    right = np.abs(draws) <= max(CORRECT_SHARE, CORRECT_PX / 8)
    np.testing.assert_allclose(result.disparity_px, 8)
    np.testing.assert_allclose(result.confidence, right.mean(), atol=0.005)


@pytest.mark.parametrize(("scale", "shown_px"), [(0.1, 4.0), (0.4, 8.0)])
def test_an_uncertain_prediction_replaces_no_measurement_but_fills_holes(scale: float, shown_px: float) -> None:
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


def test_a_camera_of_too_few_pixels_is_refused() -> None:
    with pytest.raises(ConfigError, match="'learned' needs images of at least 8x8 pixels, got 40x7"):
        create_bare("learned", camera((7, 40)))


def test_small_images_flow_too() -> None:
    assert landing_in(*[np.full((14, 600), 9, np.uint8)] * 2, optical_flow()).shape == (14, 600, 2)


def test_pixels_are_taken_from_where_they_flow_and_none_from_outside() -> None:
    depth_m = np.arange(1, 13, dtype=np.float32).reshape(3, 4)
    flow_px = np.zeros((3, 4, 2), np.float32)
    flow_px[..., 0] = 1.3
    np.testing.assert_array_equal(taken(depth_m, landing_of(flow_px)), np.pad(depth_m[:, 1:], ((0, 0), (0, 1))))
    for far_px in (1e9, -1e9):
        assert not taken(depth_m, landing_of(np.full_like(flow_px, far_px))).any()
