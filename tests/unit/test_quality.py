"""Figures of depth quality on images whose figures are known."""

import numpy as np
import pytest

from sim.quality import DepthQuality
from sim.types import Capture, InvalidReason
from tests.helpers import CAMERA

FOCAL_BASELINE = CAMERA.fx_px * 0.095


def capture(true_m: object, raw_m: object, **fields: object) -> Capture:
    shape = CAMERA.shape
    full = lambda value, kind: np.broadcast_to(np.asarray(value, kind), shape).copy()  # noqa: E731
    return Capture(
        stamp_s=0.0,
        drone=0,
        gray_left=full(0, np.uint8),
        gray_right=None,
        depth_true_m=full(true_m, np.float32),
        depth_raw_m=full(raw_m, np.float32),
        occluded=full(fields.get("occluded", False), np.bool_),
        invalid_reason=full(fields.get("invalid_reason", 0), np.uint8),
        segment_id=full(fields.get("segment_id", 0), np.int32),
        T_world_cam=np.eye(4),
        intrinsics=CAMERA,
    )


def test_exact_depth_has_no_faults() -> None:
    quality = DepthQuality(ranges_m=(1, 5, 10))
    quality.add(capture(3.0, 3.0))
    assert quality.pixels == [CAMERA.width_px * CAMERA.height_px, 0]
    assert quality.hole_shares == [0, None]
    assert quality.within_1_px_shares == [1, None]
    assert quality.median_errors_px == [pytest.approx(0, abs=0.01), None]
    assert quality.unmatchable_shares("occluded") == (None, None)


def test_errors_are_told_by_range_in_pixels_of_disparity() -> None:
    near = np.arange(CAMERA.width_px) < 80
    true_m = np.where(near, 3.0, 8.0)
    off_px = np.where(near, 0.4, 1.7)
    quality = DepthQuality(ranges_m=(1, 5, 10))
    quality.add(capture(true_m, FOCAL_BASELINE / (FOCAL_BASELINE / true_m + off_px)))
    assert quality.median_errors_px == [pytest.approx(0.4, abs=0.011), pytest.approx(1.7, abs=0.011)]
    assert quality.within_1_px_shares == [1, 0]


def test_holes_count_as_not_within_a_pixel_and_captures_add_up() -> None:
    quality = DepthQuality(ranges_m=(1, 5))
    quality.add(
        capture(3.0, np.where(np.arange(CAMERA.width_px) < 40, 0.0, 3.0), invalid_reason=InvalidReason.TEXTURELESS)
    )
    assert quality.hole_shares == [0.25]
    assert quality.within_1_px_shares == [0.75]
    assert quality.invalid_shares[InvalidReason.TEXTURELESS] == 1
    quality.add(capture(3.0, 3.0))
    assert quality.hole_shares == [0.125]
    assert quality.invalid_shares[InvalidReason.TEXTURELESS] == 0.5


def test_occluded_and_textureless_pixels_are_counted_separately() -> None:
    col = np.arange(CAMERA.width_px)
    raw_m = np.select([col < 20, col < 40, col < 80], [0.0, 3.2, 3.0], 3.0)
    fields = {"occluded": col < 80, "segment_id": np.where(col >= 120, 7, 0)}
    quality = DepthQuality(textureless_ids=[7], ranges_m=(1, 5))
    quality.add(capture(3.0, raw_m, **fields))
    assert quality.unmatchable_shares("occluded") == (0.25, 0.25), "20 of 80 columns are holes, 20 are 6.7 % off"
    assert quality.unmatchable_shares("textureless") == (0, 0)
    assert quality.pixels == [40 * CAMERA.height_px]


def test_what_has_no_surface_or_is_out_of_the_ranges_does_not_count() -> None:
    quality = DepthQuality(ranges_m=(1, 5))
    quality.add(capture(np.where(np.arange(CAMERA.width_px) < 80, np.inf, 9.0), 0.0))
    assert quality.pixels == [0]
    assert quality.hole_shares == [None]
