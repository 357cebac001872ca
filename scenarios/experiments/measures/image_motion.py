"""Motion between two images by interchangeable estimators, and the true one."""

from collections.abc import Callable
from functools import partial

import numpy as np

from sim.types import Capture
from voxdepth.arithmetic import matmul
from voxdepth.features import Features
from voxdepth.geometry import back_project, inverse_rigid, transform
from voxdepth.paper.config import VoxDepthConfig
from voxdepth.paper.registration import OrbRegistration, warped
from voxdepth.types import FloatImage, GrayImage

from .optical_flow import Flow, followed

MIN_DEPTH_M = 0.1
"""What is too near for the later camera [m]."""
Warp = Callable[[FloatImage], FloatImage]
"""Moves an image of the earlier view, shape (H, W), to the later one by nearest pixels; 0 where nothing moves to."""
Estimator = Callable[[GrayImage], Callable[[GrayImage], Warp | None]]
"""Prepares an earlier image, and then finds its motion to a later one, both of shape (H, W); None if it fails."""
STAY: Warp = partial(warped, M_frame_template=np.eye(2, 3))
UNMOVED: dict[str, Estimator] = {"unmoved": lambda earlier: lambda later: STAY}
"""No motion at all, which every estimator should beat."""


def by_registration(config: VoxDepthConfig) -> Estimator:
    """Return the registration of the paper's method: matched features and an affine map."""

    def prepare(earlier: GrayImage) -> Callable[[GrayImage], Warp | None]:
        registration = OrbRegistration(config, earlier.shape)
        return partial(_registered, registration, registration.describe(earlier))

    return prepare


def _registered(registration: OrbRegistration, features: Features, later: GrayImage) -> Warp | None:
    found = registration.register(features, registration.describe(later))
    return partial(warped, M_frame_template=found.M_frame_template) if found.ok else None


def by_flow(flow: Flow) -> Estimator:
    """Return an estimator by dense optical flow, from the later image to the earlier one."""
    return lambda earlier: lambda later: partial(followed, to_image_px=flow(later, earlier))


def true_displacement_px(earlier: Capture, later: Capture) -> float:
    """Return the mean distance that the points of static objects move in the image, by true depth and poses [px].

    Points that leave the image do not count, and points that become occluded do; NaN if no point stays.
    """
    camera, depth_m = earlier.intrinsics, np.where(np.isfinite(earlier.depth_true_m), earlier.depth_true_m, 0)
    T_later_earlier = matmul(inverse_rigid(later.T_world_cam), earlier.T_world_cam)
    points_m = transform(T_later_earlier, back_project(depth_m, camera)).astype(np.float64)
    ahead = points_m[:, 2] > MIN_DEPTH_M
    (x, y, z), (row, col) = points_m[ahead].T, np.argwhere(depth_m)[ahead].T
    u, v = camera.fx_px * x / z + camera.cx_px, camera.fy_px * y / z + camera.cy_px
    stays = (u > -0.5) & (u < camera.width_px - 0.5) & (v > -0.5) & (v < camera.height_px - 0.5)
    return float(np.hypot(u - col, v - row)[stays].mean()) if stays.any() else float("nan")
