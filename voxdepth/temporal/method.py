"""`TemporalCorrector`, the default method: a depth memory follows the camera, and is fused with every measurement."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..compiled import compile_all
from ..corrector import StreamCorrector, checked_config
from ..timing import StepTimer
from ..types import CorrectedDepth, FloatImage, Frame, GrayImage, Intrinsics
from .confidence import estimate_confidence
from .config import TemporalConfig
from .filling import Filled, HoleFiller, Inpainted, Known
from .forward_warp import ForwardWarp
from .fusion import Comparison, Fused, PixelClass, compare, fuse, is_steady
from .measurement import Measurement, measure
from .memory import WEIGHT_UNIT, Memory
from .odometry import TrackingResult, TrackingStatus, VisualOdometry
from .roughness import roughness
from .smoothing import smooth_guided
from .upsampling import Estimate, Upsampler, completed, show_pixels
from .working_resolution import WorkingResolution, default_decimation, require_large

HALVING_MOTION_PX2 = 1.0
"""Mean squared motion of the image at which the evidence of the memory for fills counts half."""
MAX_FEATURELESS_FRAMES = 60
"""Consecutive frames without features (darkness, a covered lens) after which the memory is discarded."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FusedFrame:
    """The result of the first half of the method, which depends on earlier frames."""

    depth_m: FloatImage
    """Depth of the frame, shape (H, W)."""
    is_exact: bool
    """Whether the sensor has no noise, so that nothing is smoothed."""
    fused: Fused
    inpainted: Inpainted
    single: Filled
    """What single pixels of the frame, in and beside measured working pixels, are filled with."""
    tracking: TrackingResult
    timings_s: Mapping[str, float]


class TemporalCorrector(StreamCorrector):
    """The default method: a depth memory, which is warped to every frame and fused with its measurement.

    Args:
        intrinsics: Intrinsics of the camera, whose images have at least `MIN_SIDE_PX` pixels a side. Those of a stereo
            camera should have a baseline: the method works in disparity, and assumes the baseline of a small camera
            without one.
        config: Parameters; None for the defaults.

    Raises:
        ConfigError: An argument has another type, or the images are too small.
    """

    def __init__(self, intrinsics: Intrinsics, config: TemporalConfig | None = None) -> None:
        camera, config = intrinsics, checked_config(intrinsics, config, TemporalConfig)
        require_large(camera, "the default method")
        decimation = default_decimation(camera) if config.decimation == "auto" else config.decimation
        self._config = config
        self._resolution = WorkingResolution.of(camera, decimation)
        self._odometry = VisualOdometry(camera, self._resolution, config)
        self._forward_warp = ForwardWarp(self._resolution)
        self._upsampler = Upsampler(camera.shape, self._resolution)
        self._filler = HoleFiller(self._resolution, config.shadow_factor)
        compile_all()
        super().__init__(camera, config)

    def _forget(self) -> None:
        self._odometry.reset()
        self._featureless_frames = 0

    def _align(self, frame: Frame) -> FusedFrame:
        """Track the camera, fuse the frame with the memory, and fill its holes."""
        timer = StepTimer()
        with timer("measure"):
            measurement = measure(frame, self._resolution)
        with timer("track"):
            tracking = self._odometry.track(frame)
        with timer("warp"):
            memory, motion_px2 = self._recall(measurement.gray, tracking)
        with timer("fuse"):
            fused, updated = fuse(memory, measurement, self._compare(memory, measurement))
            is_exact = measurement.is_exact and is_steady(memory, measurement)
            fused = fused.as_measured(measurement) if is_exact else fused
        with timer("fill"):
            evidence = fused.weight * np.float32(1 / (WEIGHT_UNIT * (1 + motion_px2 / HALVING_MOTION_PX2)))
            known = Known(fused.disparity_px, fused.remembered_px, evidence, memory.filled_px)
            inpainted, single = self._fill(known, frame.depth_m)
        with timer("remember"):
            self._remember(frame, tracking, updated._replace(filled_px=inpainted.disparity_px))
        return FusedFrame(
            depth_m=frame.depth_m, is_exact=is_exact, fused=fused, inpainted=inpainted, single=single,
            tracking=tracking, timings_s=timer.times_s,
        )  # fmt: skip

    def combine(self, aligned: FusedFrame) -> CorrectedDepth:
        """Run the second half, which depends on nothing but its argument: smooth, estimate confidence, and upsample."""
        timer, config, fused, inpainted = StepTimer(aligned.timings_s), self._config, aligned.fused, aligned.inpainted
        with timer("smooth"):
            whole_px = fused.disparity_px + inpainted.disparity_px
            window_px = 1 if aligned.is_exact else config.smoothing_window_px
            disparity_px = smooth_guided(whole_px, window_px)
        with timer("confidence"):
            pixel_class = fused.pixel_class | (inpainted.remembered & np.uint8(PixelClass.REMEMBERED))
            roughness_px = roughness(aligned.depth_m, self._resolution)
            confidence = estimate_confidence(
                disparity_px, pixel_class, fused.weight, fused.magnification, inpainted.probability, roughness_px
            )
            estimate = Estimate(disparity_px, pixel_class, confidence)
            single = self._of_single_pixels(fused, aligned.single, roughness_px)
        with timer("upsample"):
            focal_baseline_px_m, least = self._resolution.focal_baseline_px_m, config.min_shown_confidence
            shown = self._upsampler.show(aligned.depth_m, estimate, least)
            show_pixels(aligned.single.place, single, focal_baseline_px_m, least, shown)
            shown = completed(shown) if config.fill == "all" else shown
        return CorrectedDepth(**shown._asdict(), timings_s=timer.times_s, diagnostics=aligned.tracking)

    def _recall(self, gray: GrayImage, tracking: TrackingResult) -> tuple[Memory, float]:
        """The memory as the frame sees it, and how far the image has moved [px^2]."""
        memory, T = self._odometry.memory, tracking.T_frame_keyframe
        if memory is None or T is None:
            return Memory.empty(gray), 0.0
        warped = self._forward_warp.warp(memory.disparity_px, memory.weight, T)
        return memory.seen_by(warped), self._resolution.decimation**2 * self._forward_warp.motion_px2(warped)

    def _compare(self, memory: Memory, measurement: Measurement) -> Comparison:
        return compare(memory, measurement)

    def _fill(self, known: Known, depth_m: FloatImage) -> tuple[Inpainted, Filled]:
        return self._filler.fill(known, depth_m)

    def _of_single_pixels(self, fused: Fused, single: Filled, roughness_px: FloatImage) -> Estimate:
        """The estimate of the pixels that are filled one by one, shape (1, N)."""
        row, col = single.place.T // self._resolution.decimation
        disparity_px = single.disparity_px[None]
        pixel_class = single.remembered[None] & np.uint8(PixelClass.REMEMBERED)
        weight, growth, rough_px = (each[row, col][None] for each in (fused.weight, fused.magnification, roughness_px))
        confidence = estimate_confidence(disparity_px, pixel_class, weight, growth, single.probability[None], rough_px)
        return Estimate(disparity_px, pixel_class, confidence)

    def _remember(self, frame: Frame, tracking: TrackingResult, memory: Memory) -> None:
        """Make this frame the keyframe, unless it has no features: then the old views and their memory are kept.

        After too many frames without features, they are forgotten.
        """
        featureless = tracking.status is TrackingStatus.NO_FEATURES
        if featureless and self._featureless_frames < MAX_FEATURELESS_FRAMES:
            self._featureless_frames += 1
            return
        if featureless:
            self._odometry.reset()
        self._featureless_frames = 0
        self._odometry.set_keyframe(frame, tracking, memory)
