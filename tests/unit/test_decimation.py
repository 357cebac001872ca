"""Captures that are matched at full size and decimated."""

import numpy as np
import pytest
from pydantic import ValidationError

from sim.decimation import decimated, decimated_depth, means
from sim.depth_noise import DepthNoise, Disparity
from sim.render import create_renderer
from sim.sensor import RigConfig
from sim.types import Capture, InvalidReason
from tests.helpers import block, camera_at, captured, wall, world_of

FACTORS = pytest.mark.parametrize("factor", [2, 3, 4, 6])


def seen(config: RigConfig, *, near_m: float | None = None) -> Capture:
    """A wall at 3 m, with a block in front of it if requested."""
    bodies = [wall(3.0), *([] if near_m is None else [block(near_m, 0.5)])]
    config = config.model_copy(update={"mount_forward_m": 0.0})
    return captured(config, *bodies, seed=2, renderer="raster", right=True)


@FACTORS
def test_a_uniform_image_stays_uniform(factor: int) -> None:
    np.testing.assert_array_equal(means(np.full((12, 24), 77, np.uint8), factor), 77)


@FACTORS
@pytest.mark.parametrize("depth", ["truth", "noisy", "stereo"])
def test_a_plane_reads_its_depth(factor: int, depth: str) -> None:
    capture = seen(RigConfig(width_px=480, height_px=240, decimate=factor, depth=depth))
    assert capture.depth_raw_m.shape == capture.gray_left.shape == (240 // factor, 480 // factor)
    np.testing.assert_allclose(capture.depth_true_m, 3.0, atol=1e-4)
    valid = capture.depth_raw_m > 0
    assert valid.mean() > 0.9
    assert np.median(capture.depth_raw_m[valid]) == pytest.approx(3.0, abs=0.05 if depth == "stereo" else 1e-4)


@FACTORS
def test_a_point_is_projected_into_the_block_of_its_pixel(factor: int) -> None:
    full, small = (RigConfig(width_px=480, height_px=240, decimate=by).intrinsics for by in (1, factor))
    x, y = np.random.default_rng(0).uniform(-0.4, 0.4, (2, 200))
    col, row = full.fx_px * x + full.cx_px, full.fy_px * y + full.cy_px
    np.testing.assert_allclose(small.fx_px * x + small.cx_px, (col + 0.5) / factor - 0.5)
    np.testing.assert_allclose(small.fy_px * y + small.cy_px, (row + 0.5) / factor - 0.5)


def test_a_factor_of_one_changes_nothing() -> None:
    capture = seen(RigConfig(), near_m=1.0)
    assert decimated(capture, 1) is capture
    assert RigConfig(decimate=1).model_dump() == RigConfig().model_dump()


def test_the_truth_is_that_of_an_image_of_the_smaller_size() -> None:
    capture = seen(RigConfig(width_px=480, height_px=240, decimate=3), near_m=1.5)
    with world_of(wall(3.0), block(1.5, 0.5)) as world:
        camera = camera_at(0, 0.0475, 0, intrinsics=capture.intrinsics)
        (image,) = create_renderer("raster", world).render([camera])
    np.testing.assert_allclose(capture.depth_true_m, image.depth_m, rtol=1e-5)
    np.testing.assert_array_equal(capture.segment_id, image.segment_id)


@pytest.mark.parametrize(
    ("block_m", "expected_m"),
    [
        ([[0, 1], [4, 0]], 1),
        ([[0, 0], [4, 0]], 4),
        ([[1, 1, 1], [1, 4, 4], [4, 4, 40]], 4),
        ([[0, 9, 0], [0, 5, 0], [7, 0, 6]], 6),
        ([[1, 1, 1, 1], [0, 0, 0, 0], [4, 4, 4, 4], [40, 40, 40, 40]], 15),
        ([[0, 0, 0, 0]] * 4, 0),
    ],
)
def test_depth_is_the_nearer_median_or_the_mean_of_the_valid_pixels(block_m: object, expected_m: float) -> None:
    values_m = np.array(block_m, np.float32)
    np.testing.assert_array_equal(decimated_depth(values_m, len(values_m)), [[expected_m]])


def test_pixels_without_depth_have_a_reason_and_the_others_none() -> None:
    capture = seen(RigConfig(width_px=480, height_px=240, decimate=3), near_m=1.0)
    hole = capture.depth_raw_m == 0
    assert hole.any()
    np.testing.assert_array_equal(hole, capture.invalid_reason != InvalidReason.NONE)


def test_noise_is_that_of_the_full_size() -> None:
    noise = DepthNoise(disparity=Disparity(sigma_px=0.3))
    config = RigConfig(width_px=480, height_px=240, depth="noisy", noise=noise)
    full, small = seen(config), seen(config.model_copy(update={"decimate": 3}))
    np.testing.assert_array_equal(small.depth_raw_m, decimated_depth(full.depth_raw_m, 3))


def test_a_factor_that_leaves_a_remainder_is_refused() -> None:
    with pytest.raises(ValidationError, match="must divide both sides"):
        RigConfig(width_px=320, height_px=180, decimate=3)
