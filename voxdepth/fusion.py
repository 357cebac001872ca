"""Fusing a window of frames into one template: paper, Sec. Point Cloud Fusion."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .config import VoxDepthConfig
from .geometry import PointArray, back_project, transform
from .inpainting import dilate
from .odometry import Motion, Odometry, motion_from_priors
from .projection import project_nearest
from .registration import Features
from .types import FloatImage, Frame, Intrinsics
from .voxels import VoxelGrid


@dataclass(frozen=True, eq=False)
class Template:
    """Dense depth of the scene as seen by the last frame of a fusion window."""

    depth_m: FloatImage
    """Depth [m], shape (H, W); 0 = unknown."""
    features: Features
    """Of the gray image that the depth belongs to."""


class Fusion:
    """Turns a window of frames into a depth image in the camera of the last one."""

    def __init__(self, intrinsics: Intrinsics, config: VoxDepthConfig, odometry: Odometry) -> None:
        self._intrinsics = intrinsics
        self._config = config
        self._odometry = odometry
        self._grid = VoxelGrid(config.voxels)

    def fuse(self, window: Sequence[Frame]) -> FloatImage:
        """Dense depth [m], shape (H, W), in the camera of `window[-1]`; 0 = unknown."""
        step = self._motion_per_frame(window)
        self._grid.clear()
        for cloud in self._moved_to_last(window, step):
            self._grid.integrate(cloud)
        sparse_m = project_nearest(self._grid.occupied_centres(), self._intrinsics)
        return dilate(sparse_m, self._config.inpaint_size_px)

    def _motion_per_frame(self, window: Sequence[Frame]) -> Motion:
        """The transform between the first two frames; constant velocity is assumed for the others."""
        if len(window) < 2:
            return Motion(T_target_source=np.eye(4), ok=False)
        first, second = window[:2]
        return motion_from_priors(first, second) or self._odometry.estimate(first, second)

    def _moved_to_last(self, window: Sequence[Frame], step: Motion) -> list[PointArray]:
        """Clouds of all frames in the last camera.

        Frame i is moved once by the (n-1-i)-th power of the transform, which equals the paper's nested Eq. fuse up to
        voxel rounding. Without a transform only the last frame is used: the others would smear.
        """
        if not step.ok:
            return [back_project(window[-1].depth_m, self._intrinsics)]
        last = len(window) - 1
        return [
            transform(
                np.linalg.matrix_power(step.T_target_source, last - i), back_project(frame.depth_m, self._intrinsics)
            )
            for i, frame in enumerate(window)
        ]
