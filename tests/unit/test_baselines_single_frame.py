"""The median, and OpenCV's inpainting on 16-bit inverse depth."""

import numpy as np
import pytest

from tests.baseline_frames import frame, holed
from voxdepth.baselines.single_frame import INPAINTING, InpaintingName, Median, OpenCvInpaint
from voxdepth.errors import ConfigError
from voxdepth.types import Source


def test_it_is_the_median_of_the_window_with_holes_as_zeros_and_repeated_borders() -> None:
    depth_m = holed(np.random.default_rng(0).uniform(1, 20, (13, 17)).astype(np.float32), share=0.3)
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(depth_m, 2, "edge"), (5, 5))
    expected = np.median(windows, axis=(2, 3))
    np.testing.assert_array_equal(Median().process(frame(depth_m)).depth_m, expected)


def filled(depth_m: np.ndarray, method: InpaintingName) -> np.ndarray:
    return OpenCvInpaint(method=method).process(frame(depth_m)).depth_m


@pytest.mark.parametrize("method", INPAINTING)
def test_a_hole_in_a_plane_of_even_disparity_is_filled_within_a_few_percent(method: InpaintingName) -> None:
    inverse = np.broadcast_to(np.linspace(0.1, 0.3, 60), (40, 60))
    depth_m = (1 / inverse).astype(np.float32)
    depth_m[15:22, 25:32] = 0
    error = filled(depth_m, method)[15:22, 25:32] * inverse[15:22, 25:32] - 1
    assert np.abs(error).max() < 0.04
    assert np.abs(error).mean() < 0.02


@pytest.mark.parametrize("method", INPAINTING)
@pytest.mark.parametrize("depth", [0.75, 19.99, 150.0])
def test_a_filled_pixel_is_right_within_two_steps_of_16_bits(method: InpaintingName, depth: float) -> None:
    depth_m = np.full((20, 20), depth, np.float32)
    depth_m[8:12, 8:12] = 0
    depth_m[0, 0] = 0.5
    step_m = depth**2 / (0.5 * 65535)
    np.testing.assert_allclose(filled(depth_m, method)[8:12, 8:12], depth, atol=2.5 * step_m)


@pytest.mark.parametrize("method", INPAINTING)
def test_one_speck_before_the_lens_does_not_coarsen_the_rest(method: InpaintingName) -> None:
    depth_m = np.full((20, 20), 10.0, np.float32)
    depth_m[8:12, 8:12] = 0
    depth_m[0, 0] = 1e-6
    result = filled(depth_m, method)
    np.testing.assert_allclose(result[8:12, 8:12], 10.0, atol=0.04)
    assert result[0, 0] == np.float32(1e-6)


@pytest.mark.parametrize("method", INPAINTING)
def test_no_hole_is_left_not_even_at_the_border(method: InpaintingName) -> None:
    depth_m = np.zeros((50, 70), np.float32)
    depth_m[20:30, 30:40] = 6.0
    result = OpenCvInpaint(method=method).process(frame(depth_m))
    np.testing.assert_allclose(result.depth_m, 6.0, rtol=1e-4)
    assert (result.source == Source.INPAINTED).sum() == 50 * 70 - 100


@pytest.mark.parametrize("method", INPAINTING)
@pytest.mark.parametrize("shape", [(1, 9), (9, 1)])
def test_a_single_row_or_column_gives_the_same_bytes_whatever_memory_held(
    method: InpaintingName, shape: tuple[int, int]
) -> None:
    rng = np.random.default_rng(0)
    for _ in range(5):
        depth_m = np.where(rng.random(shape) < 0.35, rng.uniform(1, 40, shape), 0).astype(np.float32)
        results = set()
        for _ in range(50):
            freed = [np.full(rng.integers(1, 200), rng.integers(0, 255), np.uint8) for _ in range(10)]
            del freed
            results.add(filled(depth_m, method).tobytes())
        assert len(results) == 1


def test_an_unknown_method_is_refused() -> None:
    with pytest.raises(ConfigError, match="telea, navier_stokes, got 'magic'"):
        OpenCvInpaint(method="magic")  # type: ignore[arg-type]
