"""How far the frames of a recording prove free space."""

import numpy as np
import pytest

from scenarios.free_space import horizons
from swarm.evidence import DISPARITY_ERROR_PX
from tests.evaluation_clips import CAMERA
from voxdepth.types import FloatImage, Frame


class Walls(list[Frame]):
    """A recording in memory: the depth [m] of a wall in front of each frame, with a hole aside of the axis or on it."""

    intrinsics = CAMERA

    def __init__(self, *walls: tuple[float, int]) -> None:
        self.extend(Frame(stamp_s=float(n), gray=GRAY, depth_m=_wall_m(*wall)) for n, wall in enumerate(walls))


GRAY = np.zeros(CAMERA.shape, np.uint8)


def _wall_m(depth_m: float, hole_px: int) -> FloatImage:
    wall_m = np.full(CAMERA.shape, depth_m, np.float32)
    row, col = CAMERA.height_px // 2, CAMERA.width_px // 2
    wall_m[row - hole_px : row + hole_px, col - hole_px : col + hole_px] = 0
    wall_m[:, 0] = 0
    return wall_m


def test_the_horizon_is_the_least_free_range_ahead_and_nothing_is_proven_by_holes() -> None:
    (row,) = horizons(Walls((4.0, 0), (8.0, 0), (16.0, 0)), ["raw"]).rows
    error_m = 8.0 - 8.0 / (1 + 8.0 * DISPARITY_ERROR_PX / CAMERA.focal_baseline_px_m)
    assert row[:2] == ["raw", 100]
    assert row[3] == pytest.approx(8.0 - error_m, rel=0.02)
    assert row[2] < row[3] < row[4]
    (blind,) = horizons(Walls((8.0, 6), (8.0, 6), (8.0, 0)), ["raw"]).rows
    assert blind[1] == pytest.approx(100 / 3)
    assert blind[3] == blind[5] == 0
