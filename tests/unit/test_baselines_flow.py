"""Dense optical flow, and what lies where the pixels flow to."""

import numpy as np
import pytest

from tests.baseline_frames import texture
from voxdepth.baselines.learned import Dis, landing_of, taken

SHAPE = (96, 128)
INSIDE = (slice(16, -16), slice(16, -16))


def test_an_image_flows_nowhere_to_itself() -> None:
    image = texture(0, SHAPE)
    assert np.abs(Dis().between(image, image.copy())[INSIDE]).max() < 1e-3


@pytest.mark.parametrize(("down", "right"), [(0, 2), (2, -1)])
def test_a_shifted_image_flows_by_the_shift(down: int, right: int) -> None:
    large = texture(1, (SHAPE[0] + 16, SHAPE[1] + 16))
    start = large[8:-8, 8:-8]
    end = large[8 - down : -8 - down, 8 - right : -8 - right]
    flow_px = Dis().between(start, end)
    error_px = np.hypot(flow_px[..., 0] - right, flow_px[..., 1] - down)[INSIDE]
    assert np.median(error_px) < 0.6, "the preset works on a quarter of the pixels"
    assert np.mean(error_px < 1) > 0.9


def test_small_images_flow_too() -> None:
    assert Dis().between(*[np.full((7, 300), 9, np.uint8)] * 2).shape == (7, 300, 2)


def test_pixels_are_taken_from_where_they_flow_and_none_from_outside() -> None:
    depth_m = np.arange(1, 13, dtype=np.float32).reshape(3, 4)
    flow_px = np.zeros((3, 4, 2), np.float32)
    flow_px[..., 0] = 1.3
    np.testing.assert_array_equal(taken(depth_m, landing_of(flow_px)), np.pad(depth_m[:, 1:], ((0, 0), (0, 1))))
    for far_px in (1e9, -1e9):
        assert not taken(depth_m, landing_of(np.full_like(flow_px, far_px))).any()
