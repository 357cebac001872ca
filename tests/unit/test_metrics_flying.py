"""Flying pixels."""

import numpy as np
import pytest

from voxdepth.errors import FrameError
from voxdepth.metrics import flying_share

TRUE_M = np.where(np.arange(64) < 33, 2.0, 8.0) * np.ones((48, 64), np.float32)
TRUE_M = TRUE_M.astype(np.float32)


def test_the_truth_has_none() -> None:
    share = flying_share(TRUE_M, TRUE_M)
    assert (share.hits, share.of) == (
        0,
        48 // 3,
    )  # a window of three pixels: column 33 of those that are judged is beside the edge


def test_a_depth_between_both_sides_flies() -> None:
    depth_m = TRUE_M.copy()
    depth_m[9:21, 33] = 4
    assert flying_share(depth_m, TRUE_M).hits == 4


def test_far_from_an_edge_nothing_flies() -> None:
    depth_m = TRUE_M.copy()
    depth_m[:, :20] = 4
    assert flying_share(depth_m, TRUE_M).hits == 0


def test_what_is_unknown_does_not_count() -> None:
    depth_m, reference_m = TRUE_M.copy(), TRUE_M.copy()
    depth_m[:24, 32:34], reference_m[24:] = 0, np.nan
    assert flying_share(depth_m, reference_m).of <= 1


def test_another_shape_is_refused() -> None:
    with pytest.raises(FrameError):
        flying_share(TRUE_M, TRUE_M[:10])
