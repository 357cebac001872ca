"""Three models of a depth sensor, from ideal to realistic, behind one interface."""

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
    """Measured depth."""

    depth_m: FloatImage
    """Shape (H, W), float32; 0 = invalid."""
    invalid_reason: GrayImage
    """One `InvalidReason` per pixel, shape (H, W), uint8."""


@dataclass(frozen=True, kw_only=True, eq=False)
class StereoPair:
    """Images of both cameras of one drone: the noise-free left ones, and the gray images with camera noise."""

    drone: int
    frame: int
    left: Images
    gray_left: GrayImage
    gray_right: GrayImage | None
    occluded: MaskImage
    """Pixels that the right camera does not see, shape (H, W); all False without a right camera."""


class SensorModel(Protocol):
    """Makes a depth image from a stereo pair. Threads may share it."""

    needs_right: bool
    """Whether the second camera has to be rendered."""

    def measure(self, pair: StereoPair) -> Measurement:
        """Depth of one stereo pair."""
        ...


class TruthModel:
    """Exact depth, limited to the largest depth of the camera; the sky reads that depth."""

    needs_right = False

    def __init__(self, max_depth_m: float) -> None:
        self._max_depth_m = np.float32(max_depth_m)

    def measure(self, pair: StereoPair) -> Measurement:
        """The true depth."""
        depth_m = np.minimum(pair.left.depth_m, self._max_depth_m)
        return Measurement(depth_m=depth_m, invalid_reason=np.zeros(depth_m.shape, np.uint8))


class NoisyModel:
    """True depth with noise terms. By default, only the pixels that the second camera does not see are invalid.

    Args:
        intrinsics: Camera model of the left camera, with the baseline.
        noise: The noise terms.
        max_depth_m: Reading for the sky and for surfaces farther away.
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

    def measure(self, pair: StereoPair) -> Measurement:
        """The true depth after all noise terms, limited to the largest depth."""
        image = NoisyDepth(
            depth_m=pair.left.depth_m.copy(),
            invalid_reason=np.zeros(pair.left.depth_m.shape, np.uint8),
            segment_id=pair.left.segment_id,
            occluded=pair.occluded,
            texture_of_body=self._texture_of_body,
            intrinsics=self._intrinsics,
            seed=self._seed,
            key=(pair.drone, pair.frame),
        )
        for term in self._terms:
            term.apply(image)
        depth_m = np.minimum(image.depth_m, self._max_depth_m)
        return Measurement(depth_m=depth_m, invalid_reason=image.invalid_reason)


class StereoModel:
    """Depth from matching the two gray images."""

    needs_right = True

    def __init__(self, intrinsics: Intrinsics, config: StereoConfig, *, max_depth_m: float) -> None:
        self._matcher = StereoMatcher(intrinsics, config, max_depth_m=max_depth_m)

    def measure(self, pair: StereoPair) -> Measurement:
        """Depth with the holes and errors of matching. The truth is used only to name the reasons for holes.

        Raises:
            SensorError: The pair has no right image.
        """
        if pair.gray_right is None:
            raise SensorError("the sensor model 'stereo' needs the gray image of the right camera, got none")
        match = self._matcher.match(pair.gray_left, pair.gray_right)
        reason, invalid = match.invalid_reason, match.invalid_reason != InvalidReason.NONE
        reason[invalid & (pair.left.depth_m < self._matcher.min_depth_m)] = InvalidReason.OUT_OF_RANGE
        reason[invalid & pair.occluded] = InvalidReason.OCCLUDED
        return Measurement(depth_m=self._matcher.depth_from_disparity(match.disparity_px), invalid_reason=reason)
