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


def fuse_window(
    window: Sequence[Frame], features: Features, steps: ImageSteps, odometry: Odometry, motion_model: MotionModel
) -> Template:
    """Fuse a window of frames into a template in the camera of the last one.

    Frames without a pose are left out: they would smear.

    Args:
        window: Successive frames.
        features: Features of the last frame.
        steps: Image operations. They hold the voxel grid, so one window is fused at a time.
        odometry: Measures the motion between two frames.
        motion_model: Derives the poses of all frames from the odometry.
    """
    timer = StepTimer()
    with timer("fused"):
        with timer("motion"):
            poses = motion_model(window, odometry)
        with timer("voxelise"):
            steps.clear()
            for frame, T_last_frame in zip(window, poses, strict=True):
                if T_last_frame is not None:
                    steps.integrate(frame.depth_m, T_last_frame)
        with timer("project"):
            sparse = steps.project()
        with timer("inpaint"):
            depth = steps.inpaint(sparse)
    return Template(depth=depth, features=features, timings_s=timer.times_s)
