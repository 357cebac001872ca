"""The correctors beside the filters of librealsense, frame by frame in turn on one core."""

import ctypes
import os
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from ... import PaperVoxDepth, VoxDepth
from ...baselines.learned import Learned
from ...model import Model
from ...networks import has_runtime
from ...paper.config import PaperConfig
from ...types import ASSUMED_BASELINE_M, Frame, Intrinsics
from .frames import FrameLoop
from .timings import Latency

CHAIN = "librealsense"
UNITS_PER_M = 1000.0
MAX_UNITS = 65_535
"""The farthest depth that 16 bits hold; what is farther is shown there."""
WARM_UP_FRAMES = 20
TIMEOUT_MS = 5000
WITHOUT_THREAD = PaperConfig(fusion_lag_frames=0)
"""Fuses a window within the call, so that this takes no time from the other methods."""


class Librealsense:
    """librealsense with a camera that shows what it is given.

    Args:
        camera: Its lens and baseline.
        units_per_m: Steps of its depth in a metre.

    Raises:
        ImportError, OSError: The wheel of librealsense, or the libusb that it needs, is missing or cannot be loaded.
    """

    def __init__(self, camera: Intrinsics, units_per_m: float = UNITS_PER_M) -> None:
        import libusb_package

        ctypes.CDLL(str(libusb_package.get_library_path()), mode=ctypes.RTLD_GLOBAL)
        import pyrealsense2

        self.rs: Any = pyrealsense2
        self._n_frames = 0
        self._device = self.rs.software_device()
        self._sensor = self._device.add_sensor("depth")
        self._profile = self._sensor.add_video_stream(self._stream(camera))
        self._sensor.add_read_only_option(self.rs.option.depth_units, 1 / units_per_m)
        self._sensor.add_read_only_option(
            self.rs.option.stereo_baseline, (camera.baseline_m or ASSUMED_BASELINE_M) * 1000
        )
        self._queue = self.rs.frame_queue(1, True)
        self._sensor.open(self._profile)
        self._sensor.start(self._queue)

    def recommended_filters(self) -> list[Any]:
        """The filters that its documents recommend, in their order, with their default settings."""
        rs = self.rs
        to_disparity, to_depth = rs.disparity_transform(True), rs.disparity_transform(False)
        return [to_disparity, rs.spatial_filter(), rs.temporal_filter(), to_depth, rs.hole_filling_filter()]

    def frame(self, units: npt.NDArray[np.uint16]) -> Any:
        """A frame with an image of depth, shape (H, W)."""
        frame = self.rs.software_video_frame()
        frame.stride, frame.bpp = 2 * units.shape[1], 2
        frame.frame_number, frame.timestamp = self._n_frames, 33.0 * self._n_frames
        frame.domain = self.rs.timestamp_domain.hardware_clock
        frame.profile = self._profile.as_video_stream_profile()
        frame.pixels = np.ascontiguousarray(units)
        self._n_frames += 1
        self._sensor.on_video_frame(frame)
        return self._queue.wait_for_frame(TIMEOUT_MS)

    @staticmethod
    def filtered(frame: Any, filters: Iterable[Any]) -> Any:
        """What filters make of a frame."""
        for each in filters:
            frame = each.process(frame)
        return frame

    def _stream(self, camera: Intrinsics) -> Any:
        lens = self.rs.intrinsics()
        lens.width, lens.height = camera.width_px, camera.height_px
        lens.fx, lens.fy = camera.fx_px, camera.fy_px
        lens.ppx, lens.ppy = camera.cx_px, camera.cy_px
        lens.model, lens.coeffs = self.rs.distortion.none, [0.0] * 5
        stream = self.rs.video_stream()
        stream.type, stream.fmt, stream.bpp, stream.fps = self.rs.stream.depth, self.rs.format.z16, 2, 30
        stream.index, stream.uid, stream.width, stream.height = 0, 0, lens.width, lens.height
        stream.intrinsics = lens
        return stream


class Comparison(Model):
    """Latency of each method on the same frames of one size."""

    size: str
    latencies: dict[str, Latency]
    """By method, that of librealsense first."""

    def ratio(self, method: str) -> float:
        """Median latency of a method in units of that of librealsense."""
        return self.latencies[method].p50_ms / self.latencies[CHAIN].p50_ms


def compare_with_librealsense(loop: FrameLoop, frames: int) -> Comparison | None:
    """Correct each frame with each method in turn, on one core; None where librealsense is not installed."""
    with one_core():
        try:
            sdk = Librealsense(loop.intrinsics)
        except (ImportError, OSError):
            return None
        filters, paper = sdk.recommended_filters(), PaperVoxDepth(loop.intrinsics, WITHOUT_THREAD)
        correctors: dict[str, Callable[[Frame], Any]] = {
            "voxdepth": VoxDepth(loop.intrinsics).process,
            "paper": paper.process,
        }
        if has_runtime():
            correctors["learned"] = Learned(loop.intrinsics).process
        times_s: dict[str, list[float]] = {name: [] for name in (CHAIN, *correctors)}
        for frame in loop.play(WARM_UP_FRAMES + frames):
            shown = sdk.frame(np.clip(frame.depth_m * np.float32(UNITS_PER_M), 0, MAX_UNITS).astype(np.uint16))
            times_s[CHAIN].append(_time_s(lambda shown=shown: sdk.filtered(shown, filters)))  # type: ignore[misc]
            for name, process in correctors.items():
                times_s[name].append(_time_s(lambda process=process, frame=frame: process(frame)))  # type: ignore[misc]
        paper.close()
    return Comparison(
        size=loop.size, latencies={name: Latency.of(times[WARM_UP_FRAMES:]) for name, times in times_s.items()}
    )


@contextmanager
def one_core() -> Iterator[None]:
    """Keep this thread, and those that it starts, on the last of its cores, where the system can."""
    threads, can_pin = cv2.getNumThreads(), hasattr(os, "sched_setaffinity")
    cores = os.sched_getaffinity(0) if can_pin else set()
    cv2.setNumThreads(1)
    if can_pin:
        os.sched_setaffinity(0, {max(cores)})
    try:
        yield
    finally:
        cv2.setNumThreads(threads)
        if can_pin:
            os.sched_setaffinity(0, cores)


def _time_s(action: Callable[[], Any]) -> float:
    start = time.perf_counter()
    action()
    return time.perf_counter() - start
