"""Features of an image, and their matches."""

import numpy as np

from voxdepth.features import Features, good_matches


def test_good_matches_are_mutual_and_near() -> None:
    a = np.zeros((3, 4), np.uint64)
    a[1], a[2] = 2**64 - 1, 0xFFFF
    b = a[[2, 0]].copy()
    b[1, 0] |= np.uint64(0b111)  # three bits off
    far = Features(points_px=np.zeros((3, 2), np.float32), descriptors=a)
    near = Features(points_px=np.zeros((2, 2), np.float32), descriptors=b)
    assert [list(side) for side in good_matches(far, near, 20)] == [[0, 2], [1, 0]]
    assert [list(side) for side in good_matches(far, near, 2)] == [[2], [0]]
