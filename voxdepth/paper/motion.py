"""Where the camera was at each frame of a fusion window, relative to the last: paper, Sec. RGB-D Odometry."""

from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np

from ..types import FloatArray, Frame
from .odometry import Odometry

MotionModelName = Literal["constant", "per_frame"]
MotionModel = Callable[[Sequence[Frame], Odometry], list[FloatArray | None]]
"""Gives `T_last_frame`, shape (4, 4), of each frame; None for a frame whose place is not known."""


def constant_velocity(window: Sequence[Frame], odometry: Odometry) -> list[FloatArray | None]:
    """The motion between the first two frames holds for the whole window, as in the paper.

    Frame i is then `T^(n-1-i)` away from the last, which gives the cloud of the nested Eq. fuse up to voxel rounding.
    Without that motion only the last frame has a place.
    """
    last = len(window) - 1
    step = odometry.estimate(window[0], window[1]) if last else None
    if step is None or not step.ok:
        return [*([None] * last), np.eye(4)]
    return [np.linalg.matrix_power(step.T_target_source, last - i) for i in range(len(window))]


def motion_per_frame(window: Sequence[Frame], odometry: Odometry) -> list[FloatArray | None]:
    """The motion is measured between all neighbours; frames before a failure have no place."""
    places: list[FloatArray | None] = [None] * len(window)
    T_last_frame = places[-1] = np.eye(4)
    for i in reversed(range(len(window) - 1)):
        step = odometry.estimate(window[i], window[i + 1])
        if not step.ok:
            break
        T_last_frame = places[i] = T_last_frame @ step.T_target_source
    return places


MOTION_MODELS: dict[MotionModelName, MotionModel] = {"constant": constant_velocity, "per_frame": motion_per_frame}
