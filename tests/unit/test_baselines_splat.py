"""The oracle that knows the true pose."""

import numpy as np
import pytest

from tests.baseline_frames import POSE, camera, frame, scene
from voxdepth.baselines.pose_splat import FRAMES, PoseSplat
from voxdepth.errors import FrameError
from voxdepth.types import FloatArray, Source

SHAPE = (30, 40)
EMPTY = np.zeros(SHAPE, np.float32)


def at(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> FloatArray:
    """The pose of a camera that was moved and not turned."""
    T = np.eye(4)
    T[:3, 3] = x, y, z
    return T


def test_a_standing_camera_fills_what_it_once_measured() -> None:
    baseline, depth_m = PoseSplat(camera(SHAPE)), scene(0, SHAPE)
    baseline.process(frame(depth_m))
    result = baseline.process(frame(EMPTY, index=1))
    np.testing.assert_allclose(result.depth_m, depth_m, rtol=1e-6)
    assert (result.source[depth_m > 0] == Source.INPAINTED).all()


def test_a_wall_moves_by_the_parallax_of_its_depth() -> None:
    depth_m = np.zeros(SHAPE, np.float32)
    depth_m[10, 20], depth_m[20, 20] = 4.0, 8.0
    baseline = PoseSplat(camera(SHAPE, focal_px=80.0))
    baseline.process(frame(depth_m))
    result = baseline.process(frame(EMPTY, index=1, T_world_cam=at(x=0.5)))  # 80 px * 0.5 m / z
    assert set(zip(*np.nonzero(result.depth_m), strict=True)) == {(10, 10), (20, 15)}
    np.testing.assert_allclose(result.depth_m[[10, 20], [10, 15]], [4.0, 8.0])


def test_coming_nearer_lowers_the_depth_and_spreads_from_the_principal_point() -> None:
    depth_m = np.zeros(SHAPE, np.float32)
    depth_m[14, 29] = 4.0  # ten pixels right of the principal point (19, 14)
    baseline = PoseSplat(camera(SHAPE))
    baseline.process(frame(depth_m))
    result = baseline.process(frame(EMPTY, index=1, T_world_cam=at(z=2.0)))
    np.testing.assert_allclose(result.depth_m[14, 39], 2.0, rtol=1e-6)


def test_nearest_wins_and_of_like_depths_the_newest() -> None:
    depths = (8.0, 3.0, 3.01, 8.0)  # the last one is behind what is remembered
    baseline = PoseSplat(camera((1, 1)))
    for index, depth in enumerate(depths):
        baseline.process(frame(np.full((1, 1), depth, np.float32), index=index))
    result = baseline.process(frame(np.zeros((1, 1), np.float32), index=len(depths)))
    assert result.depth_m.item() == pytest.approx(3.01)


def test_points_are_forgotten_after_so_many_frames() -> None:
    baseline = PoseSplat(camera(SHAPE))
    baseline.process(frame(np.full(SHAPE, 4.0, np.float32)))
    filled = [baseline.process(frame(EMPTY, index=index)).depth_m.any() for index in range(1, FRAMES + 2)]
    assert filled == [True] * FRAMES + [False]


def test_points_do_not_wander_while_they_are_remembered() -> None:
    depth_m = np.zeros(SHAPE, np.float32)
    depth_m[15, 20] = 4.0
    baseline = PoseSplat(camera(SHAPE))
    baseline.process(frame(depth_m))
    for index in range(1, 41):  # 0.4 px a frame, there and back: rounding each of them would go nowhere
        steps = min(index, 40 - index)
        result = baseline.process(frame(EMPTY, index=index, T_world_cam=at(x=-0.02 * steps)))
        assert np.flatnonzero(result.depth_m[15]).tolist() == [round(20 + 0.4 * steps + 1e-6)]


def test_a_frame_without_a_pose_is_refused() -> None:
    with pytest.raises(FrameError, match="true pose T_world_cam"):
        PoseSplat(camera(SHAPE)).process(frame(scene(0, SHAPE), T_world_cam=None))


def test_the_pose_may_be_an_array_that_its_owner_uses_again() -> None:
    pose, baseline = POSE.copy(), PoseSplat(camera(SHAPE))
    baseline.process(frame(scene(0, SHAPE), T_world_cam=pose))
    pose[:3, 3] = 100.0
    result = baseline.process(frame(EMPTY, index=1, T_world_cam=POSE))
    np.testing.assert_allclose(result.depth_m, scene(0, SHAPE), rtol=1e-6)
