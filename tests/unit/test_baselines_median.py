"""The median baseline, by its laws and against a slow reference."""

import numpy as np
import pytest

from voxdepth.baselines.single_frame import Median
from voxdepth.errors import ConfigError
from voxdepth.types import Frame, Source


def frame_of(depth_m: object) -> Frame:
    image = np.array(depth_m, np.float32)
    return Frame(stamp_s=0.0, gray=np.zeros(image.shape, np.uint8), depth_m=image)


def holed(seed: int, shape: tuple[int, int] = (13, 17), holes: float = 0.3) -> np.ndarray:
    rng = np.random.default_rng(seed)
    depth_m = rng.uniform(1, 20, shape).astype(np.float32)
    depth_m[rng.random(shape) < holes] = 0
    return depth_m


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (3, 200), (120, 160)])
def test_a_constant_image_stays_constant(shape: tuple[int, int]) -> None:
    result = Median().process(frame_of(np.full(shape, 3.5)))
    np.testing.assert_array_equal(result.depth_m, np.full(shape, 3.5, np.float32))
    assert (result.source == Source.SENSOR).all() and (result.confidence == 1).all()


def test_a_scale_commutes() -> None:
    depth_m = holed(0)
    once, twice = (Median().process(frame_of(k * depth_m)).depth_m for k in (1, 2))
    np.testing.assert_array_equal(2 * once, twice)


def test_an_invalid_frame_stays_invalid() -> None:
    result = Median().process(frame_of(np.zeros((6, 8))))
    assert not result.depth_m.any() and not result.source.any() and not result.confidence.any()


@pytest.mark.parametrize("size_px", [3, 5])
def test_it_is_the_median_of_the_window_with_holes_as_zeros_and_repeated_borders(size_px: int) -> None:
    depth_m = holed(1)
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(depth_m, size_px // 2, "edge"), (size_px, size_px))
    expected = np.median(windows, axis=(2, 3))
    np.testing.assert_array_equal(Median(size_px=size_px).process(frame_of(depth_m)).depth_m, expected)


def test_a_pixel_says_where_its_depth_comes_from() -> None:
    depth_m = np.zeros((7, 14), np.float32)
    depth_m[:, :7] = 2
    depth_m[3, 3] = 0
    depth_m[3, 11] = 5
    result = Median().process(frame_of(depth_m))
    assert result.source[3, 3] == Source.INPAINTED and result.confidence[3, 3] == 0.5
    assert result.source[3, 11] == Source.INVALID and result.confidence[3, 11] == 0
    assert result.source[3, 1] == Source.SENSOR and result.confidence[3, 1] == 1
    assert result.diagnostics is None


def test_the_frame_is_not_changed_and_the_result_has_its_own_arrays() -> None:
    frame = frame_of(holed(2))
    before = frame.depth_m.copy()
    result = Median().process(frame)
    assert result.depth_m.dtype == result.confidence.dtype == np.float32 and result.source.dtype == np.uint8
    result.depth_m[:] = -1
    np.testing.assert_array_equal(frame.depth_m, before)


def test_windows_of_other_widths_are_refused() -> None:
    with pytest.raises(ConfigError, match="3 or 5, got 4"):
        Median(size_px=4)  # type: ignore[arg-type]
