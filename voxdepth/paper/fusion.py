"""Fusing a window of frames into one template: paper, Sec. RGB-D Odometry and Sec. Point Cloud Fusion."""

from collections.abc import Callable, Sequence

import numpy as np

from ..timing import StepTimer
from ..types import FloatArray, Frame
from .config import MotionModelName
from .epochs import Template
from .odometry import Odometry
from .registration import Features
from .steps import ImageSteps

MotionModel = Callable[[Sequence[Frame], Odometry], list[FloatArray | None]]
"""Returns `T_last_frame`, shape (4, 4), of each frame; None for a frame whose pose is not known."""


def constant_velocity(window: Sequence[Frame], odometry: Odometry) -> list[FloatArray | None]:
    """The motion between the first two frames holds for the whole window, as in the paper.

    Frame i is then `T^(n-1-i)` away from the last, which gives the cloud of the nested Eq. fuse up to voxel rounding.
    Without that motion only the last frame has a pose.
    """
    last = len(window) - 1
    step = odometry.estimate(window[0], window[1]) if last else None
    if step is None or not step.ok:
        return [*([None] * last), np.eye(4)]
    return [np.linalg.matrix_power(step.T_target_source, last - i) for i in range(len(window))]


def motion_per_frame(window: Sequence[Frame], odometry: Odometry) -> list[FloatArray | None]:
    """The motion is measured between all neighbours; frames before a failure have no pose."""
    poses: list[FloatArray | None] = [None] * len(window)
    T_last_frame = poses[-1] = np.eye(4)
    for i in reversed(range(len(window) - 1)):
        step = odometry.estimate(window[i], window[i + 1])
        if not step.ok:
            break
        T_last_frame = poses[i] = T_last_frame @ step.T_target_source
    return poses


MOTION_MODELS: dict[MotionModelName, MotionModel] = {"constant": constant_velocity, "per_frame": motion_per_frame}


class Fusion:
    """Fuses a window of frames into a template in the camera of the last one.

    Args:
        steps: Image operations. They hold the voxel grid, so one window is fused at a time.
        odometry: Measures the motion between two frames.
        motion_model: Derives the poses of all frames of a window from the odometry.
    """

    def __init__(self, steps: ImageSteps, odometry: Odometry, motion_model: MotionModel) -> None:
        self._steps = steps
        self._odometry = odometry
        self._motion_model = motion_model

    def fuse(self, window: Sequence[Frame], features: Features) -> Template:
        """Fuse a window; `features` are those of its last frame."""
        timer = StepTimer()
        with timer("fused"):
            with timer("motion"):
                poses = self._motion_model(window, self._odometry)
            with timer("voxelise"):
                self._voxelise(window, poses)
            with timer("project"):
                sparse = self._steps.project()
            with timer("inpaint"):
                depth = self._steps.inpaint(sparse)
        return Template(depth=depth, features=features, timings_s=timer.times_s)

    def _voxelise(self, window: Sequence[Frame], poses: Sequence[FloatArray | None]) -> None:
        """OR all clouds, each moved into the last camera. Frames without a pose are left out: they would smear."""
        self._steps.clear()
        for frame, T_last_frame in zip(window, poses, strict=True):
            if T_last_frame is not None:
                self._steps.integrate(frame.depth_m, T_last_frame)
