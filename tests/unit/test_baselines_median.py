"""The median baseline against a slow reference."""

import numpy as np

from tests.baseline_frames import frame, holed
from voxdepth.baselines.single_frame import Median
from voxdepth.types import Source


def test_it_is_the_median_of_the_window_with_holes_as_zeros_and_repeated_borders() -> None:
    depth_m = holed(np.random.default_rng(0).uniform(1, 20, (13, 17)).astype(np.float32), share=0.3)
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(depth_m, 2, "edge"), (5, 5))
    expected = np.median(windows, axis=(2, 3))
    np.testing.assert_array_equal(Median().process(frame(depth_m)).depth_m, expected)


def test_a_pixel_says_where_its_depth_comes_from() -> None:
    depth_m = np.zeros((7, 14), np.float32)
    depth_m[:, :7] = 2
    depth_m[3, 3] = 0
    depth_m[3, 11] = 5
    result = Median().process(frame(depth_m))
    assert result.source[3, 3] == Source.INPAINTED and result.confidence[3, 3] == 0.5
    assert result.source[3, 11] == Source.INVALID and result.confidence[3, 11] == 0
    assert result.source[3, 1] == Source.SENSOR and result.confidence[3, 1] == 1
    assert result.diagnostics is None
