"""Realistic depth for the images of any renderer: what a depth camera would measure of what your simulator draws.

    from sim.depth_camera import DepthCamera

    camera = DepthCamera("d455", seed=0)
    camera.intrinsics                                 # render left and right with these, 0.095 m apart
    capture = camera.from_pair(left, right, frame=0)  # stereo matching of two gray images
    capture = camera.from_depth(depth_m, frame=0)     # or errors of such a camera on a true depth image
    capture.depth_raw_m                               # metres, 0 = invalid

Only NumPy, OpenCV, Numba and pydantic are needed for that.
"""

from dataclasses import replace
from functools import cached_property
from typing import Literal, get_args

import numpy as np
from pydantic import ValidationError

from voxdepth.types import FloatArray, FloatImage, GrayImage, Intrinsics

from .artefacts import Artefacts, Rims
from .bodies import Surface
from .decimation import decimated
from .depth_noise import DepthNoise, Disparity, Flicker
from .errors import SensorError
from .sensor import DepthSensor, RigConfig
from .stereo import StereoConfig, focal_baseline_px_m
from .types import BodyPose, Capture, Images, InvalidReason, RenderedPair

__all__ = ["CAMERAS", "CAMERA_NAMES", "NOISE", "CameraName", "DepthCamera"]

CameraName = Literal["d435", "d455", "zed2", "oak-d"]
CAMERA_NAMES: tuple[CameraName, ...] = get_args(CameraName)

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

NOISE = DepthNoise(disparity=Disparity(sigma_px=0.1, step_px=1 / 32), flicker=Flicker(dropout=0.01))
"""Noise of `DepthCamera.from_depth` for the named cameras."""
RIMS = Artefacts(rims=Rims(fatten_px=(0, 2), erode_px=(0, 2)))
"""Ragged rims of near surfaces, likewise."""
BODY = 0
"""Id of the one body that all pixels show."""


class DepthCamera:
    """A depth camera that measures images of any renderer. The same seed and frame give the same noise.

    Args:
        camera: A name, or a configuration of your own. `depth`, `noise` and `artefacts` in it are those of
            `from_depth` if `depth` is `noisy`.
        seed: Seed of all noise.
    """

    def __init__(self, camera: CameraName | RigConfig, *, seed: int) -> None:
        if isinstance(camera, str) and camera not in CAMERAS:
            raise SensorError(f"there is no camera {camera!r}; choose one of {', '.join(CAMERAS)} or give a RigConfig")
        config = CAMERAS[camera] if isinstance(camera, str) else camera
        if config.color_offset_m or config.projector:
            raise SensorError("a colour camera or a projector of structured light needs a world: use StereoSensor")
        if config.depth == "truth":
            raise SensorError("the sensor model 'truth' measures nothing: choose 'stereo' or 'noisy'")
        self._config = config
        self._seed = seed
        _ = self._of_pairs if config.depth == "stereo" else self._of_depth  # Its errors are told now.

    @cached_property
    def _of_pairs(self) -> DepthSensor:
        config = self._config
        pair = config if config.depth == "stereo" else _changed(config, depth="stereo")
        return DepthSensor(pair, {BODY: Surface()}, seed=self._seed)

    @cached_property
    def _of_depth(self) -> DepthSensor:
        config = self._config
        errors = {} if config.depth == "noisy" else {"noise": NOISE, "artefacts": RIMS}
        truth = _changed(config, depth="noisy", decimate=1, **errors)  # What is not measured is taken out before.
        return DepthSensor(truth, {BODY: Surface()}, seed=self._seed)

    @property
    def intrinsics(self) -> Intrinsics:
        """Camera model of the images to render, with the baseline: the right camera is so far to the right."""
        return self._config.full_intrinsics

    def from_pair(
        self,
        left: GrayImage,
        right: GrayImage,
        *,
        frame: int,
        depth_m: FloatImage | None = None,
        right_depth_m: FloatImage | None = None,
    ) -> Capture:
        """Add camera noise to a rectified pair of images, and match them.

        Args:
            left: Gray image of the left camera, shape (H, W), uint8.
            right: That of the right camera.
            frame: Number of the frame, which keys the noise.
            depth_m: True depth of the left camera [m], shape (H, W), +inf, 0, -inf or NaN where it is unknown. It names
                the reasons for holes, and a dot pattern needs it; without it `depth_true_m` is +inf.
            right_depth_m: True depth of the right camera, which a dot pattern needs, too; without it shadows are those
                that the surfaces in the left image cast.

        Raises:
            SensorError: An image has another shape or type, a depth is negative, or a dot pattern lacks true depth.
        """
        if self._config.projected_texture and (depth_m is None or right_depth_m is None):
            raise SensorError("a dot pattern falls onto surfaces: give depth_m and right_depth_m, or set it to None")
        seen = self._images(left, depth_m)
        if right_depth_m is None:
            right_depth_m = seen_from_right(seen.depth_m, self.intrinsics)
        return self._of_pairs.capture(self._pair(frame, seen, self._images(right, right_depth_m)))

    def from_depth(
        self, depth_m: FloatImage, gray: GrayImage | None = None, *, frame: int, T_world_cam: FloatArray | None = None
    ) -> Capture:
        """Add the errors of the camera to a true depth image.

        The range of the camera is not applied: pixels without a surface read the largest depth.

        Args:
            depth_m: True depth along the optical axis [m], shape (H, W), float32; +inf or 0 where there is no surface,
                and -inf (REP 117: too near) or NaN (unknown) where there is one that cannot be measured. That gets no
                depth; what is too near hides what is behind it from the right camera, as a surface at the least depth.
            gray: Gray image, shape (H, W), uint8; black without one.
            frame: Number of the frame, which keys the noise.
            T_world_cam: Pose of the camera, shape (4, 4). Ragged rims stay in place in the world that it tells.

        Raises:
            SensorError: An image has another shape or type, or a depth is negative.
        """
        shape = self.intrinsics.shape
        left = self._images(np.zeros(shape, np.uint8) if gray is None else gray, depth_m, T_world_cam)
        is_near, least_m = np.isneginf(depth_m), np.float32(self._config.stereo.min_depth_m)
        right_m = seen_from_right(np.where(is_near, least_m, left.depth_m), self.intrinsics)
        capture = self._of_depth.capture(self._pair(frame, left, replace(left, depth_m=right_m)))
        capture.depth_raw_m[is_near | np.isnan(depth_m)] = 0
        capture.invalid_reason[is_near | np.isnan(depth_m)] = InvalidReason.OUT_OF_RANGE
        return decimated(capture, self._config.decimate)

    def _pair(self, frame: int, left: Images, right: Images) -> RenderedPair:
        stamp_s, upright = frame / self._config.rate_hz, np.array([0.0, 0.0, 0.0, 1.0])
        pose = BodyPose(stamp_s=stamp_s, position_m=left.T_world_cam[:3, 3], q_world_body_xyzw=upright)
        return RenderedPair(pose=pose, frame=frame, left=left, right=right)

    def _images(self, gray: GrayImage, depth_m: FloatImage | None, T_world_cam: FloatArray | None = None) -> Images:
        shape = self.intrinsics.shape
        if depth_m is None:
            depth_m = np.full(shape, np.inf, np.float32)
        for name, image, dtype in (("the gray image", gray, np.uint8), ("the depth image", depth_m, np.float32)):
            if image.shape != shape or image.dtype != dtype:
                raise SensorError(
                    f"{name} must be {np.dtype(dtype)} of shape {shape}, got {image.dtype} of shape {image.shape}: "
                    "render it with the intrinsics of the camera"
                )
        if (negative := np.isfinite(depth_m) & (depth_m < 0)).any():
            raise SensorError(
                f"a true depth is at least 0 m, got {depth_m[negative].min()} m; give 0 or +inf where there is no "
                "surface, and -inf where it is too near"
            )
        depth_m = np.where(depth_m > 0, depth_m, np.float32(np.inf))
        pose, segment_id = np.eye(4) if T_world_cam is None else T_world_cam, np.full(shape, BODY, np.int32)
        return Images(gray=gray, depth_m=depth_m, segment_id=segment_id, T_world_cam=pose)


def seen_from_right(depth_m: FloatImage, intrinsics: Intrinsics) -> FloatImage:
    """The depth that the right camera sees of the surfaces of the left image, shape (H, W); +inf where it sees none."""
    rows, cols = np.nonzero(np.isfinite(depth_m))
    shown_m = depth_m[rows, cols]
    at = cols - focal_baseline_px_m(intrinsics) / shown_m
    right_m = np.full(depth_m.shape, np.inf, np.float32)
    for col in (np.floor(at).astype(np.intp), np.ceil(at).astype(np.intp)):
        inside = col >= 0
        np.minimum.at(right_m, (rows[inside], col[inside]), shown_m[inside])
    return right_m


def _changed(config: RigConfig, **changes: object) -> RigConfig:
    """The configuration with other values; those of the other sensor model go back to their defaults."""
    others = {"noise": DepthNoise(), "artefacts": None} if changes["depth"] == "stereo" else {"projected_texture": None}
    try:
        return RigConfig(**{**dict(config), **others, **changes})
    except ValidationError as error:
        raise SensorError(
            f"this camera cannot measure with the sensor model {changes['depth']!r}: {error.errors()[0]['msg']}"
        ) from error
