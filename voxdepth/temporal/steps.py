"""The nine steps of the default method, to be called one by one, and each to be replaced by another one.

`TemporalCorrector` is these steps in their order, and nothing else. Images have the working resolution, shape (h, w),
unless something else is said: that of the frame, shape (H, W), divided by the decimation. The frame of all
coordinates is that of the camera: x right, y down, z forward.
"""

from typing import NamedTuple

import numpy as np

from ..compiled import compile_all
from ..corrector import checked_config
from ..errors import FrameError
from ..types import FloatImage, Frame, Intrinsics
from .confidence import estimate_confidence
from .config import TemporalConfig
from .filling import Filled, HoleFiller, Inpainted, Known
from .forward_warp import ForwardWarp
from .fusion import Fused, MemoryComparison, PixelClass, compare, fuse, is_steady
from .measurement import Measurement, measure
from .memory import WEIGHT_UNIT, Memory, coarse_shape
from .odometry import TrackingResult, TrackingStatus, VisualOdometry
from .roughness import roughness
from .smoothing import smooth_guided
from .upsampling import DisparityEstimate, OutputImages, Upsampler, completed, show_pixels
from .working_resolution import WorkingResolution, default_decimation, require_large

__all__ = [
    "DisparityEstimate",
    "Estimates",
    "Filled",
    "Fills",
    "Fused",
    "Fusion",
    "Inpainted",
    "Measurement",
    "Memory",
    "OutputImages",
    "PixelClass",
    "Prediction",
    "Steps",
    "TrackingResult",
    "TrackingStatus",
    "WorkingResolution",
]

HALVING_MOTION_PX2 = 1.0
"""Mean squared motion of the image at which the evidence of the memory for fills counts half."""
MAX_FEATURELESS_FRAMES = 60
"""Consecutive frames without features (darkness, a covered lens) after which the memory is discarded."""


class Prediction(NamedTuple):
    """What the memory expects a frame to show."""

    memory: Memory
    """The memory in the pixels of the frame; an empty one if the motion of the camera is unknown."""
    motion_px2: float
    """Mean squared distance by which the image of the remembered surfaces has moved, in pixels of the frame."""


class Fusion(NamedTuple):
    """Measurement and memory of a frame, fused."""

    fused: Fused
    """Disparity of the frame, with holes, and what it is made of."""
    memory: Memory
    """The memory after the frame, without the fills of its holes."""
    is_exact: bool
    """Whether neither the sensor nor the memory has any noise, so that nothing is smoothed."""


class Fills(NamedTuple):
    """What the holes of a frame are filled with."""

    working: Inpainted
    """Fills of the working pixels."""
    full: Filled
    """Fills of pixels of the frame in and beside measured working pixels; none if both resolutions are the same."""


class Estimates(NamedTuple):
    """Disparity and confidence of everything that a frame shows, measured and filled."""

    working: DisparityEstimate
    """Estimates of the working pixels."""
    full: DisparityEstimate
    """Estimates of the pixels of `Fills.full`, shape (1, N)."""


class Steps:
    """The steps of the default method for one camera: one call a step, in the order in which they stand here.

    `track`, `warp` and `remember` share the keyframe, which is the view that the camera is tracked from, with its
    memory: call them once a frame, with frames in the order of time. All other steps depend on their arguments alone.
    A subclass that overrides a step replaces it, and `TemporalCorrector(camera, steps=Mine)` runs it.

    No step changes its arguments. Where an argument has images of another size than the camera, the step raises a
    `FrameError`, and where their type is another one than is documented, a `TypeError`.

    Args:
        intrinsics: Intrinsics of the camera, whose images have at least `MIN_SIDE_PX` pixels a side.
        config: Parameters; None for the defaults.

    Raises:
        ConfigError: An argument has another type, or the images are too small.
    """

    def __init__(self, intrinsics: Intrinsics, config: TemporalConfig | None = None) -> None:
        camera, config = intrinsics, checked_config(intrinsics, config, TemporalConfig)
        require_large(camera, "the default method")
        decimation = default_decimation(camera) if config.decimation == "auto" else config.decimation
        self._config = config
        self._camera = camera
        self._resolution = WorkingResolution.of(camera, decimation)
        self._odometry = VisualOdometry(camera, self._resolution, config)
        self._forward_warp = ForwardWarp(self._resolution)
        self._upsampler = Upsampler(camera.shape, self._resolution)
        self._filler = HoleFiller(self._resolution, config.shadow_factor)
        self._featureless_frames = 0
        compile_all()

    @property
    def resolution(self) -> WorkingResolution:
        """The working resolution: its shape (h, w), decimation and camera matrix, and focal length times baseline."""
        return self._resolution

    def reset(self) -> None:
        """Forget all frames, before another stream."""
        self._odometry.reset()
        self._featureless_frames = 0

    def measure(self, frame: Frame) -> Measurement:
        """Bring a frame to the working resolution, remove its speckles, and weight its pixels.

        Args:
            frame: Gray image and depth of the camera, shape (H, W).

        Returns:
            Disparity [px] of the matched images, weight and gray value of each working pixel.

        Raises:
            FrameError: The frame has another size than the camera.
        """
        frame.require_shape(self._camera.shape)
        return measure(frame, self._resolution)

    def track(self, frame: Frame) -> TrackingResult:
        """Find the motion of the camera since the keyframe.

        Args:
            frame: Gray image and depth of the camera, shape (H, W), perhaps with a pose of the caller.

        Returns:
            `T_frame_keyframe`, shape (4, 4), which maps points [m] from the axes of the keyframe's camera to those of
            the frame's; None unless the status is `OK`.

        Raises:
            FrameError: The frame has another size than the camera.
        """
        frame.require_shape(self._camera.shape)
        return self._odometry.track(frame)

    def warp(self, measurement: Measurement, tracking: TrackingResult) -> Prediction:
        """Move the memory of the keyframe to the frame.

        Args:
            measurement: The measurement of the frame. An empty memory takes its gray values.
            tracking: The last result of `track`.

        Returns:
            The memory in the pixels of the frame, and how far the image has moved [px^2].
        """
        self._require_working(measurement)
        memory, T = self._odometry.memory, tracking.T_frame_keyframe
        if memory is None or T is None:
            return Prediction(Memory.empty(measurement.gray), 0.0)
        warped = self._forward_warp.warp(memory.disparity_px, memory.weight, T)
        motion_px2 = self._resolution.decimation**2 * self._forward_warp.motion_px2(warped)
        return Prediction(memory.seen_by(warped), motion_px2)

    def fuse(self, prediction: Prediction, measurement: Measurement) -> Fusion:
        """Fuse the measurement of a frame with what the memory expects there.

        Args:
            prediction: The memory in the pixels of the frame.
            measurement: The measurement of the frame.

        Returns:
            The disparity [px] of the measured pixels, and the memory after the frame.
        """
        memory = prediction.memory
        self._require_working(memory, measurement)
        fused, updated = fuse(memory, measurement, self._compare(memory, measurement))
        is_exact = measurement.is_exact and is_steady(memory, measurement)
        return Fusion(fused.as_measured(measurement) if is_exact else fused, updated, is_exact)

    def fill(self, prediction: Prediction, fusion: Fusion, depth_m: FloatImage) -> Fills:
        """Fill the holes by votes of the pixels around them, of the memory, and of the previous fill.

        Args:
            prediction: The memory in the pixels of the frame, which holds the previous fill, too.
            fusion: The fused disparity, with holes, and the disparity of the memory in them.
            depth_m: Depth of the frame [m], shape (H, W), float32; 0 = invalid.

        Returns:
            The disparity [px] of the holes, and the probability that it is of the right surface.
        """
        self._require_working(prediction.memory, fusion.fused)
        self._require_full(depth_m)
        fused, motion_px2 = fusion.fused, prediction.motion_px2
        evidence = fused.weight * np.float32(1 / (WEIGHT_UNIT * (1 + motion_px2 / HALVING_MOTION_PX2)))
        known = Known(fused.disparity_px, fused.remembered_px, evidence, prediction.memory.filled_px)
        return Fills(*self._filler.fill(known, depth_m))

    def remember(self, frame: Frame, tracking: TrackingResult, fusion: Fusion, fills: Fills) -> None:
        """Make a frame the keyframe, with its memory and its fills.

        A frame without features does not become one: the views of earlier frames stay, with their memory, until
        `MAX_FEATURELESS_FRAMES` of them have come one after the other.

        Args:
            frame: Gray image and depth of the camera, shape (H, W).
            tracking: The result of `track` for this frame.
            fusion: The memory after the frame.
            fills: The fills, which have a vote in the next frame.
        """
        frame.require_shape(self._camera.shape)
        self._require_working(fusion.memory, fills.working)
        featureless = tracking.status is TrackingStatus.NO_FEATURES
        if featureless and self._featureless_frames < MAX_FEATURELESS_FRAMES:
            self._featureless_frames += 1
            return
        if featureless:
            self._odometry.reset()
        self._featureless_frames = 0
        self._odometry.set_keyframe(frame, tracking, fusion.memory._replace(filled_px=fills.working.disparity_px))

    def smooth(self, fusion: Fusion, fills: Fills) -> FloatImage:
        """Smooth the disparity of measured and filled pixels, and keep its edges.

        Args:
            fusion: The fused disparity of the measured pixels.
            fills: The disparity of the others.

        Returns:
            Disparity [px], shape (h, w), float32; 0 = unknown.
        """
        self._require_working(fusion.fused, fills.working)
        window_px = 1 if fusion.is_exact else self._config.smoothing_window_px
        return smooth_guided(fusion.fused.disparity_px + fills.working.disparity_px, window_px)

    def confidence(self, depth_m: FloatImage, disparity_px: FloatImage, fusion: Fusion, fills: Fills) -> Estimates:
        """Estimate the probability that each disparity is right.

        Args:
            depth_m: Depth of the frame [m], shape (H, W), float32; 0 = invalid. How rough it is tells a bad place.
            disparity_px: Smoothed disparity [px], shape (h, w), float32; 0 = unknown.
            fusion: What the measured pixels are made of.
            fills: What the others are filled with.

        Returns:
            Disparity [px], class and confidence in 0..1 of the working pixels, and of the pixels of `fills.full`.
        """
        fused, working = fusion.fused, fills.working
        self._require_working(fused, working, disparity_px=disparity_px)
        self._require_full(depth_m)
        pixel_class = fused.pixel_class | (working.remembered & np.uint8(PixelClass.REMEMBERED))
        roughness_px = roughness(depth_m, self._resolution)
        confidence = estimate_confidence(
            disparity_px, pixel_class, fused.weight, fused.error_growth, working.probability, roughness_px
        )
        estimate = DisparityEstimate(disparity_px, pixel_class, confidence)
        return Estimates(estimate, self._estimate_full(fused, fills.full, roughness_px))

    def upsample(self, depth_m: FloatImage, estimates: Estimates, fills: Fills) -> OutputImages:
        """Make the output for every pixel of the frame, from the estimates of the working pixels.

        Args:
            depth_m: Depth of the frame [m], shape (H, W), float32; 0 = invalid.
            estimates: Disparity [px], class and confidence of the working pixels, and of the pixels of `fills.full`.
            fills: Where these pixels of the frame are.

        Returns:
            Depth [m], `Source` and confidence in 0..1, all of shape (H, W).
        """
        self._require_working(estimates.working)
        self._require_full(depth_m)
        n, n_estimated = len(fills.full.pixels), estimates.full.disparity_px.shape[-1]
        if n_estimated != n:
            raise FrameError(f"expected an estimate of each of the {n} pixels of Fills.full, got {n_estimated}")
        focal_baseline_px_m, least = self._resolution.focal_baseline_px_m, self._config.min_shown_confidence
        shown = self._upsampler.show(depth_m, estimates.working, least)
        show_pixels(fills.full.pixels, estimates.full, focal_baseline_px_m, least, shown)
        return completed(shown) if self._config.fill == "all" else shown

    def _compare(self, memory: Memory, measurement: Measurement) -> MemoryComparison:
        return compare(memory, measurement)

    def _estimate_full(self, fused: Fused, filled: Filled, roughness_px: FloatImage) -> DisparityEstimate:
        """Return the estimate of the pixels of the frame that are filled one by one, shape (1, N)."""
        row, col = filled.pixels.T // self._resolution.decimation
        disparity_px = filled.disparity_px[None]
        pixel_class = filled.remembered[None] & np.uint8(PixelClass.REMEMBERED)
        weight, growth, rough_px = (each[row, col][None] for each in (fused.weight, fused.error_growth, roughness_px))
        confidence = estimate_confidence(disparity_px, pixel_class, weight, growth, filled.probability[None], rough_px)
        return DisparityEstimate(disparity_px, pixel_class, confidence)

    def _require_working(self, *groups: NamedTuple, **images: FloatImage) -> None:
        """Raise a `FrameError` for working images of another size: compiled loops would read beyond their ends."""
        fields = ((group, *field) for group in groups for field in group._asdict().items())
        of_groups = {f"{type(group).__name__}.{name}": image for group, name, image in fields}
        shape = self._resolution.shape
        others: dict[str, tuple[int, ...]] = {"Memory.drift_px": coarse_shape(shape), "Measurement.is_exact": ()}
        for name, image in {**of_groups, **images}.items():
            if np.shape(image) != (expected := others.get(name, shape)):
                raise FrameError(
                    f"{name} must have the shape {expected} for the working resolution {shape}, got {np.shape(image)}"
                )

    def _require_full(self, depth_m: FloatImage) -> None:
        if depth_m.shape != self._camera.shape:
            raise FrameError(f"depth_m must have the shape {self._camera.shape} of the frame, got {depth_m.shape}")
