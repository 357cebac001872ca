"""The default method of `VoxDepth`: a depth memory follows the camera, and is fused with every measurement."""

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from ..corrector import StreamCorrector, checked_config
from ..errors import ConfigError
from ..timing import StepTimer
from ..types import CorrectedDepth, FloatArray, FloatImage, Frame, GrayImage, Intrinsics, Source
from .confidence import estimate_confidence
from .config import VoxDepthConfig
from .fusion import Fused, PixelClass, TemporalFusion
from .inpainting import Inpainter
from .masks import above, clear_where, equal
from .measurement import measure
from .memory import Memory, MemoryWarper
from .odometry import TrackingResult, TrackingStatus, VisualOdometry
from .smoothing import smooth_guided
from .upsampling import upsample_guided, upsample_nearest
from .working_resolution import WorkingResolution, default_decimation

MIN_SIDE_PX = 8
"""Smallest side of an image: at half resolution, a smaller one leaves no neighbourhood to work on."""
SOURCES_OF_CLASS = {
    PixelClass.UNKNOWN: (Source.INPAINTED, Source.INPAINTED),
    PixelClass.FUSED: (Source.SENSOR, Source.MEMORY),
    PixelClass.MEASURED: (Source.SENSOR, Source.INPAINTED),
    PixelClass.REMEMBERED: (Source.MEMORY, Source.MEMORY),
}
"""Source of a full pixel by its pixel class: if the sensor measured the pixel, and if it measured only other pixels of
the same working pixel."""
MEASURED_BIT, VALID_BIT = 4, 8
"""Bits that are added to a pixel class where the sensor measured the pixel, and where it has a depth."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TemporalDiagnostics:
    """What the default method reports about one frame."""

    tracking: TrackingStatus
    n_tracks: int
    """Corners that were searched for."""
    n_inliers: int
    """Corners that support the motion."""
    T_frame_previous: FloatArray | None
    """Rigid motion since the keyframe, shape (4, 4); None unless the camera was tracked."""

    @property
    def memory_reset(self) -> bool:
        """Whether the memory was discarded because tracking was lost."""
        return self.tracking is TrackingStatus.LOST

    def facts(self) -> Mapping[str, str | int | float]:
        """See `Diagnostics`."""
        return {
            "tracking": self.tracking.value,
            "n_tracks": self.n_tracks,
            "n_inliers": self.n_inliers,
            "memory_reset": int(self.memory_reset),
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class FusedFrame:
    """The result of the first half of the method, which depends on earlier frames."""

    measured_px: FloatImage
    """Measured disparity, shape (H, W); 0 = invalid."""
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
        ConfigError: An argument has another type, the images are too small, or the configured device does not exist.
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
        self._warper = MemoryWarper(self._resolution, config.device)
        self._fusion = TemporalFusion(config.fusion)
        self._inpainter = Inpainter(self._resolution, config.inpainting)
        super().__init__(camera)

    def reset(self) -> None:
        """Forget all frames; the next one is the first."""
        super().reset()
        self._odometry.reset()
        self._memory: Memory | None = None
        self._featureless_frames = 0

    def _align(self, frame: Frame) -> FusedFrame:
        """Track the camera, and fuse the frame with the memory."""
        timer = StepTimer()
        with timer("measure"):
            measured_px = self._resolution.disparity(frame.depth_m)
            measurement = measure(frame, measured_px, self._resolution)
        with timer("track"):
            tracking = self._odometry.track(frame)
        with timer("warp"):
            memory = self._recall(tracking, measurement.gray)
        with timer("fuse"):
            fused, memory = self._fusion.fuse(memory, measurement)
        with timer("remember"):
            self._remember(frame, tracking, memory)
        return FusedFrame(measured_px=measured_px, fused=fused, tracking=tracking, timings_s=timer.times_s)

    def combine(self, aligned: FusedFrame) -> CorrectedDepth:
        """Run the second half, which depends on nothing but its argument: inpaint, smooth, and upsample."""
        timer, fused, tracking, config = StepTimer(aligned.timings_s), aligned.fused, aligned.tracking, self._config
        with timer("inpaint"):
            inpainted = self._inpainter.inpaint(fused.disparity_px)
        with timer("smooth"):
            disparity_px = smooth_guided(inpainted.disparity_px, config.smoothing_window_px, config.smoothing_noise_px)
        with timer("confidence"):
            confidence = estimate_confidence(disparity_px, fused.pixel_class, fused.weight, inpainted.probability)
        with timer("upsample"):
            depth_m, source, confidence = self._upsample(aligned, disparity_px, confidence)
        return CorrectedDepth(
            depth_m=depth_m,
            source=source,
            confidence=confidence,
            timings_s=timer.times_s,
            diagnostics=TemporalDiagnostics(
                tracking=tracking.status,
                n_tracks=tracking.n_tracks,
                n_inliers=tracking.n_inliers,
                T_frame_previous=tracking.T_frame_keyframe,
            ),
        )

    def _recall(self, tracking: TrackingResult, gray: GrayImage) -> Memory:
        """The memory in the pixels of this frame; an empty one unless the camera is tracked."""
        if self._memory is None or tracking.T_frame_keyframe is None:
            return Memory.empty(gray)
        return self._warper.warp(self._memory, tracking.T_frame_keyframe)

    def _remember(self, frame: Frame, tracking: TrackingResult, memory: Memory) -> None:
        """Make this frame the keyframe, unless it has no features: then the old keyframe and its memory are kept."""
        if (
            tracking.status is TrackingStatus.NO_FEATURES
            and self._featureless_frames < self._config.max_featureless_frames
        ):
            self._featureless_frames += 1
            return
        self._featureless_frames = 0
        self._memory = memory
        self._odometry.set_keyframe(frame, tracking, memory.disparity_px)

    def _upsample(
        self, frame: FusedFrame, disparity_px: FloatImage, confidence: FloatImage
    ) -> tuple[FloatImage, GrayImage, FloatImage]:
        """Depth, source and confidence at full resolution, shape (H, W)."""
        measured_px, pixel_class = frame.measured_px, frame.fused.pixel_class
        if self._resolution.decimation == 2:
            disparity_px, confidence = upsample_guided(measured_px, disparity_px, confidence, pixel_class)
            pixel_class = upsample_nearest(pixel_class, measured_px.shape)
        depth_m = self._resolution.depth(disparity_px)
        measured = above(measured_px, 0) & np.uint8(MEASURED_BIT)
        valid = above(depth_m, 0) & np.uint8(VALID_BIT)
        source = np.asarray(cv2.LUT(pixel_class | measured | valid, _SOURCES), np.uint8)
        if not self._config.inpaint:
            clear_where(equal(source, Source.INPAINTED), source)
        invalid = equal(source, Source.INVALID)
        clear_where(invalid, depth_m)
        clear_where(invalid, confidence)
        return depth_m, source, confidence


def _source_table() -> GrayImage:
    """Source of each code of pixel class, `MEASURED_BIT` and `VALID_BIT`, shape (256,)."""
    table = np.zeros(256, np.uint8)
    for pixel_class, (measured, unmeasured) in SOURCES_OF_CLASS.items():
        table[pixel_class | VALID_BIT] = unmeasured
        table[pixel_class | VALID_BIT | MEASURED_BIT] = measured
    return table


_SOURCES = _source_table()
