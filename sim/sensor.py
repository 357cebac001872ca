"""A simulated stereo camera: it renders both images, adds camera noise and measures depth."""

from collections.abc import Sequence

import numpy as np
from pydantic import Field, model_validator

from voxdepth.types import FloatArray, FloatImage, GrayImage, Intrinsics, MaskImage

from . import frames
from .depth_noise import DepthNoise, NoisyDepth, SensorModelName
from .errors import SensorError
from .seeds import Purpose, stream
from .stereo import NOISE_TEXTURE, StereoConfig, StereoMatcher, focal_baseline_px_m
from .types import BodyPose, Camera, Capture, Images, Model, RenderedPair, Renderer
from .world import World

OCCLUSION_STEP_PX = 0.75
"""Least difference of disparity between a surface and the one that occludes it."""


class RigConfig(Model):
    """A stereo camera and its sensor model. The default lens resembles that of a RealSense D455."""

    width_px: int = Field(320, ge=32, le=4096)
    height_px: int = Field(180, ge=32, le=4096)
    hfov_deg: float = Field(86.0, gt=10, lt=170)
    baseline_m: float = Field(0.095, gt=0)
    rate_hz: float = Field(10.0, gt=0, le=240)
    """Captures per second, at most one per step of physics."""
    mount_forward_m: float = Field(0.27, ge=0)
    """Distance of the camera ahead of the drone's centre [m]. Inside the airframe it would see its own drone."""
    depth: SensorModelName = "stereo"
    """The sensor model: `truth` reads the true depth, `noisy` adds noise to it, and `stereo` matches both images."""
    noise: DepthNoise = DepthNoise()
    """Noise terms of the sensor model `noisy`."""
    max_depth_m: float = Field(40.0, gt=0)
    """Reading for the sky and for surfaces farther away."""
    photon_sigma: float = Field(1.5, ge=0)
    """Standard deviation of the noise of the gray images, in gray levels of 255."""
    exposure_sigma: float = Field(0.0, ge=0)
    """Standard deviation of the logarithm of a frame's brightness, which is the same in both images."""
    stereo: StereoConfig = StereoConfig()

    @model_validator(mode="after")
    def _check(self) -> "RigConfig":
        if self.noise != DepthNoise() and self.depth != "noisy":
            raise ValueError(f"noise, theta included, belongs to the sensor model 'noisy', got it with {self.depth!r}")
        if self.max_depth_m <= self.stereo.min_depth_m:
            raise ValueError(
                f"max_depth_m must be more than stereo.min_depth_m {self.stereo.min_depth_m}, got {self.max_depth_m}"
            )
        floor = NOISE_TEXTURE * self.photon_sigma
        if self.depth == "stereo" and 0 < self.stereo.min_texture < floor:
            raise ValueError(
                f"photon noise of {self.photon_sigma} alone reads as a texture of {floor:.2f}, so no pixel would count "
                f"as textureless with stereo.min_texture {self.stereo.min_texture}: raise it, or set it to 0"
            )
        return self

    @property
    def left_mount_m(self) -> FloatArray:
        """Position of the left camera in the body frame, shape (3,); the right camera is its mirror image."""
        return np.array([self.mount_forward_m, self.baseline_m / 2, 0.0])

    @property
    def intrinsics(self) -> Intrinsics:
        """Camera model of the left camera."""
        return Intrinsics.from_hfov(
            width_px=self.width_px, height_px=self.height_px, hfov_deg=self.hfov_deg, baseline_m=self.baseline_m
        )


class StereoSensor:
    """Makes captures from any pose in a world, with a renderer of that world. The seed drives all noise.

    Without `gray`, the gray images are black unless the sensor model needs them. With `right`, there are right images
    even if the sensor model does not need them. A baseline that is larger than the scene, or needs more disparities
    than the image has columns, raises a `SensorError`.
    """

    def __init__(
        self, world: World, renderer: Renderer, config: RigConfig, *, seed: int, gray: bool = True, right: bool = False
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
        stereo, noisy = config.depth == "stereo", config.depth == "noisy"
        self._matcher = (
            StereoMatcher(self.intrinsics, config.stereo, max_depth_m=config.max_depth_m) if stereo else None
        )
        self._noise_terms = config.noise.terms if noisy else ()
        self._texture_of_body = {body_id: surface.texture for body_id, surface in world.surfaces.items()}
        self._gray = gray or stereo
        self._right = right or stereo or (noisy and config.noise.occlusion.active)

    def render(self, poses: Sequence[BodyPose], frame: int) -> list[RenderedPair]:
        """Render the cameras of several carriers in one batch. Only one thread may render at a time."""
        lefts = [self._camera(pose, +1.0) for pose in poses]
        rights = [self._camera(pose, -1.0) for pose in poses] if self._right else []
        images = self._renderer.render([*lefts, *rights], gray=self._gray)
        right_images: list[Images | None] = [*images[len(lefts) :]] or [None] * len(lefts)
        return [
            RenderedPair(pose=pose, frame=frame, T_world_cam=camera.T_world_cam, left=left, right=right)
            for pose, camera, left, right in zip(poses, lefts, images, right_images, strict=False)
        ]

    def capture(self, pair: RenderedPair) -> Capture:
        """Add the noise of the cameras and measure depth. Several threads may do so at once."""
        left, right = pair.left, pair.right
        gray_left = self._add_camera_noise(left, pair, 0)
        gray_right = None if right is None else self._add_camera_noise(right, pair, 1)
        if right is None:
            occluded = np.zeros(left.depth_m.shape, np.bool_)
        else:
            occluded = occlusion_mask(left.depth_m, right.depth_m, self.intrinsics)
        if self._matcher is None or gray_right is None:
            depth_raw_m, invalid_reason = self._add_depth_noise(pair, occluded)
        else:
            depth_raw_m, invalid_reason = self._matcher.measure(gray_left, gray_right, left.depth_m, occluded)
        return Capture(
            stamp_s=pair.pose.stamp_s,
            drone=pair.pose.drone,
            gray_left=gray_left,
            gray_right=gray_right,
            depth_true_m=left.depth_m,
            depth_raw_m=depth_raw_m,
            occluded=occluded,
            invalid_reason=invalid_reason,
            segment_id=left.segment_id,
            T_world_cam=pair.T_world_cam,
            intrinsics=self.intrinsics,
        )

    def _camera(self, pose: BodyPose, side: float) -> Camera:
        mount_m = self._config.left_mount_m * np.array([1.0, side, 1.0])
        T_world_cam = frames.camera_pose(pose.position_m, pose.q_world_body_xyzw, mount_m)
        return Camera(T_world_cam=T_world_cam, intrinsics=self.intrinsics)

    def _add_camera_noise(self, images: Images, pair: RenderedPair, side: int) -> GrayImage:
        if not self._gray:
            return images.gray
        drone, frame = pair.pose.drone, pair.frame
        gain = exposure_gain(self._config.exposure_sigma, drone, frame, seed=self._seed)
        return photon_noise(images.gray, self._config.photon_sigma, drone, frame, side, seed=self._seed, gain=gain)

    def _add_depth_noise(self, pair: RenderedPair, occluded: MaskImage) -> tuple[FloatImage, GrayImage]:
        """The true depth after all active noise terms, limited to the largest depth, and one `InvalidReason` each."""
        image = NoisyDepth(
            depth_m=pair.left.depth_m.copy(),
            invalid_reason=np.zeros(occluded.shape, np.uint8),
            segment_id=pair.left.segment_id,
            occluded=occluded,
            texture_of_body=self._texture_of_body,
            intrinsics=self.intrinsics,
            seed=self._seed,
            key=(pair.pose.drone, pair.frame),
        )
        for term in self._noise_terms:
            term.apply(image)
        return np.minimum(image.depth_m, np.float32(self._config.max_depth_m)), image.invalid_reason


def photon_noise(gray: GrayImage, sigma: float, *key: int, seed: int, gain: float = 1.0) -> GrayImage:
    """The image times `gain`, with Gaussian noise of `sigma` gray levels, rounded and clipped.

    The noise is keyed by the seed and by `key`, which is the drone, the frame and the camera.
    """
    noise = stream(seed, Purpose.PHOTON, *key).standard_normal(gray.shape, np.float32)
    noise *= np.float32(sigma)
    noise += gray if gain == 1 else gray * np.float32(gain)
    np.rint(noise, out=noise)
    return np.clip(noise, 0, 255, out=noise).astype(np.uint8)


def exposure_gain(sigma: float, *key: int, seed: int) -> float:
    """Brightness of a frame relative to the mean, `exp(N(0, sigma))`, as automatic exposure varies it."""
    return float(np.exp(sigma * stream(seed, Purpose.EXPOSURE, *key).standard_normal())) if sigma else 1.0


def occlusion_mask(left_depth_m: FloatImage, right_depth_m: FloatImage, intrinsics: Intrinsics) -> MaskImage:
    """Pixels of the left image whose surface the right camera does not see, shape (H, W).

    A pixel of disparity d lies d to the left in the right image. It is occluded if that is outside of the image, or if
    the nearest pixel there has a disparity that is larger by more than `OCCLUSION_STEP_PX`. A smaller difference hides
    no whole pixel, and occurs within half a pixel of a slanted surface.
    """
    width = left_depth_m.shape[1]
    disparity_px = focal_baseline_px_m(intrinsics) / left_depth_m
    col = np.rint(np.arange(width, dtype=np.float32)[None, :] - disparity_px).astype(np.intp)
    seen_px = focal_baseline_px_m(intrinsics) / np.take_along_axis(right_depth_m, np.maximum(col, 0), axis=1)
    return np.isfinite(left_depth_m) & ((col < 0) | (seen_px - disparity_px > OCCLUSION_STEP_PX))
