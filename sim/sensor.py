"""A stereo camera with its depth: from a pose to a capture."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import Field, model_validator

from voxdepth.types import FloatArray, GrayImage, Intrinsics

from . import frames
from .depth_noise import DepthNoise
from .errors import SensorError
from .model import Model
from .noise import exposure_gain, occlusion, photon_noise
from .sensor_models import NoisyModel, SensorModel, SensorModelName, StereoModel, StereoView, TruthModel
from .stereo import NOISE_TEXTURE, StereoConfig
from .types import BodyPose, Camera, Capture, Images, Renderer
from .world import World


class RigConfig(Model):
    """One stereo camera and what makes its depth. The default lens is like a RealSense D455's."""

    width_px: int = Field(320, ge=32, le=4096)
    height_px: int = Field(180, ge=32, le=4096)
    hfov_deg: float = Field(86.0, gt=10, lt=170)
    baseline_m: float = Field(0.095, gt=0)
    rate_hz: float = Field(10.0, gt=0, le=240)
    """Captures per second, at most as many as steps of physics."""
    mount_forward_m: float = Field(0.27, ge=0)
    """Camera ahead of the drone's centre [m]; outside of the airframe, or it would see its own drone."""
    depth: SensorModelName = "stereo"
    """Where depth comes from: `truth`, `noisy` or `stereo`."""
    noise: DepthNoise = DepthNoise()
    """Terms of the sensor model `noisy`."""
    max_depth_m: float = Field(40.0, gt=0)
    """Depth at which surfaces farther away, and the sky, read."""
    photon_sigma: float = Field(1.5, ge=0)
    """Deviation of the gray images' noise, in gray levels of 255."""
    exposure_sigma: float = Field(0.0, ge=0)
    """Flicker of the exposure: deviation of the logarithm of a frame's brightness, the same in both images."""
    stereo: StereoConfig = StereoConfig()

    @model_validator(mode="after")
    def _check(self) -> "RigConfig":
        if self.noise != DepthNoise() and self.depth != "noisy":
            raise ValueError(
                f"depth noise, theta included, belongs to the sensor model 'noisy', got it with {self.depth!r}"
            )
        if self.max_depth_m <= self.stereo.min_depth_m:
            raise ValueError(
                f"max_depth_m must be more than stereo.min_depth_m {self.stereo.min_depth_m}, got {self.max_depth_m}"
            )
        floor = NOISE_TEXTURE * self.photon_sigma
        if self.depth == "stereo" and 0 < self.stereo.min_texture < floor:
            raise ValueError(
                f"photon noise of {self.photon_sigma} alone reads as a texture of {floor:.2f}, so stereo.min_texture "
                f"{self.stereo.min_texture} would call nothing blank: raise it, or set it to 0"
            )
        return self

    @property
    def left_mount_m(self) -> FloatArray:
        """Where the left camera sits in the body frame, shape (3,); the right one mirrors it."""
        return np.array([self.mount_forward_m, self.baseline_m / 2, 0.0])

    @property
    def intrinsics(self) -> Intrinsics:
        """Of the left camera."""
        return Intrinsics.from_hfov(
            width_px=self.width_px, height_px=self.height_px, hfov_deg=self.hfov_deg, baseline_m=self.baseline_m
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Viewpoint:
    """Where one stereo camera is, and which one."""

    drone: int
    """Whose camera; noise is keyed by it."""
    pose: BodyPose
    """Of what carries the camera."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RenderedPair:
    """What the lenses of one stereo camera show, before any noise."""

    viewpoint: Viewpoint
    frame: int
    T_world_cam: FloatArray
    """Of the left camera, shape (4, 4)."""
    left: Images
    right: Images | None


class StereoSensor:
    """Captures from any pose in a world.

    Args:
        world: What is seen.
        renderer: Made for the same world.
        config: Of every camera.
        seed: Master seed of all noise.
        gray: Whether the gray images are wanted; without them they are black, unless the sensor model needs them.
        right: Whether the right images are wanted even if the sensor model does not need them.

    Raises:
        SensorError: The baseline does not fit into the scene, or needs more disparities than the image has columns.
    """

    def __init__(
        self,
        world: World,
        renderer: Renderer,
        config: RigConfig,
        *,
        seed: int,
        gray: bool = True,
        right: bool = False,
    ) -> None:
        if config.baseline_m >= world.extent_m:
            raise SensorError(
                f"the baseline of {config.baseline_m} m is not smaller than the scene ({world.extent_m:.2f} m): "
                "shorten rig.baseline_m or build a larger scene"
            )
        self._renderer = renderer
        self._config = config
        self._seed = seed
        self.intrinsics = config.intrinsics
        self._gray = gray or config.depth == "stereo"
        self._model = create_sensor_model(config, world, seed=seed)
        self._right = right or self._model.needs_right

    def render(self, viewpoints: Sequence[Viewpoint], frame: int) -> list[RenderedPair]:
        """Render all cameras in one batch. Not for several threads at once."""
        lefts = [self._camera(viewpoint, +0.5) for viewpoint in viewpoints]
        rights = [self._camera(viewpoint, -0.5) for viewpoint in viewpoints] if self._right else []
        images = self._renderer.render([*lefts, *rights], gray=self._gray)
        seen: list[Images | None] = [*images[len(lefts) :]] or [None] * len(lefts)
        return [
            RenderedPair(viewpoint=viewpoint, frame=frame, T_world_cam=camera.T_world_cam, left=left, right=right)
            for viewpoint, camera, left, right in zip(viewpoints, lefts, images, seen, strict=False)
        ]

    def capture(self, pair: RenderedPair) -> Capture:
        """Add the noise of the cameras and measure depth; threads may work on several pairs at once."""
        drone, frame = pair.viewpoint.drone, pair.frame
        if pair.right is None:
            occluded = np.zeros(pair.left.depth_m.shape, np.bool_)
        else:
            occluded = occlusion(pair.left.depth_m, pair.right.depth_m, self.intrinsics)
        view = StereoView(
            drone=drone,
            frame=frame,
            left=pair.left,
            gray_left=self._exposed(pair.left, drone, frame, 0),
            gray_right=None if pair.right is None else self._exposed(pair.right, drone, frame, 1),
            occluded=occluded,
        )
        measured = self._model.measure(view)
        return Capture(
            stamp_s=pair.viewpoint.pose.stamp_s,
            drone=drone,
            gray_left=view.gray_left,
            gray_right=view.gray_right,
            depth_true_m=pair.left.depth_m,
            depth_raw_m=measured.depth_m,
            occluded=occluded,
            invalid_reason=measured.invalid_reason,
            segment_id=pair.left.segment_id,
            T_world_cam=pair.T_world_cam,
            intrinsics=self.intrinsics,
        )

    def _camera(self, viewpoint: Viewpoint, side: float) -> Camera:
        mount_m = self._config.left_mount_m * np.array([1.0, 2 * side, 1.0])
        pose = viewpoint.pose
        T_world_cam = frames.camera_pose(pose.position_m, pose.q_world_body_xyzw, mount_m)
        return Camera(T_world_cam=T_world_cam, intrinsics=self.intrinsics)

    def _exposed(self, images: Images, drone: int, frame: int, side: int) -> GrayImage:
        """The gray image as the camera delivers it."""
        if not self._gray:
            return images.gray
        gain = exposure_gain(self._config.exposure_sigma, drone, frame, seed=self._seed)
        return photon_noise(images.gray, self._config.photon_sigma, drone, frame, side, seed=self._seed, gain=gain)


def create_sensor_model(config: RigConfig, world: World, *, seed: int) -> SensorModel:
    """The sensor model that a configuration names."""
    if config.depth == "truth":
        return TruthModel(config.max_depth_m)
    if config.depth == "stereo":
        return StereoModel(config.intrinsics, config.stereo, max_depth_m=config.max_depth_m)
    texture_of_body = {body_id: surface.texture for body_id, surface in world.surfaces.items()}
    return NoisyModel(
        config.intrinsics,
        config.noise,
        max_depth_m=config.max_depth_m,
        texture_of_body=texture_of_body,
        seed=seed,
    )
