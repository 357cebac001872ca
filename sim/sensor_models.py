"""The three sensor models: how much a stereo camera is idealised. All behind one interface."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, Protocol, get_args

import numpy as np

from voxdepth.types import FloatImage, GrayImage, Intrinsics, MaskImage

from .depth_noise import DepthNoise, NoisyDepth
from .errors import SensorError
from .stereo import StereoConfig, StereoMatcher
from .types import Images, InvalidReason

SensorModelName = Literal["truth", "noisy", "stereo"]
SENSOR_MODEL_NAMES: tuple[SensorModelName, ...] = get_args(SensorModelName)


@dataclass(frozen=True, kw_only=True, eq=False)
class Measurement:
    """Depth as a sensor model measures it."""

    depth_m: FloatImage
    """Shape (H, W), float32; 0 = invalid."""
    invalid_reason: GrayImage
    """One `InvalidReason` per pixel, shape (H, W), uint8."""


@dataclass(frozen=True, kw_only=True, eq=False)
class StereoView:
    """What both cameras of one drone show: free of noise, and with that of the cameras."""

    drone: int
    frame: int
    left: Images
    gray_left: GrayImage
    gray_right: GrayImage | None
    occluded: MaskImage
    """Pixels hidden from the right camera, shape (H, W); all False without a right camera."""


class SensorModel(Protocol):
    """Makes a depth image of what a drone's cameras see. Threads may share it."""

    needs_right: bool
    """Whether the second camera has to be rendered."""

    def measure(self, view: StereoView) -> Measurement:
        """Depth of one view."""
        ...


class TruthModel:
    """Exact depth, capped at the largest depth of the camera; sky reads that depth."""

    needs_right = False

    def __init__(self, max_depth_m: float) -> None:
        self._max_depth_m = np.float32(max_depth_m)

    def measure(self, view: StereoView) -> Measurement:
        """The true depth."""
        depth_m = np.minimum(view.left.depth_m, self._max_depth_m)
        return Measurement(depth_m=depth_m, invalid_reason=np.zeros(depth_m.shape, np.uint8))


class NoisyModel:
    """Truth with noise terms; as configured by default, without the pixels that the second camera cannot see.

    Args:
        intrinsics: Of the left camera, with the baseline.
        noise: Which terms are on.
        max_depth_m: Depth at which the sky and surfaces farther away read.
        texture_of_body: Strength of the texture of each body, by segmentation id.
        seed: Master seed.
    """

    def __init__(
        self,
        intrinsics: Intrinsics,
        noise: DepthNoise,
        *,
        max_depth_m: float,
        texture_of_body: Mapping[int, float],
        seed: int,
    ) -> None:
        self._intrinsics = intrinsics
        self._terms = noise.terms
        self.needs_right = noise.occlusion.active
        self._max_depth_m = np.float32(max_depth_m)
        self._texture_of_body = texture_of_body
        self._seed = seed

    def measure(self, view: StereoView) -> Measurement:
        """The true depth after all terms, then capped."""
        image = NoisyDepth(
            depth_m=view.left.depth_m.copy(),
            invalid_reason=np.zeros(view.left.depth_m.shape, np.uint8),
            segment_id=view.left.segment_id,
            occluded=view.occluded,
            texture_of_body=self._texture_of_body,
            intrinsics=self._intrinsics,
            seed=self._seed,
            key=(view.drone, view.frame),
        )
        for term in self._terms:
            term.apply(image)
        return Measurement(depth_m=np.minimum(image.depth_m, self._max_depth_m), invalid_reason=image.invalid_reason)


class StereoModel:
    """Depth by matching the two gray images."""

    needs_right = True

    def __init__(self, intrinsics: Intrinsics, config: StereoConfig, *, max_depth_m: float) -> None:
        self._matcher = StereoMatcher(intrinsics, config, max_depth_m=max_depth_m)

    def measure(self, view: StereoView) -> Measurement:
        """Depth with the holes and errors that matching makes; the truth only names the reasons of holes."""
        if view.gray_right is None:
            raise SensorError("the sensor model stereo needs the gray image of the right camera, got none")
        match = self._matcher.match(view.gray_left, view.gray_right)
        reason, lost = match.invalid_reason, match.invalid_reason != InvalidReason.NONE
        reason[lost & (view.left.depth_m < self._matcher.min_depth_m)] = InvalidReason.OUT_OF_RANGE
        reason[lost & view.occluded] = InvalidReason.OCCLUDED
        depth_m = self._matcher.depth_from_disparity(match.disparity_px)
        return Measurement(depth_m=depth_m, invalid_reason=reason)
