"""Obstacles that are not there: near depth on the sky, and phantoms, counted by hand."""

import numpy as np
import pytest

from voxdepth.errors import FrameError
from voxdepth.metrics import Phantoms, Share, near_share
from voxdepth.types import FloatImage

SHAPE = (20, 40)
TRUTH_M = np.full(SHAPE, 10, np.float32)


def blob(col: int, width: int = 6, depth_m: float = 4) -> FloatImage:
    """A wall at 10 m with a blob of 6 rows that begins in a column."""
    image_m = TRUTH_M.copy()
    image_m[5:11, col : col + width] = depth_m
    return image_m


def count(*images_m: FloatImage, truth_m: FloatImage = TRUTH_M) -> int:
    phantoms = Phantoms()
    for image_m in images_m:
        phantoms.add(image_m, truth_m)
    return phantoms.count


def test_near_depth_on_the_sky_is_counted_and_far_or_no_depth_is_not() -> None:
    truth_m = np.array([[np.inf, np.inf, np.inf, np.inf, 5, 0]], np.float32)
    depth_m = np.array([[19.9, 20, 0, 3, 5, 1]], np.float32)
    assert near_share(depth_m, truth_m, 20) == Share(hits=2, of=4)
    with pytest.raises(FrameError):
        near_share(np.where(depth_m == 3, np.float32(np.nan), depth_m), truth_m, 20)


def test_a_blob_is_a_phantom_after_five_frames_and_counted_once() -> None:
    assert [count(*[blob(3)] * n) for n in (4, 5, 12)] == [0, 1, 1]


def test_a_blob_that_moves_stays_the_same_as_long_as_it_overlaps() -> None:
    assert count(*(blob(3 + 2 * k) for k in range(8))) == 1
    assert count(*(blob(3 + 20 * (k % 2)) for k in range(12))) == 0


def test_a_blob_that_disappears_for_a_frame_begins_again() -> None:
    assert count(*[blob(3)] * 4, TRUTH_M, *[blob(3)] * 4) == 0
    assert count(*[blob(3)] * 5, TRUTH_M, *[blob(3)] * 5) == 2


def test_small_blobs_and_those_at_half_the_depth_are_none() -> None:
    assert count(*[blob(3, width=4)] * 5) == 0
    assert count(*[blob(3, width=5)] * 5) == 1
    assert count(*[blob(3, depth_m=5)] * 5) == 0
    assert count(*[blob(3, depth_m=0)] * 5) == 0
    assert count(*[blob(3)] * 5, truth_m=np.full(SHAPE, np.inf, np.float32)) == 0


def test_a_phantom_that_parts_is_not_counted_again() -> None:
    parted_m = np.minimum(blob(3, width=5), blob(10, width=5))
    assert count(*[blob(3, width=12)] * 5, *[parted_m] * 9) == 1


def test_two_blobs_at_once_are_two() -> None:
    assert count(*[np.minimum(blob(3), blob(20))] * 6) == 2
