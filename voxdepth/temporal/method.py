"""The default method of `VoxDepth`: memory that moves with the camera, weighed against every measurement."""

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from ..errors import ConfigError
from ..timing import collected_times, timed
from ..types import CorrectedDepth, FloatArray, FloatImage, Frame, GrayImage, Intrinsics, Source
from .confidence import confidence_of
from .config import RigidConfig
from .fusion import Evidence, Kind, Verdict
from .inpainting import Filled, Filling
from .masks import above, equal, put, times
from .measurement import Measurement, measured
from .memory import Memory, Mover
from .odometry import Localisation, Location, TrackingStatus
from .smoothing import smoothed
from .upsampling import enlarged, merged
from .working_resolution import Scale, chosen_step

SOURCE_OF_KIND = {
    Kind.NOTHING: Source.INPAINTED,
    Kind.FUSED: Source.SENSOR,
    Kind.MEASURED: Source.SENSOR,
    Kind.REMEMBERED: Source.MEMORY,
}
SOURCE_BESIDE_SENSOR = {
    Kind.NOTHING: Source.INPAINTED,
    Kind.FUSED: Source.MEMORY,
    Kind.MEASURED: Source.INPAINTED,
    Kind.REMEMBERED: Source.MEMORY,
}
"""The same for a pixel without a measurement of its own whose neighbours in one pixel of the memory have some."""
MEASURED, FILLED = 4, 8
"""Added to the kind of a pixel that the sensor measured, and of one that has a depth."""
LEAST_SIDE_PX = 8
"""Images with a shorter side are refused: at half size too little is left of them to look around a pixel."""


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
    memory_reset: bool
    """Whether the memory was discarded because tracking was lost."""

    def facts(self) -> Mapping[str, str | int | float]:
        """See `Diagnostics`."""
        return {
            "tracking": self.tracking.value,
            "n_tracks": self.n_tracks,
            "n_inliers": self.n_inliers,
            "memory_reset": int(self.memory_reset),
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class Weighed:
    """A frame with what is to be shown of it: the result of the first half of the work on it."""

    full_px: FloatImage
    """Disparity as measured, shape (H, W); 0 = invalid."""
    verdict: Verdict
    location: Location
    timings_s: Mapping[str, float]


class RigidMethod:
    """Corrects frames by a memory of surfaces, which is moved to every frame and weighed against it.

    Args:
        camera: Every frame must have its shape, which is at least `LEAST_SIDE_PX` each way.
        config: See there.

    Raises:
        ConfigError: The configuration names a device that is not there, or the images of the camera are too small.
    """

    def __init__(self, camera: Intrinsics, config: RigidConfig) -> None:
        if min(camera.shape) < LEAST_SIDE_PX:
            raise ConfigError(
                f"the default method needs images of at least {LEAST_SIDE_PX}x{LEAST_SIDE_PX} pixels, "
                f"got {camera.width_px}x{camera.height_px}: use a larger camera"
            )
        step = chosen_step(camera) if config.memory_step == "auto" else config.memory_step
        self._config = config
        self._scale = Scale.of(camera, step)
        self._localisation = Localisation(camera, self._scale, config.localisation)
        self._mover = Mover(self._scale, config.device)
        self._evidence = Evidence(config.evidence)
        self._filling = Filling(self._scale, config.filling)
        self.reset()

    def reset(self) -> None:
        """Forget everything; the next frame is the first."""
        self._localisation.reset()
        self._memory: Memory | None = None
        self._blind_frames = 0

    def close(self) -> None:
        """Nothing runs beside the calls."""

    def align(self, frame: Frame) -> Weighed:
        """The first half: find the camera, weigh the frame against the memory, remember. Holds all state."""
        timings_s: dict[str, float] = {}
        with collected_times(timings_s):
            full_px, measurement = self._measure(frame)
            location = self._localise(frame)
            memory = self._recall(location, measurement)
            verdict, memory = self._weigh(memory, measurement)
            self._remember(frame, location, memory)
        return Weighed(full_px=full_px, verdict=verdict, location=location, timings_s=timings_s)

    def combine(self, weighed: Weighed) -> CorrectedDepth:
        """The second half: fill, smooth, tell where it is from, bring to full size. Depends on nothing else."""
        timings_s = dict(weighed.timings_s)
        with collected_times(timings_s):
            filled = self._fill(weighed.verdict)
            whole_px = self._smooth(filled.disparity_px)
            confidence = self._trust(whole_px, weighed.verdict, filled.chance)
            depth_m, source, confidence = self._enlarge(weighed, whole_px, confidence)
        found = weighed.location.found
        return CorrectedDepth(
            depth_m=depth_m,
            source=source,
            confidence=confidence,
            timings_s=timings_s,
            diagnostics=TemporalDiagnostics(
                tracking=found,
                n_tracks=weighed.location.tracks,
                n_inliers=weighed.location.inliers,
                T_frame_previous=weighed.location.T_now_before if found is TrackingStatus.OK else None,
                memory_reset=found is TrackingStatus.LOST,
            ),
        )

    @timed
    def _measure(self, frame: Frame) -> tuple[FloatImage, Measurement]:
        full_px = self._scale.disparity(frame.depth_m)
        return full_px, measured(frame, full_px, self._scale)

    @timed
    def _localise(self, frame: Frame) -> Location:
        return self._localisation.locate(frame)

    @timed
    def _recall(self, location: Location, measurement: Measurement) -> Memory:
        """The memory in the pixels of this frame; an empty one unless the camera was found."""
        if self._memory is None or location.found is not TrackingStatus.OK:
            return Memory.empty(measurement.gray)
        return self._mover.move(self._memory, location.T_now_before)

    @timed
    def _weigh(self, memory: Memory, measurement: Measurement) -> tuple[Verdict, Memory]:
        return self._evidence.weigh(memory, measurement)

    @timed
    def _remember(self, frame: Frame, location: Location, memory: Memory) -> None:
        """Go on from this frame; while it shows nothing to go by, wait for one that follows what is remembered."""
        if location.found is TrackingStatus.NO_FEATURES and self._blind_frames < self._config.hold_frames:
            self._blind_frames += 1
            return
        self._blind_frames = 0
        self._memory = memory
        self._localisation.place(frame, location, memory.disparity_px)

    @timed
    def _fill(self, verdict: Verdict) -> Filled:
        return self._filling.fill(verdict.disparity_px)

    @timed
    def _smooth(self, whole_px: FloatImage) -> FloatImage:
        if self._config.smooth_size_px == 1:
            return whole_px
        return smoothed(whole_px, self._config.smooth_size_px, self._config.smooth_noise_px)

    @timed
    def _trust(self, whole_px: FloatImage, verdict: Verdict, chance: FloatImage) -> FloatImage:
        return confidence_of(whole_px, verdict.kind, verdict.weight, chance)

    @timed
    def _enlarge(
        self, weighed: Weighed, whole_px: FloatImage, confidence: FloatImage
    ) -> tuple[FloatImage, GrayImage, FloatImage]:
        """Depth, source and confidence of the size of the frame; no guesses if none are wanted."""
        kind, full_px, size = weighed.verdict.kind, weighed.full_px, weighed.full_px.shape[::-1]
        if self._scale.step != 1:
            whole_px, confidence = merged(full_px, whole_px, confidence, kind)
            kind = enlarged(kind, size)
        depth_m = self._scale.depth(whole_px)
        code = kind | times(above(full_px, 0), MEASURED) | times(above(depth_m, 0), FILLED)
        source = np.asarray(cv2.LUT(code, _SOURCES), np.uint8)
        if self._config.fill == "none":
            put(np.zeros_like(source), equal(source, Source.INPAINTED), source)
        empty = equal(source, Source.INVALID)
        for image in (depth_m, confidence):
            put(np.zeros_like(image), empty, image)
        return depth_m, source, confidence


_SOURCES = np.zeros(256, np.uint8)
_SOURCES[[FILLED + kind for kind in SOURCE_OF_KIND]] = list(SOURCE_BESIDE_SENSOR.values())
_SOURCES[[FILLED + MEASURED + kind for kind in SOURCE_OF_KIND]] = list(SOURCE_OF_KIND.values())
