"""Frames and cameras refuse what they cannot be."""

import numpy as np
import pytest

from voxdepth import Frame, Intrinsics
from voxdepth.errors import FrameError

GRAY = np.zeros((4, 6), np.uint8)
DEPTH = np.ones((4, 6), np.float32)


@pytest.mark.parametrize(
    ("gray", "depth", "message"),
    [
        (GRAY.astype(np.float32), DEPTH, "gray must be uint8"),
        (np.zeros((4, 6, 3), np.uint8), DEPTH, "gray must be uint8"),
        (GRAY, DEPTH[:, :5], "depth_m must be float32 of shape"),
        (GRAY, (1000 * DEPTH).astype(np.uint16), "see Frame.from_millimetres"),
        (GRAY, np.where(DEPTH > 0, np.nan, DEPTH).astype(np.float32), "replace NaN"),
        (GRAY, -DEPTH, "negative"),
        (GRAY, DEPTH * np.float32(np.inf), "finite"),
        (GRAY[:0], DEPTH[:0], "empty"),
    ],
)
def test_bad_frames_are_refused(gray: np.ndarray, depth: np.ndarray, message: str) -> None:
    with pytest.raises(FrameError, match=message):
        Frame(stamp_s=0.0, gray=gray, depth_m=depth)


def test_intrinsics_from_hfov_see_that_angle() -> None:
    camera = Intrinsics.from_hfov(width_px=640, height_px=360, hfov_deg=86)
    left, right = (-0.5 - camera.cx_px) / camera.fx_px, (639.5 - camera.cx_px) / camera.fx_px
    assert np.isclose(np.degrees(np.arctan(right) - np.arctan(left)), 86)


@pytest.mark.parametrize("bad", [{"hfov_deg": 180.0}, {"hfov_deg": -1.0}, {"width_px": 0}, {"baseline_m": 0.0}])
def test_bad_intrinsics_are_refused(bad: dict[str, float]) -> None:
    with pytest.raises(FrameError):
        Intrinsics.from_hfov(**({"width_px": 64, "height_px": 48, "hfov_deg": 80.0} | bad))  # type: ignore[arg-type]
