"""What librealsense itself records and filters, of a camera that exists in software alone."""

import ctypes
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from voxdepth.types import Intrinsics

PERIOD_S, TIMEOUT_MS = 0.033, 5000


def librealsense() -> Any:
    """The module; a test without its wheel, or its libusb, is skipped."""
    try:
        import libusb_package

        ctypes.CDLL(str(libusb_package.get_library_path()), mode=ctypes.RTLD_GLOBAL)
        import pyrealsense2
    except (ImportError, OSError) as error:
        pytest.skip(f"librealsense: {error}")
    return pyrealsense2


def record_with_librealsense(
    path: Path, frames: Sequence[tuple[np.ndarray, np.ndarray]], camera: Intrinsics, unit_m: float = 0.001
) -> Path:
    """Record depth in units and left infrared images, from 1 s on; librealsense 2.59 and later write `.db3`."""
    rs = librealsense()
    device = rs.software_device()
    sensor = device.add_sensor("Stereo Module")
    depth = sensor.add_video_stream(_stream(rs, camera, 0, rs.stream.depth, 0, rs.format.z16, 2))
    gray = sensor.add_video_stream(_stream(rs, camera, 1, rs.stream.infrared, 1, rs.format.y8, 1))
    sensor.add_read_only_option(rs.option.depth_units, unit_m)
    sensor.add_read_only_option(rs.option.stereo_baseline, 1000 * (camera.baseline_m or 0))
    recorder = rs.recorder(str(path), device)
    recorded, queue = recorder.query_sensors()[0], rs.frame_queue(50)
    recorded.open([depth, gray])
    recorded.start(queue)
    for index, images in enumerate(frames):
        for profile, pixels in zip((depth, gray), images, strict=True):
            sensor.on_video_frame(_frame(rs, profile, pixels, index))
            queue.wait_for_frame(TIMEOUT_MS)
        time.sleep(PERIOD_S)  # A .db3 has the times at which it was recorded.
    recorded.stop()
    recorded.close()
    return path


class SoftwareCamera:
    """librealsense with a depth camera that shows what it is given. A test without librealsense is skipped."""

    def __init__(self, camera: Intrinsics) -> None:
        self.rs, self._n_frames = librealsense(), 0
        self._sensor = self.rs.software_device().add_sensor("depth")
        self._profile = self._sensor.add_video_stream(
            _stream(self.rs, camera, 0, self.rs.stream.depth, 0, self.rs.format.z16, 2)
        )
        self._sensor.add_read_only_option(self.rs.option.depth_units, 0.001)
        self._sensor.add_read_only_option(self.rs.option.stereo_baseline, 1000 * (camera.baseline_m or 0))
        self._queue = self.rs.frame_queue(1, True)
        self._sensor.open(self._profile)
        self._sensor.start(self._queue)

    def recommended_filters(self) -> list[Any]:
        """The filters that the documents of librealsense recommend, in their order, with their default settings."""
        rs = self.rs
        to_disparity, to_depth = rs.disparity_transform(True), rs.disparity_transform(False)
        return [to_disparity, rs.spatial_filter(), rs.temporal_filter(), to_depth, rs.hole_filling_filter()]

    def frame(self, units: np.ndarray) -> Any:
        """A frame with an image of depth [mm], uint16."""
        self._sensor.on_video_frame(_frame(self.rs, self._profile, np.ascontiguousarray(units), self._n_frames))
        self._n_frames += 1
        return self._queue.wait_for_frame(TIMEOUT_MS)

    @staticmethod
    def filtered(frame: Any, filters: Iterable[Any]) -> Any:
        """What filters make of a frame."""
        for each in filters:
            frame = each.process(frame)
        return frame

    def through(self, units: np.ndarray, filters: Iterable[Any]) -> np.ndarray:
        """What filters make of an image of uint16: depth, uint16, or disparity, float32."""
        image = np.array(self.filtered(self.frame(units), filters).get_data())
        return image.view(np.float32) if image.itemsize == 4 else image


def _frame(rs: Any, profile: Any, pixels: np.ndarray, index: int) -> Any:
    frame = rs.software_video_frame()
    frame.stride, frame.bpp, frame.pixels = pixels.strides[0], pixels.itemsize, pixels
    frame.timestamp, frame.frame_number = 1000 * (1 + PERIOD_S * index), index
    frame.domain = rs.timestamp_domain.hardware_clock
    frame.profile = profile.as_video_stream_profile()
    return frame


def _stream(rs: Any, camera: Intrinsics, uid: int, kind: Any, index: int, format: Any, n_bytes: int) -> Any:
    stream = rs.video_stream()
    stream.type, stream.index, stream.uid, stream.fmt, stream.bpp, stream.fps = kind, index, uid, format, n_bytes, 30
    stream.width, stream.height = camera.width_px, camera.height_px
    lens = stream.intrinsics
    lens.width, lens.height = camera.width_px, camera.height_px
    lens.fx, lens.fy, lens.ppx, lens.ppy = camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px
    stream.intrinsics = lens
    return stream
