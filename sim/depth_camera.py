"""Realistic depth for the images of any renderer: what a depth camera would measure of what your simulator draws.

    from sim.depth_camera import DepthCamera

    camera = DepthCamera("d455", seed=0)
    camera.intrinsics                                 # render left and right with these, 0.095 m apart
    capture = camera.from_pair(left, right, frame=0)  # stereo matching of two gray images
    capture.depth_raw_m                               # metres, 0 = invalid

The library with the extra `noise` is all that it needs.
"""

from functools import partial
from typing import Any, Literal

import numpy as np

from voxdepth.types import GrayImage

from .errors import SensorError
from .sensor import DepthSensor, RigConfig
from .stereo import StereoConfig
from .types import BodyPose, CameraImages, Capture, RenderedPair

__all__ = ["CAMERAS", "CameraName", "DepthCamera"]

CameraName = Literal["d435", "d455", "zed2", "oak-d"]

CAMERAS: dict[CameraName, RigConfig] = {
    "d435": RigConfig(
        width_px=848, height_px=480, hfov_deg=87, baseline_m=0.05, rate_hz=30, stereo=StereoConfig(min_depth_m=0.18)
    ),
    "d455": RigConfig(
        width_px=848, height_px=480, hfov_deg=87, baseline_m=0.095, rate_hz=30, stereo=StereoConfig(min_depth_m=0.34)
    ),
    "zed2": RigConfig(
        width_px=1280, height_px=720, hfov_deg=93, baseline_m=0.12, rate_hz=30, stereo=StereoConfig(min_depth_m=0.3)
    ),
    "oak-d": RigConfig(
        width_px=1280, height_px=800, hfov_deg=71.9, baseline_m=0.075, rate_hz=30, stereo=StereoConfig(min_depth_m=0.7)
    ),
}
"""Lenses, baselines, sizes and smallest depths of the makers' data sheets; field of view after rectification. The
matcher and its noise are ours. Cameras of one kind differ: `RigConfig` takes your calibration."""


NEED_A_WORLD = ("color_offset_m", "projected_texture", "artefacts", "shutter")
"""Settings of a rig that two images cannot honour."""


class DepthCamera:
    """A stereo camera that measures images of any renderer. The same seed and frame give the same noise.

    Args:
        camera: A name, or a configuration of your own, with the sensor model `stereo`.
        seed: Seed of all noise.
    """

    def __init__(self, camera: CameraName | RigConfig, *, seed: int) -> None:
        if isinstance(camera, str) and camera not in CAMERAS:
            raise SensorError(f"there is no camera {camera!r}; choose one of {', '.join(CAMERAS)} or give a RigConfig")
        config = CAMERAS[camera] if isinstance(camera, str) else camera
        if config.depth != "stereo" or any(getattr(config, name) for name in NEED_A_WORLD):
            raise SensorError(
                f"a pair of images can only be matched, got the sensor model {config.depth!r}: expected 'stereo' "
                f"without {', '.join(NEED_A_WORLD)}, which need a world and StereoSensor"
            )
        self._copy = partial(DepthCamera, config, seed=seed)
        self._rate_hz = config.rate_hz
        self._sensor = DepthSensor(config, seed=seed)
        self.intrinsics = config.full_intrinsics
        """Camera model of the images to render, with the baseline: the right camera is so far to the right."""

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy the camera, or send it to another process: it keeps nothing of the frames."""
        return self._copy, ()

    def from_pair(self, left: GrayImage, right: GrayImage, *, frame: int) -> Capture:
        """Add camera noise to a rectified pair of images, and match them. The true depth in the capture is +inf.

        Args:
            left: Gray image of the left camera, shape (H, W), uint8.
            right: That of the right camera.
            frame: Number of the frame, which keys the noise.

        Raises:
            SensorError: An image has another shape or type.
        """
        level = np.array([0.0, 0.0, 0.0, 1.0])
        pose = BodyPose(stamp_s=frame / self._rate_hz, position_m=np.zeros(3), q_world_body_xyzw=level)
        pair = RenderedPair(pose=pose, frame=frame, left=self._images(left), right=self._images(right))
        return self._sensor.capture(pair)

    def _images(self, gray: GrayImage) -> CameraImages:
        """Return a gray image of surfaces at an unknown depth."""
        shape = self.intrinsics.shape
        if gray.shape != shape or gray.dtype != np.uint8:
            raise SensorError(
                f"a gray image must be uint8 of shape {shape}, got {gray.dtype} of shape {gray.shape}: render it with "
                "the intrinsics of the camera"
            )
        unknown_m = np.full(shape, np.inf, np.float32)
        return CameraImages(
            gray=gray, depth_m=unknown_m, segment_id=np.full(shape, -1, np.int32), T_world_cam=np.eye(4)
        )
