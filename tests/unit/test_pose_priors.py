"""Poses that the caller passes with its frames."""

import numpy as np
import pytest

from voxdepth.errors import FrameError
from voxdepth.paper.odometry import Motion, MotionStatus, OdometryConfig, PriorsFirst
from voxdepth.types import Frame

IMAGE = np.zeros((2, 2), np.uint8)


def pose(x: float = 0.0, yaw_deg: float = 0.0) -> np.ndarray:
    c, s = np.cos(np.radians(yaw_deg)), np.sin(np.radians(yaw_deg))
    return np.array([[c, 0, s, x], [0, 1, 0, 0], [-s, 0, c, 0], [0, 0, 0, 1]])


def frame(T_world_cam: np.ndarray | None) -> Frame:
    return Frame(stamp_s=0.0, gray=IMAGE, depth_m=IMAGE.astype(np.float32), T_world_cam=T_world_cam)


class Asked:
    """Counts how often it is asked."""

    def __init__(self) -> None:
        self.times = 0

    def estimate(self, source: Frame, target: Frame) -> Motion:
        self.times += 1
        return Motion(status=MotionStatus.NOT_SOLVED)


def test_poses_of_both_frames_go_before_odometry() -> None:
    asked = Asked()
    motion = PriorsFirst(asked, OdometryConfig()).estimate(frame(pose(1.0)), frame(pose(1.2)))
    assert motion.ok
    np.testing.assert_allclose(motion.T_target_source, pose(-0.2), atol=1e-12)
    assert asked.times == 0


@pytest.mark.parametrize(("first", "second"), [(None, pose()), (pose(), None), (None, None)])
def test_without_poses_odometry_is_asked(first: np.ndarray | None, second: np.ndarray | None) -> None:
    asked = Asked()
    assert PriorsFirst(asked, OdometryConfig()).estimate(frame(first), frame(second)).status is MotionStatus.NOT_SOLVED
    assert asked.times == 1


@pytest.mark.parametrize("jump", [pose(3.0), pose(0.0, 90.0)])
def test_poses_that_jump_are_not_believed(jump: np.ndarray) -> None:
    motion = PriorsFirst(Asked(), OdometryConfig()).estimate(frame(pose()), frame(jump))
    assert motion.status is MotionStatus.TOO_FAR
    np.testing.assert_array_equal(motion.T_target_source, np.eye(4))


@pytest.mark.parametrize(
    "bad", [np.zeros((4, 4)), 2 * np.eye(4), np.diag([1.0, 1, -1, 1]), np.diag([2.0, 1, 1, 1]), np.ones((3, 4))]
)
def test_what_is_no_rigid_pose_is_refused(bad: np.ndarray) -> None:
    with pytest.raises(FrameError, match="rigid"):
        frame(bad)
