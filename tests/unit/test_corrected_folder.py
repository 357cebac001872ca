"""How depth and confidence are stored."""

import numpy as np

from scenarios.corrected_folder import to_gray, to_millimetres


def test_depth_is_stored_in_millimetres_and_stays_valid_or_invalid() -> None:
    depth_m = np.array([[0, 1e-5, 0.0004, 1.2344, 1.2346, 65.535, 65.6, 3e38]], np.float32)
    stored = to_millimetres(depth_m)
    assert stored.dtype == np.uint16
    assert stored.tolist() == [[0, 1, 1, 1234, 1235, 65535, 65535, 65535]]


def test_confidence_is_stored_from_none_to_full() -> None:
    assert to_gray(np.array([[0, 0.5, 0.999, 1]], np.float32)).tolist() == [[0, 128, 255, 255]]
