"""The three depth tiers: how much a stereo camera is idealised. All behind one interface."""

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from voxdepth.types import FloatImage, GrayImage, Intrinsics, MaskImage

from .errors import SensorError
from .noise import occlusion, scale_noise
from .stereo import StereoConfig, StereoMatcher
from .types import Images

DepthTierName = Literal["truth", "noisy", "stereo"]
TIER_NAMES: tuple[DepthTierName, ...] = ("truth", "noisy", "stereo")


@dataclass(frozen=True, kw_only=True, eq=False)
class Measurement:
    """Depth as a tier measures it."""

    depth_m: FloatImage
    """Shape (H, W), float32; 0 = invalid."""
    occluded: MaskImage
    """Pixels hidden from the right camera, shape (H, W)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class StereoView:
    """What both cameras of one drone show: free of noise, and with photon noise."""

    drone: int
    frame: int
    left: Images
    right: Images | None
    gray_left: GrayImage
    gray_right: GrayImage | None


class DepthTier(Protocol):
    """Makes a depth image of what a drone's cameras see."""

    needs_right: bool
    """Whether the second camera has to be rendered."""

    def measure(self, view: StereoView) -> Measurement:
        """Depth of one view."""
        ...


class TruthTier:
    """Exact depth, capped at the largest depth of the camera; sky reads that depth."""

    needs_right = False

    def __init__(self, max_depth_m: float) -> None:
        self._max_depth_m = np.float32(max_depth_m)

    def measure(self, view: StereoView) -> Measurement:
        """The true depth."""
        return Measurement(
            depth_m=np.minimum(view.left.depth_m, self._max_depth_m),
            occluded=np.zeros(view.left.depth_m.shape, np.bool_),
        )


class NoisyTier:
    """Truth without the pixels that the second camera cannot see, scaled by random factors per object."""

    needs_right = True

    def __init__(self, intrinsics: Intrinsics, *, max_depth_m: float, theta: float, seed: int) -> None:
        if not theta >= 0:
            raise SensorError(f"theta must not be negative, got {theta}")
        self._intrinsics = intrinsics
        self._truth = TruthTier(max_depth_m)
        self._theta = theta
        self._seed = seed

    def measure(self, view: StereoView) -> Measurement:
        """Depth with algorithmic holes and the paper's scale noise."""
        occluded = occlusion(view.left.depth_m, _right_of(view).depth_m, self._intrinsics)
        depth_m = self._truth.measure(view).depth_m
        depth_m = scale_noise(depth_m, view.left.segment_id, self._theta, view.drone, view.frame, seed=self._seed)
        depth_m[occluded] = 0
        return Measurement(depth_m=depth_m, occluded=occluded)


class StereoTier:
    """Depth by matching the two gray images, one matcher per drone."""

    needs_right = True

    def __init__(self, intrinsics: Intrinsics, config: StereoConfig, *, max_depth_m: float, n_drones: int) -> None:
        self._intrinsics = intrinsics
        self._matchers = [StereoMatcher(intrinsics, config, max_depth_m=max_depth_m) for _ in range(n_drones)]

    def measure(self, view: StereoView) -> Measurement:
        """Depth with the holes and errors that matching makes."""
        right = _right_of(view)
        if view.gray_right is None:
            raise SensorError("the stereo tier needs the gray image of the right camera, got none")
        return Measurement(
            depth_m=self._matchers[view.drone].depth(view.gray_left, view.gray_right),
            occluded=occlusion(view.left.depth_m, right.depth_m, self._intrinsics),
        )


def _right_of(view: StereoView) -> Images:
    if view.right is None:
        raise SensorError("this depth tier needs the view of the right camera, got none")
    return view.right
