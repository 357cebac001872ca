"""`VoxDepth`, the default method: a depth memory follows the camera, and is fused with every measurement."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..compiled import compile_all
from ..corrector import StreamCorrector, checked_config
from ..errors import ConfigError
from ..timing import StepTimer
from ..types import CorrectedDepth, FloatImage, Frame, GrayImage, Intrinsics
from .confidence import estimate_confidence
from .config import VoxDepthConfig
from .forward_warp import ForwardWarp
from .fusion import Fused, PixelClass, fuse
from .inpainting import Inpainter
from .measurement import measure
from .memory import Memory
from .odometry import TrackingResult, TrackingStatus, VisualOdometry
from .smoothing import smooth_guided
from .upsampling import Estimate, Upsampler
from .working_resolution import MIN_SIDE_PX, WorkingResolution, default_decimation


@dataclass(frozen=True, kw_only=True, eq=False)
class FusedFrame:
    """The result of the first half of the method, which depends on earlier frames."""

    depth_m: FloatImage
    """Depth of the frame, shape (H, W)."""
    gray: GrayImage
    """Gray image at the working resolution, shape (h, w)."""
    fused: Fused
    tracking: TrackingResult
    timings_s: Mapping[str, float]


class VoxDepth(StreamCorrector):
    """The default method: a depth memory, which is warped to every frame and fused with its measurement.

    Args:
        intrinsics: Intrinsics of the camera, whose images have at least `MIN_SIDE_PX` pixels a side. Those of a stereo
            camera should have a baseline: the method works in disparity, and assumes the baseline of a small camera
            without one.
        config: Parameters; None for the defaults.

    Raises:
        ConfigError: An argument has another type, or the images are too small.
    """

    def __init__(self, intrinsics: Intrinsics, config: VoxDepthConfig | None = None) -> None:
        camera, config = intrinsics, checked_config(intrinsics, config, VoxDepthConfig)
        if min(camera.shape) < MIN_SIDE_PX:
            raise ConfigError(
                f"the default method needs images of at least {MIN_SIDE_PX}x{MIN_SIDE_PX} pixels, "
                f"got {camera.width_px}x{camera.height_px}: use a larger camera"
            )
        decimation = default_decimation(camera) if config.decimation == "auto" else config.decimation
        self._config = config
        self._resolution = WorkingResolution.of(camera, decimation)
        self._odometry = VisualOdometry(camera, self._resolution, config.odometry)
        self._forward_warp = ForwardWarp(self._resolution)
        self._upsampler = Upsampler(camera.shape, self._resolution)
        self._inpainter = Inpainter(self._resolution, config.inpainting)
        compile_all()
        super().__init__(camera)

    def _forget(self) -> None:
        self._odometry.reset()
        self._featureless_frames = 0

    def _align(self, frame: Frame) -> FusedFrame:
        """Track the camera, and fuse the frame with the memory."""
        timer = StepTimer()
        with timer("measure"):
            measurement = measure(frame, self._resolution)
        with timer("track"):
            tracking = self._odometry.track(frame)
        with timer("warp"):
            memory = self._odometry.memory
            if memory is None or tracking.T_frame_keyframe is None:
                memory = Memory.empty(measurement.gray)
            else:
                memory = memory.warp(self._forward_warp, tracking.T_frame_keyframe)
        with timer("fuse"):
            fused, memory = fuse(memory, measurement, self._config.fusion)
        with timer("remember"):
            self._remember(frame, tracking, memory)
        return FusedFrame(
            depth_m=frame.depth_m, gray=measurement.gray, fused=fused, tracking=tracking, timings_s=timer.times_s
        )

    def combine(self, aligned: FusedFrame) -> CorrectedDepth:
        """Run the second half, which depends on nothing but its argument: inpaint, smooth, and upsample."""
        timer, fused, config = StepTimer(aligned.timings_s), aligned.fused, self._config
        with timer("inpaint"):
            inpainted = self._inpainter.inpaint(fused.disparity_px, fused.remembered_px, aligned.gray)
            pixel_class = fused.pixel_class | (inpainted.remembered & np.uint8(PixelClass.REMEMBERED))
        with timer("smooth"):
            disparity_px = smooth_guided(inpainted.disparity_px, config.smoothing_window_px, config.smoothing_noise_px)
        with timer("confidence"):
            confidence = estimate_confidence(
                disparity_px, pixel_class, fused.weight, fused.magnification, inpainted.probability
            )
        with timer("upsample"):
            estimate = Estimate(disparity_px, pixel_class, confidence)
            shown = self._upsampler.show(aligned.depth_m, estimate, self._config.min_shown_confidence)
        return CorrectedDepth(**shown._asdict(), timings_s=timer.times_s, diagnostics=aligned.tracking)

    def _remember(self, frame: Frame, tracking: TrackingResult, memory: Memory) -> None:
        """Make this frame the keyframe, unless it has no features: then the old keyframes and their memory are kept.

        After too many frames without features, they are forgotten.
        """
        featureless = tracking.status is TrackingStatus.NO_FEATURES
        if featureless and self._featureless_frames < self._config.max_featureless_frames:
            self._featureless_frames += 1
            return
        if featureless:
            self._odometry.reset()
        self._featureless_frames = 0
        self._odometry.set_keyframe(frame, tracking, memory)
