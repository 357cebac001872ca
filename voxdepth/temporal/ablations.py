"""The default method without one of its parts, see `TemporalConfig.without`.

What a setting of `TemporalConfig` switches off is not repeated here: `shadow_factor = 1`, `smoothing_window_px = 1`,
and `decimation = 1` for working at half size.
"""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from ..types import FloatArray, FloatImage, Frame, Intrinsics, MaskImage
from .config import Part, TemporalConfig
from .filling import Filled, HoleFiller, Known, VotingRules, fill_pixels
from .fusion import MemoryComparison
from .measurement import Measurement
from .memory import Memory
from .odometry import TrackingResult, VisualOdometry
from .rays import AXES, INFINITE, PixelIndices, Rays
from .steps import Fills, Fusion, Prediction, Steps
from .tracking_camera import Pixels


class WithoutMemory(Steps):
    """Each frame is corrected alone."""

    def warp(self, measurement: Measurement, tracking: TrackingResult) -> Prediction:
        """Expect nothing."""
        return Prediction(Memory.empty(measurement.gray), 0.0)


class WithoutMemoryInFills(Steps):
    """The memory has no vote in holes."""

    def fill(self, prediction: Prediction, fusion: Fusion, depth_m: FloatImage) -> Fills:
        """Fill without the memory."""
        fused = fusion.fused._replace(remembered_px=np.zeros_like(fusion.fused.remembered_px))
        return super().fill(prediction, fusion._replace(fused=fused), depth_m)


class WithoutPreviousFill(Steps):
    """The previous fill has no vote in holes."""

    def fill(self, prediction: Prediction, fusion: Fusion, depth_m: FloatImage) -> Fills:
        """Fill without the previous fill."""
        memory = prediction.memory._replace(filled_px=np.zeros_like(prediction.memory.filled_px))
        return super().fill(prediction._replace(memory=memory), fusion, depth_m)


class WithoutCoherence(Steps):
    """Each pixel contradicts the memory by itself, whatever its neighbours do."""

    def _compare(self, memory: Memory, measurement: Measurement) -> MemoryComparison:
        comparison, all_px = super()._compare(memory, measurement), np.full_like(memory.gray, 255)
        return comparison._replace(nearer=all_px, farther=all_px)


class WithoutGrayChange(Steps):
    """The memory of a hole stays where the gray value has changed."""

    def _compare(self, memory: Memory, measurement: Measurement) -> MemoryComparison:
        comparison = super()._compare(memory, measurement)
        return comparison._replace(gray_change=np.zeros_like(comparison.gray_change))


class WithoutDrift(Steps):
    """The memory weighs the same where surfaces come nearer."""

    def _compare(self, memory: Memory, measurement: Measurement) -> MemoryComparison:
        comparison = super()._compare(memory, measurement)
        return comparison._replace(memory_factor=np.ones_like(comparison.memory_factor))


class OtherFills(Steps):
    """The steps with other rules of the fills."""

    rules: ClassVar[Mapping[str, Any]]
    """What differs; see `HoleFiller`."""

    def __init__(self, intrinsics: Intrinsics, config: TemporalConfig | None = None) -> None:
        super().__init__(intrinsics, config)
        self._filler = HoleFiller(self._resolution, self._config.shadow_factor, **self.rules)


class WithoutRowBonus(OtherFills):
    """A row whose ends agree weighs no more than another axis."""

    rules: ClassVar[Mapping[str, Any]] = {"row_factor": 1.0}


class WithoutSlants(OtherFills):
    """Ends whose disparities differ are of different surfaces."""

    rules: ClassVar[Mapping[str, Any]] = {"max_slope": 0.0}


class WithoutMedian(OtherFills):
    """What is filled is not smoothed by a median."""

    rules: ClassVar[Mapping[str, Any]] = {"median_px": 1}


class _TwoEnds(HoleFiller):
    def _vote(self, known: Known, pixels: PixelIndices, rays: Rays, rules: VotingRules) -> Filled:
        filled, opposite = Filled.empty(pixels), np.roll(rays.end_px, AXES, axis=0)
        rays.steps[opposite == 0] = INFINITE
        rays.end_px[opposite == 0] = 0
        fill_pixels(known, rays, rules, filled)
        return filled


class WithoutOneSidedEnds(Steps):
    """An axis with one end has no vote."""

    def __init__(self, intrinsics: Intrinsics, config: TemporalConfig | None = None) -> None:
        super().__init__(intrinsics, config)
        self._filler = _TwoEnds(self._resolution, self._config.shadow_factor)


class _MeasuredPoints(VisualOdometry):
    def _points(self, corners: Pixels, frame: Frame, memory: Memory) -> tuple[FloatArray, MaskImage]:
        focal_baseline_px_m, depth_m = self._camera.resolution.focal_baseline_px_m, frame.depth_m
        zeros = np.zeros_like(depth_m)
        return self._camera.points(corners, np.divide(focal_baseline_px_m, depth_m, out=zeros, where=depth_m > 0))


class WithoutRememberedPoints(Steps):
    """The motion of the camera is fitted to the measured points of the frame before, not to remembered ones."""

    def __init__(self, intrinsics: Intrinsics, config: TemporalConfig | None = None) -> None:
        super().__init__(intrinsics, config)
        self._odometry = _MeasuredPoints(intrinsics, self._resolution, self._config)


class _NeverRelocalised(VisualOdometry):
    def _relocalise(self, *_: Any) -> None:
        return None


class WithoutRelocalisation(Steps):
    """After a cut or a gap the memory starts empty."""

    def __init__(self, intrinsics: Intrinsics, config: TemporalConfig | None = None) -> None:
        super().__init__(intrinsics, config)
        self._odometry = _NeverRelocalised(intrinsics, self._resolution, self._config)


ABLATIONS: dict[Part, type[Steps]] = {
    "memory": WithoutMemory,
    "memory_in_fills": WithoutMemoryInFills,
    "previous_fill": WithoutPreviousFill,
    "row_bonus": WithoutRowBonus,
    "slants": WithoutSlants,
    "lone_ends": WithoutOneSidedEnds,
    "median": WithoutMedian,
    "coherence": WithoutCoherence,
    "gray_change": WithoutGrayChange,
    "drift": WithoutDrift,
    "remembered_points": WithoutRememberedPoints,
    "relocalisation": WithoutRelocalisation,
}
"""The steps without a part."""
