"""Three models of a depth sensor, from ideal to realistic, behind one interface.

Every model measures depth [m], shape (H, W), float32, 0 = invalid, and one `InvalidReason` per pixel, uint8.
"""

from collections.abc import Mapping
from typing import Literal, Protocol, get_args

import numpy as np

from voxdepth.types import FloatImage, GrayImage, Intrinsics, MaskImage

from .depth_noise import DepthNoise, NoisyDepth
from .errors import SensorError
from .stereo import StereoConfig, StereoMatcher
from .types import InvalidReason, RenderedPair

SensorModelName = Literal["truth", "noisy", "stereo"]
SENSOR_MODEL_NAMES: tuple[SensorModelName, ...] = get_args(SensorModelName)

StereoImages = tuple[GrayImage, GrayImage | None]
MeasuredDepth = tuple[FloatImage, GrayImage]


class SensorModel(Protocol):
    """Measures depth. Threads may share it."""

    needs_right: bool
    """Whether the second camera has to be rendered."""

    def measure(self, pair: RenderedPair, gray: StereoImages, occluded: MaskImage) -> MeasuredDepth:
        """Depth and the reasons for invalid pixels.

        Args:
            pair: Noise-free images of both cameras.
            gray: Left and right gray images with camera noise.
            occluded: Pixels that the right camera does not see, shape (H, W).
        """
        ...


class TruthModel:
    """Exact depth, limited to the largest depth of the camera; the sky reads that depth."""

    needs_right = False

    def __init__(self, max_depth_m: float) -> None:
        self._max_depth_m = np.float32(max_depth_m)

    def measure(self, pair: RenderedPair, gray: StereoImages, occluded: MaskImage) -> MeasuredDepth:
        """The true depth."""
        depth_m = np.minimum(pair.left.depth_m, self._max_depth_m)
        return depth_m, np.zeros(depth_m.shape, np.uint8)


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

    def measure(self, pair: RenderedPair, gray: StereoImages, occluded: MaskImage) -> MeasuredDepth:
        """The true depth after all noise terms, limited to the largest depth."""
        image = NoisyDepth(
            depth_m=pair.left.depth_m.copy(),
            invalid_reason=np.zeros(pair.left.depth_m.shape, np.uint8),
            segment_id=pair.left.segment_id,
            occluded=occluded,
            texture_of_body=self._texture_of_body,
            intrinsics=self._intrinsics,
            seed=self._seed,
            key=(pair.viewpoint.drone, pair.frame),
        )
        for term in self._terms:
            term.apply(image)
        return np.minimum(image.depth_m, self._max_depth_m), image.invalid_reason


class StereoModel:
    """Depth from matching the two gray images."""

    needs_right = True

    def __init__(self, intrinsics: Intrinsics, config: StereoConfig, *, max_depth_m: float) -> None:
        self._matcher = StereoMatcher(intrinsics, config, max_depth_m=max_depth_m)

    def measure(self, pair: RenderedPair, gray: StereoImages, occluded: MaskImage) -> MeasuredDepth:
        """Depth with the holes and errors of matching. The truth is used only to name the reasons for holes.

        Raises:
            SensorError: The pair has no right image.
        """
        left, right = gray
        if right is None:
            raise SensorError("the sensor model 'stereo' needs the gray image of the right camera, got none")
        match = self._matcher.match(left, right)
        reason, invalid = match.invalid_reason, match.invalid_reason != InvalidReason.NONE
        reason[invalid & (pair.left.depth_m < self._matcher.min_depth_m)] = InvalidReason.OUT_OF_RANGE
        reason[invalid & occluded] = InvalidReason.OCCLUDED
        return self._matcher.depth_from_disparity(match.disparity_px), reason
