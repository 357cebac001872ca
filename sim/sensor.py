"""A simulated stereo camera: it renders both images, adds camera noise and measures depth."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from pydantic import Field, model_validator
from scipy.ndimage import gaussian_filter

from voxdepth.model import Model
from voxdepth.types import FloatArray, FloatImage, GrayImage, Intrinsics, MaskImage

from . import frames
from .alignment import aligned, hidden_from_pair
from .artefacts import Artefacts
from .bodies import Surface
from .camera_noise import exposure_gain, low_light_noise, photon_noise
from .decimation import decimated
from .depth_noise import DepthNoise, NoiseTerm, NoisyDepth, SensorModelName
from .fitted import FittedStereo
from .seeds import Purpose, stream
from .stereo import (
    NOISE_TEXTURE,
    StereoConfig,
    StereoMatcher,
    find_reasons,
    image_focal_baseline_px_m,
    occlusion_mask,
    pixels,
)
from .types import BodyPose, Camera, CameraImages, Capture, RenderedPair, Renderer

if TYPE_CHECKING:
    from .world import World

DOT_SHARE = 0.15
"""Share of the pixels with a dot of a projector."""
DOT_SIGMA_PX = 0.7
"""Standard deviation of a dot, which is a Gaussian."""
PROJECTOR_RANGE_M = 3.0
"""Depth at which the light of a projector is half as strong."""
SUBFRAMES = 12
"""Images per frame of which blurred ones are made."""


class RigConfig(Model):
    """A stereo camera and its sensor model. The default lens resembles that of a RealSense D455."""

    width_px: int = Field(default=320, ge=32, le=4096)
    height_px: int = Field(default=180, ge=32, le=4096)
    decimate: int = Field(default=1, ge=1, le=8)
    """Factor by which captures are smaller than the images that are rendered and matched; it must divide both sides.
    Depth is the median of the valid pixels of a block up to a factor of 3, and their mean from 4 on. The sensor models
    `truth` and `fitted` have nothing to match and render the smaller images at once."""
    hfov_deg: float = Field(default=86.0, gt=10, lt=170)
    baseline_m: float = Field(default=0.095, gt=0)
    rate_hz: float = Field(default=10.0, gt=0, le=240)
    """Captures per second, at most one per step of physics."""
    mount_forward_m: float = Field(default=0.27, ge=0)
    """Distance of the camera ahead of the drone's centre [m]. Inside the airframe it would see its own drone."""
    depth: SensorModelName = "stereo"
    """The sensor model: `truth` reads the true depth, `noisy` adds noise to it, and `stereo` matches both images.
    `fitted` imitates the errors of `stereo` in full light, in a tenth of its time."""
    noise: DepthNoise = DepthNoise()
    """Noise terms of the sensor model `noisy`."""
    max_depth_m: float = Field(default=40.0, gt=0)
    """Reading for the sky and for surfaces farther away."""
    photon_sigma: float = Field(default=1.5, ge=0)
    """Standard deviation of the noise of the gray images, in gray levels of 255."""
    light_stops: float = Field(default=0.0, ge=-12, le=0)
    """Light, in f-stops relative to that at which the noise is `photon_sigma`. A gain makes up for less of it, and the
    noise grows."""
    exposure_sigma: float = Field(default=0.0, ge=0)
    """Standard deviation of the logarithm of a frame's brightness, which is the same in both images."""
    exposure_settling_frames: float = Field(default=0.0, ge=0, le=100)
    """Number of frames in which automatic exposure reduces an error of brightness to 37 %. Longer errors are harder to
    bridge. With 0, brightness changes from frame to frame, as under flickering light."""
    stereo: StereoConfig = StereoConfig()
    color_offset_m: float | None = Field(default=None, gt=0)
    """Distance of a colour camera from the left one, away from the right one [m]. With it, depth is aligned to that
    camera, and the gray image, the truth and the pose are its own: shadows are those of the longer baseline."""
    projected_texture: float | None = Field(default=None, gt=0)
    """Contrast of a dot pattern that a projector beside the left camera adds to the images of the pair, as a share of
    their brightness at 0 m. It falls to a half at 3 m. A colour camera does not see it."""
    projector: Literal["left"] | None = None
    """A projector of structured light takes the place of the second camera, one baseline to the left of the camera, so
    that shadows are on the right of near surfaces. It needs the sensor model `noisy`."""
    shutter: float | None = Field(default=None, ge=2 / SUBFRAMES, le=1)
    """Share of the time of a frame in which the shutter is open, in steps of 1/12. The images are means over that time,
    so that motion blurs them, and the truth and the pose are those of its middle."""
    artefacts: Artefacts | None = None
    """Errors at the rims of surfaces and speckles, which any sensor model may have."""

    @model_validator(mode="after")
    def _check(self) -> "RigConfig":
        if self.width_px % self.decimate or self.height_px % self.decimate:
            raise ValueError(
                f"decimate must divide both sides of the image, got {self.decimate} with {self.width_px}x"
                f"{self.height_px} px"
            )
        if self.noise != DepthNoise() and self.depth != "noisy":
            raise ValueError(f"noise, theta included, belongs to the sensor model 'noisy', got it with {self.depth!r}")
        if self.max_depth_m <= self.stereo.min_depth_m:
            raise ValueError(
                f"max_depth_m must be more than stereo.min_depth_m {self.stereo.min_depth_m}, got {self.max_depth_m}"
            )
        if self.projector and (self.depth != "noisy" or self.color_offset_m):
            raise ValueError("a projector needs the sensor model 'noisy' and no colour camera: remove one of them")
        if self.projected_texture and self.depth != "stereo":
            raise ValueError(f"projected_texture needs the sensor model 'stereo', got {self.depth!r}")
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
        """Camera model of the captures of the left camera."""
        return self.full_intrinsics.scaled(self.width_px // self.decimate, self.height_px // self.decimate)

    @property
    def full_intrinsics(self) -> Intrinsics:
        """Camera model of the left camera before decimation."""
        return Intrinsics.from_hfov(
            width_px=self.width_px, height_px=self.height_px, hfov_deg=self.hfov_deg, baseline_m=self.baseline_m
        )


class DepthSensor:
    """Adds the noise of cameras to rendered images, and measures depth with them.

    Args:
        config: Cameras and sensor model.
        surfaces: Surfaces of all bodies by id.
        seed: Master seed of the run, which drives all noise.
        gray: Whether there are gray images even if the sensor model needs none; without it they are black then.

    Raises:
        SensorError: The baseline needs more disparities than the image has columns.
    """

    def __init__(
        self, config: RigConfig, surfaces: Mapping[int, Surface] = MappingProxyType({}), *, seed: int, gray: bool = True
    ) -> None:
        self._config = config
        self._seed = seed
        self.intrinsics = config.intrinsics
        """Camera model of the captures."""
        stereo, noisy = config.depth == "stereo", config.depth == "noisy"
        self._decimate = config.decimate if stereo or noisy else 1
        self.rendered = config.full_intrinsics if stereo or noisy else config.intrinsics
        """Camera model of the rendered images."""
        far_m = config.max_depth_m
        self._matcher = StereoMatcher(self.rendered, config.stereo, max_depth_m=far_m) if stereo else None
        fitted = config.depth == "fitted"
        self._fitted = FittedStereo(self.rendered, surfaces, max_depth_m=far_m, seed=seed) if fitted else None
        self._noise_terms = config.noise.terms if noisy else ()
        self._artefacts = config.artefacts.terms if config.artefacts else ()
        self._surfaces = surfaces
        self._photon_sigma = config.photon_sigma * low_light_noise(-config.light_stops)
        self.needs_gray = gray or stereo
        uses_shadows = any(term.uses_shadows for term in (*self._noise_terms, *self._artefacts))
        self.needs_right = stereo or bool(config.color_offset_m) or uses_shadows

    def capture(self, pair: RenderedPair) -> Capture:
        """Add the noise of the cameras, measure depth and decimate it. Several threads may do so at once."""
        gray_left, gray_right = self._pair_images(pair)
        depth_m, reason, occluded = self._measure(pair, gray_left, gray_right)
        view = pair.left
        if pair.color is not None and pair.right is not None and (offset_m := self._config.color_offset_m):
            view = pair.color
            gray_left = self._add_camera_noise(view, pair, 2)
            occluded = hidden_from_pair(view, pair.left, pair.right, offset_m, self.rendered)
            depth_m, reason = aligned(depth_m, offset_m, self.rendered, occluded)
        self._apply(self._artefacts, pair, view, occluded, depth_m, reason)
        full = Capture(
            stamp_s=pair.pose.stamp_s,
            drone=pair.pose.drone,
            gray_left=gray_left,
            gray_right=gray_right,
            depth_true_m=view.depth_m,
            depth_raw_m=depth_m,
            occluded=occluded,
            invalid_reason=reason,
            segment_id=view.segment_id,
            T_world_cam=view.T_world_cam,
            intrinsics=self.rendered,
        )
        return decimated(full, self._decimate)

    def _pair_images(self, pair: RenderedPair) -> tuple[GrayImage, GrayImage | None]:
        """Return the images of the left and the second camera with the projected texture and noise."""
        left, right = pair.left, pair.right
        if right is not None and (strength := self._config.projected_texture):
            left, right = lit_by_pattern(left, right, strength, self.rendered, seed=self._seed)
        gray_left = self._add_camera_noise(left, pair, 0)
        return gray_left, None if right is None else self._add_camera_noise(right, pair, 1)

    def _measure(
        self, pair: RenderedPair, gray_left: GrayImage, gray_right: GrayImage | None
    ) -> tuple[FloatImage, GrayImage, MaskImage]:
        """Depth of the left camera [m], one `InvalidReason` per pixel, and the pixels that the second one misses."""
        left = pair.left
        if self._fitted is not None:
            return self._fitted.measure(left, pair.pose.drone, pair.frame)
        occluded = np.zeros(left.depth_m.shape, np.bool_)
        if pair.right is not None and self._config.projector:  # The mirror image of a stereo pair.
            mirrored = occlusion_mask(left.depth_m[:, ::-1], pair.right.depth_m[:, ::-1], self.rendered)
            occluded = np.ascontiguousarray(mirrored[:, ::-1])
        elif pair.right is not None:
            occluded = occlusion_mask(left.depth_m, pair.right.depth_m, self.rendered)
        if self._matcher is not None and gray_right is not None:
            depth_m, reason = self._matcher.measure(gray_left, gray_right)
            find_reasons(depth_m, left.depth_m, occluded, np.float32(self._matcher.min_depth_m), reason)
            return depth_m, reason, occluded
        depth_m, reason = left.depth_m.copy(), np.zeros(occluded.shape, np.uint8)
        self._apply(self._noise_terms, pair, left, occluded, depth_m, reason)
        return np.minimum(depth_m, np.float32(self._config.max_depth_m)), reason, occluded

    def _add_camera_noise(self, images: CameraImages, pair: RenderedPair, side: int) -> GrayImage:
        if not self.needs_gray:
            return images.gray
        drone, frame = pair.pose.drone, pair.frame
        sigma, settling_frames = self._config.exposure_sigma, self._config.exposure_settling_frames
        gain = exposure_gain(sigma, drone, frame, seed=self._seed, settling_frames=settling_frames)
        return photon_noise(images.gray, self._photon_sigma, drone, frame, side, seed=self._seed, gain=gain)

    def _apply(
        self,
        terms: Iterable[NoiseTerm],
        pair: RenderedPair,
        view: CameraImages,
        occluded: MaskImage,
        depth_m: FloatImage,
        reason: GrayImage,
    ) -> None:
        """Apply noise terms to the depth and the reasons of a view, in place."""
        image = NoisyDepth(
            depth_m=depth_m, invalid_reason=reason, segment_id=view.segment_id, occluded=occluded,
            depth_true_m=view.depth_m, T_world_cam=view.T_world_cam, surfaces=self._surfaces, intrinsics=self.rendered,
            seed=self._seed, key=(pair.pose.drone, pair.frame),
        )  # fmt: skip
        for term in terms:
            term.apply(image)


class StereoSensor(DepthSensor):
    """A depth sensor that renders its images: from any pose in a world, or from its drones.

    Args:
        world: World that it shows.
        renderer: Renderer of that world.
        config: Cameras and sensor model.
        seed: Master seed of the run, which drives all noise.
        gray: Whether there are gray images even if the sensor model needs none; without it they are black then.
        right: Whether there are right images even if the sensor model needs none.
    """

    def __init__(
        self,
        world: "World",
        renderer: Renderer,
        config: RigConfig,
        *,
        seed: int,
        gray: bool = True,
        right: bool = False,
    ) -> None:
        super().__init__(config, world.surfaces, seed=seed, gray=gray)
        self._world = world
        self._renderer = renderer
        self._right = right or self.needs_right

    def captures(self, drones: Sequence[int], frame: int) -> Iterator[Capture]:
        """Give one capture for each of the drones, all at the present time of the world.

        The images are rendered at once. Noise and depth are computed when a capture is consumed.
        """
        return map(self.capture, self.render_drones(drones, frame))

    def render_drones(self, drones: Sequence[int], frame: int) -> list[RenderedPair]:
        """Render the cameras of drones at the present time of the world; noise is keyed by drone and frame."""
        return self.render([self._world.pose(drone) for drone in drones], frame)

    def render(self, poses: Sequence[BodyPose], frame: int) -> list[RenderedPair]:
        """Render the cameras of several carriers in one batch. Only one thread may render at a time."""
        config, to_left_m = self._config, {"left": 0.0}
        if self._right:
            to_left_m["right"] = config.baseline_m if config.projector else -config.baseline_m
        if config.color_offset_m:
            to_left_m["color"] = config.color_offset_m
        cameras = [self._camera(pose, offset_m) for pose in poses for offset_m in to_left_m.values()]
        images = iter(self._renderer.render(cameras, gray=self.needs_gray))
        return [RenderedPair(pose=pose, frame=frame, **{view: next(images) for view in to_left_m}) for pose in poses]

    def expose(self, poses: Sequence[BodyPose], frame: int) -> RenderedPair:
        """Render one carrier's cameras at several moments; the gray images are means, and all else is of the middle."""
        pairs = self.render(poses, frame)
        seen = {view: [getattr(pair, view) for pair in pairs] for view in ("left", "right", "color")}
        means: dict[str, Any] = {view: mean_gray(images) for view, images in seen.items() if images[0] is not None}
        return replace(pairs[len(pairs) // 2], **means)

    def _camera(self, pose: BodyPose, to_left_m: float) -> Camera:
        """Return the left camera, moved to its left."""
        mount_m = self._config.left_mount_m + np.array([0.0, to_left_m, 0.0])
        T_world_cam = frames.camera_pose(pose.position_m, pose.q_world_body_xyzw, mount_m)
        return Camera(T_world_cam=T_world_cam, intrinsics=self.rendered)


def mean_gray(images: Sequence[CameraImages]) -> CameraImages:
    """Return the middle one of successive images of a camera, with the mean of all gray images."""
    gray = np.rint(np.mean([image.gray for image in images], axis=0)).astype(np.uint8)
    return replace(images[len(images) // 2], gray=gray)


def _sampled_along_rows(image: FloatImage, at_px: FloatImage) -> FloatImage:
    """Return the values of an image at columns between its pixels, one for each pixel of an image of the same shape."""
    left = np.minimum(at_px.astype(np.intp), image.shape[1] - 2)
    share = at_px - left.astype(np.float32)
    before, after = (np.take_along_axis(image, left + k, axis=1) for k in (0, 1))
    return np.asarray(before + share * (after - before), np.float32)


def lit_by_pattern(
    left: CameraImages, right: CameraImages, strength: float, intrinsics: Intrinsics, *, seed: int
) -> tuple[CameraImages, CameraImages]:
    """Return the images of a pair that a projector beside the left camera lights with a pattern of dots.

    The pattern is fixed in the left image, and each pixel of the right image shows the dot of the same surface. The
    light is `1 + strength p / (1 + (z / 3 m)^2)` times as bright, with p between 0 and 1.

    Args:
        left: Rendered images of the left camera.
        right: Those of the right camera.
        strength: Contrast of a dot at 0 m, as a share of the brightness.
        intrinsics: Intrinsics of each camera, with the baseline.
        seed: Master seed of the run, which decides the pattern.
    """
    dots = (stream(seed, Purpose.PROJECTOR).random(left.gray.shape) < DOT_SHARE).astype(np.float32)
    dots = np.minimum(2 * gaussian_filter(dots, DOT_SIGMA_PX, mode="mirror"), 1).astype(np.float32)
    col, _ = pixels(left.gray.shape)
    seen_at = (col + image_focal_baseline_px_m(intrinsics) / right.depth_m).astype(np.float32)
    moved = _sampled_along_rows(dots, np.clip(seen_at, 0, dots.shape[1] - 1))
    lit = []
    for images, pattern in ((left, dots), (right, moved)):
        gain = 1 + strength * pattern / (1 + np.square(images.depth_m / PROJECTOR_RANGE_M))
        lit.append(replace(images, gray=np.minimum(images.gray * gain, 255).astype(np.uint8)))
    return lit[0], lit[1]
