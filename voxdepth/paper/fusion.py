"""Fusing a window of frames into one template: paper, Sec. Point Cloud Fusion."""

from collections.abc import Sequence
from typing import Any

from ..timing import collected_times, timed
from ..types import FloatArray, Frame
from .motion import MotionModel
from .odometry import Odometry
from .registration import Features
from .steps import ImageSteps
from .template import Template


class Fusion:
    """Turns a window of frames into a template in the camera of the last one.

    Args:
        steps: Where images are worked on; it holds the voxel grid, so one window is fused at a time.
        odometry: Measures the motion between two frames.
        motion_model: How that is used for the whole window.
    """

    def __init__(self, steps: ImageSteps, odometry: Odometry, motion_model: MotionModel) -> None:
        self._steps = steps
        self._odometry = odometry
        self._motion_model = motion_model

    def fuse(self, window: Sequence[Frame], features: Features) -> Template:
        """The template of a window; `features` are those of its last frame."""
        timings_s: dict[str, float] = {}
        with collected_times(timings_s):
            depth = self._fused(window)
        return Template(depth=depth, features=features, timings_s=timings_s)

    @timed
    def _fused(self, window: Sequence[Frame]) -> Any:
        places = self._place(window)
        self._voxelise(window, places)
        sparse = self._project()
        return self._inpaint(sparse)

    @timed
    def _place(self, window: Sequence[Frame]) -> list[FloatArray | None]:
        return self._motion_model(window, self._odometry)

    @timed
    def _voxelise(self, window: Sequence[Frame], places: Sequence[FloatArray | None]) -> None:
        """OR of all clouds, each moved once into the last camera. Frames without a place would smear."""
        self._steps.clear()
        for frame, T_last_frame in zip(window, places, strict=True):
            if T_last_frame is not None:
                self._steps.integrate(frame.depth_m, T_last_frame)

    @timed
    def _project(self) -> Any:
        return self._steps.project()

    @timed
    def _inpaint(self, sparse: Any) -> Any:
        return self._steps.inpaint(sparse)
