"""Stereo cameras on drones: from the state of the world to captures."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from pydantic import Field, model_validator

from voxdepth.types import FloatArray, GrayImage, Intrinsics

from . import frames
from .model import Model
from .noise import photon_noise
from .stereo import StereoConfig
from .tiers import DepthTier, DepthTierName, NoisyTier, StereoTier, StereoView, TruthTier
from .types import Camera, Capture, DroneState, Images, Renderer
from .world import World

Mapper = Callable[[Callable[..., Any], Iterable[Any]], Iterator[Any]]
"""`map`, or the `map` of an executor: results in order either way."""


class RigConfig(Model):
    """One stereo camera and what makes its depth. The default lens is like a RealSense D455's."""

    width_px: int = Field(320, ge=32)
    height_px: int = Field(180, ge=32)
    hfov_deg: float = Field(86.0, gt=10, lt=170)
    baseline_m: float = Field(0.095, gt=0)
    rate_hz: float = Field(10.0, gt=0)
    """Captures per second."""
    mount_forward_m: float = Field(0.27, ge=0)
    """Camera ahead of the drone's centre [m]; outside of the airframe, or it would see its own drone."""
    depth: DepthTierName = "stereo"
    """Where depth comes from: `truth`, `noisy` or `stereo`."""
    theta: float = Field(0.0, ge=0)
    """Noise ratio of the tier `noisy`: paper, Eq. noisesim."""
    max_depth_m: float = Field(40.0, gt=0)
    """Depth at which surfaces farther away, and the sky, read."""
    photon_sigma: float = Field(1.5, ge=0)
    """Deviation of the gray images' noise, in gray levels of 255."""
    stereo: StereoConfig = StereoConfig()

    @model_validator(mode="after")
    def _check(self) -> "RigConfig":
        if self.theta and self.depth != "noisy":
            raise ValueError(
                f"theta is the noise of the depth tier 'noisy', got theta {self.theta} with {self.depth!r}"
            )
        return self

    @property
    def intrinsics(self) -> Intrinsics:
        """Of the left camera."""
        return Intrinsics.from_hfov(
            width_px=self.width_px, height_px=self.height_px, hfov_deg=self.hfov_deg, baseline_m=self.baseline_m
        )


class StereoRig:
    """Captures what the stereo cameras of drones see.

    Args:
        world: Whose drones carry the cameras.
        renderer: Made for the same world.
        config: Of every camera.
        seed: Master seed of all noise.
        gray: Whether the gray images are wanted; without them they are black, unless the depth tier needs them.
        pool_map: Runs the drones' depth side by side; the result is the same with any.
    """

    def __init__(
        self,
        world: World,
        renderer: Renderer,
        config: RigConfig,
        *,
        seed: int,
        gray: bool = True,
        pool_map: Mapper = map,
    ) -> None:
        self._world = world
        self._renderer = renderer
        self._config = config
        self._seed = seed
        self._map = pool_map
        self.intrinsics = config.intrinsics
        self._gray = gray or config.depth == "stereo"
        self._tier = make_tier(config, seed=seed, n_drones=world.n_drones)

    def capture(self, drones: Sequence[int], frame: int) -> list[Capture]:
        """One capture for each of the named drones, all at the world's present time.

        Args:
            drones: Indices of drones.
            frame: Number of the frame; noise is keyed by drone and frame.
        """
        states = self._world.states
        lefts = [self._camera(states[i], +0.5) for i in drones]
        rights = [self._camera(states[i], -0.5) for i in drones] if self._tier.needs_right else []
        images = self._renderer.render([*lefts, *rights], gray=self._gray)
        seen: list[Images | None] = [*images[len(lefts) :]] or [None] * len(lefts)
        jobs = zip(drones, lefts, images, seen, strict=False)
        return list(self._map(lambda job: self._capture(frame, *job), list(jobs)))

    def _camera(self, state: DroneState, side: float) -> Camera:
        mount_m = np.array([self._config.mount_forward_m, side * self._config.baseline_m, 0.0])
        T_world_cam: FloatArray = frames.camera_pose(state.position_m, state.q_world_body_xyzw, mount_m)
        return Camera(T_world_cam=T_world_cam, intrinsics=self.intrinsics)

    def _capture(self, frame: int, drone: int, camera: Camera, left: Images, right: Images | None) -> Capture:
        view = StereoView(
            drone=drone,
            frame=frame,
            left=left,
            right=right,
            gray_left=self._exposed(left, drone, frame, 0),
            gray_right=None if right is None else self._exposed(right, drone, frame, 1),
        )
        measured = self._tier.measure(view)
        return Capture(
            stamp_s=self._world.time_s,
            drone=drone,
            gray_left=view.gray_left,
            gray_right=view.gray_right,
            depth_true_m=left.depth_m,
            depth_raw_m=measured.depth_m,
            occluded=measured.occluded,
            segment_id=left.segment_id,
            T_world_cam=camera.T_world_cam,
            intrinsics=self.intrinsics,
        )

    def _exposed(self, images: Images, *key: int) -> GrayImage:
        """The gray image as the camera delivers it."""
        if not self._gray:
            return images.gray
        return photon_noise(images.gray, self._config.photon_sigma, *key, seed=self._seed)


def make_tier(config: RigConfig, *, seed: int, n_drones: int) -> DepthTier:
    """The depth tier that a configuration names."""
    if config.depth == "truth":
        return TruthTier(config.max_depth_m)
    if config.depth == "noisy":
        return NoisyTier(config.intrinsics, max_depth_m=config.max_depth_m, theta=config.theta, seed=seed)
    return StereoTier(config.intrinsics, config.stereo, max_depth_m=config.max_depth_m, n_drones=n_drones)
