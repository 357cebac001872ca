"""VoxDepth: the two-state depth corrector."""

import time
from collections.abc import Callable
from typing import Concatenate, ParamSpec, TypeVar

import cv2
import numpy as np

from .combine import combine
from .config import VoxDepthConfig
from .errors import FrameError
from .fusion import Fusion, Template
from .odometry import PhotometricOdometry
from .registration import Features, OrbRegistration
from .types import (
    CorrectedDepth,
    FloatImage,
    Frame,
    GrayImage,
    Intrinsics,
    Phase,
    Registration,
    RegistrationStatus,
    Source,
)

P = ParamSpec("P")
R = TypeVar("R")

TEMPLATE_CONFIDENCE = 0.5
"""Confidence of a pixel taken from the template; a measured one has 1. Not calibrated: the paper has none."""


def _timed(step: "Callable[Concatenate[VoxDepth, P], R]") -> "Callable[Concatenate[VoxDepth, P], R]":
    """Write the wall-clock time of a step into the corrector's timings, under the step's name."""

    def run(self: "VoxDepth", /, *args: P.args, **kwargs: P.kwargs) -> R:
        start = time.perf_counter()
        try:
            return step(self, *args, **kwargs)
        finally:
            self._timings_s[step.__name__.lstrip("_")] = time.perf_counter() - start

    return run


class VoxDepth:
    """Corrects a stream of frames by a template that is fused anew in every epoch.

    An epoch fuses `window_frames` frames into one voxel cloud, projects it to a dense template, and then corrects
    frame after frame with the registered template until that no longer fits. While a window fills, the previous
    template serves. Frames must come in order and from one camera.

    Args:
        intrinsics: Of the camera; every frame must have its shape.
        config: Defaults to `VoxDepthConfig()`.
    """

    uses_gray = True

    def __init__(self, intrinsics: Intrinsics, config: VoxDepthConfig | None = None) -> None:
        self._intrinsics = intrinsics
        self._config = config or VoxDepthConfig()
        self._registration = OrbRegistration(self._config.registration, intrinsics.shape)
        self._fusion = Fusion(intrinsics, self._config, PhotometricOdometry(intrinsics, self._config.odometry))
        self.reset()

    def reset(self) -> None:
        """Forget template, window and time; the next frame starts a new epoch."""
        self._template: Template | None = None
        self._window: list[Frame] | None = []
        self._epoch_frames = 0
        self._last_stamp_s = -np.inf
        self._timings_s: dict[str, float] = {}

    def process(self, frame: Frame) -> CorrectedDepth:
        """Correct one frame.

        Raises:
            FrameError: The frame has another size than the camera, or is not later than the one before.
        """
        self._check(frame)
        features = self._describe(frame)
        self._fuse(frame, features)
        registration = self._register(features)
        self._turn_epoch(frame, registration)
        template_m = self._warp(registration)
        combined_m, source = self._combine(frame, template_m)
        depth_m = self._filter(combined_m)
        return self._result(depth_m, source, registration)

    def _check(self, frame: Frame) -> None:
        if frame.gray.shape != self._intrinsics.shape:
            raise FrameError(f"frames of this camera have shape {self._intrinsics.shape}, got {frame.gray.shape}")
        if not frame.stamp_s > self._last_stamp_s:
            raise FrameError(f"time must increase: a frame at {frame.stamp_s} s follows one at {self._last_stamp_s} s")
        self._last_stamp_s = frame.stamp_s
        self._timings_s = {}

    @_timed
    def _describe(self, frame: Frame) -> Features:
        return self._registration.describe(frame.gray)

    @_timed
    def _fuse(self, frame: Frame, features: Features) -> None:
        """Collect a frame while a window is open; when it is full, its template begins an epoch."""
        if self._window is None:
            return
        self._window.append(frame)
        if len(self._window) == self._config.window_frames:
            self._template = Template(self._fusion.fuse(self._window), features)
            self._window = None
            self._epoch_frames = 0

    @_timed
    def _register(self, features: Features) -> Registration:
        if self._template is None:
            return Registration.identity(RegistrationStatus.NOT_TRIED)
        return self._registration.register(self._template.features, features)

    def _turn_epoch(self, frame: Frame, registration: Registration) -> None:
        """Open a new window, beginning with this frame, when the template no longer serves."""
        self._epoch_frames += 1
        if self._window is None and (not registration.ok or self._epoch_frames > self._config.max_epoch_frames):
            self._window = [frame]

    @_timed
    def _warp(self, registration: Registration) -> FloatImage | None:
        """The template in the pixels of the frame. Always from the original: repeated warps would mix edges."""
        if self._template is None or not registration.ok:
            return None
        height, width = self._intrinsics.shape
        warped: FloatImage = cv2.warpAffine(  # type: ignore[assignment]
            self._template.depth_m, registration.M_frame_template, (width, height), flags=cv2.INTER_NEAREST
        )
        return warped

    @_timed
    def _combine(self, frame: Frame, template_m: FloatImage | None) -> tuple[FloatImage, GrayImage]:
        if template_m is None:
            return frame.depth_m, (frame.depth_m > 0).astype(np.uint8)
        return combine(frame.depth_m, template_m)

    @_timed
    def _filter(self, depth_m: FloatImage) -> FloatImage:
        """Median filter against flicker (paper, Eq. median)."""
        filtered: FloatImage = cv2.medianBlur(depth_m, self._config.median_size_px)  # type: ignore[assignment]
        return filtered

    def _result(self, depth_m: FloatImage, source: GrayImage, registration: Registration) -> CorrectedDepth:
        source = np.where(depth_m > 0, np.maximum(source, Source.SENSOR), Source.INVALID).astype(np.uint8)
        confidence = np.array([0, 1, TEMPLATE_CONFIDENCE], np.float32)[source]
        if self._template is None or not registration.ok:
            phase = Phase.PASSTHROUGH
        else:
            phase = Phase.CORRECTING if self._window is None else Phase.FUSING
        return CorrectedDepth(
            depth_m=depth_m,
            source=source,
            confidence=confidence,
            phase=phase,
            registration=registration,
            timings_s=dict(self._timings_s),
        )
