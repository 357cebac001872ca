"""Where the frames of a window were."""

import numpy as np

from voxdepth.paper.method import constant_velocity, motion_per_frame
from voxdepth.paper.odometry import Motion, MotionStatus
from voxdepth.types import Frame

IMAGE = np.zeros((2, 2), np.uint8)


def shift(x: float) -> np.ndarray:
    T = np.eye(4)
    T[0, 3] = x
    return T


def frame(number: int) -> Frame:
    return Frame(stamp_s=float(number), gray=IMAGE, depth_m=IMAGE.astype(np.float32))


class Growing:
    """Frame i and i + 1 are i + 1 metres apart; fails at the pairs that it is told."""

    def __init__(self, *fails_at: int) -> None:
        self.fails_at = fails_at
        self.asked: list[int] = []

    def estimate(self, source: Frame, target: Frame) -> Motion:
        i = int(source.stamp_s)
        self.asked.append(i)
        if i in self.fails_at:
            return Motion(status=MotionStatus.NOT_SOLVED)
        return Motion(T_target_source=shift(i + 1.0), status=MotionStatus.OK)


def x_of(places: list[np.ndarray | None]) -> list[float | None]:
    return [None if T is None else float(T[0, 3]) for T in places]


def test_constant_velocity_measures_once_and_takes_powers() -> None:
    odometry = Growing()
    assert x_of(constant_velocity([frame(i) for i in range(4)], odometry)) == [3, 2, 1, 0]
    assert odometry.asked == [0]


def test_without_that_motion_only_the_last_frame_has_a_place() -> None:
    assert x_of(constant_velocity([frame(i) for i in range(3)], Growing(0))) == [None, None, 0]


def test_per_frame_adds_the_motions_up() -> None:
    assert x_of(motion_per_frame([frame(i) for i in range(4)], Growing())) == [6, 5, 3, 0]


def test_per_frame_leaves_out_what_is_before_a_failure() -> None:
    assert x_of(motion_per_frame([frame(i) for i in range(4)], Growing(1))) == [None, None, 3, 0]


def test_a_window_of_one_frame_needs_no_odometry() -> None:
    odometry = Growing()
    for model in (constant_velocity, motion_per_frame):
        assert x_of(model([frame(0)], odometry)) == [0]
    assert not odometry.asked
