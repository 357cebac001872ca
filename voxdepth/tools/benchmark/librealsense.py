"""librealsense with a camera that shows what it is given."""

import ctypes
from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt

from ...types import ASSUMED_BASELINE_M, FloatImage, Intrinsics

UNITS_PER_M = 1000.0
MAX_UNITS = 65_535
"""The farthest depth that 16 bits hold; what is farther is shown there."""
TIMEOUT_MS = 5000


class Librealsense:
    """A camera with the lens and the baseline of `camera`.

    `ImportError` or `OSError` if the wheel of librealsense, or the libusb that it needs, is missing.
    """

    def __init__(self, camera: Intrinsics) -> None:
        import libusb_package

        ctypes.CDLL(str(libusb_package.get_library_path()), mode=ctypes.RTLD_GLOBAL)
        import pyrealsense2

        self.rs: Any = pyrealsense2
        self._n_frames = 0
        self._device = self.rs.software_device()
        self._sensor = self._device.add_sensor("depth")
        self._profile = self._sensor.add_video_stream(self._stream(camera))
        self._sensor.add_read_only_option(self.rs.option.depth_units, 1 / UNITS_PER_M)
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
    def units(depth_m: FloatImage) -> npt.NDArray[np.uint16]:
        """Depth [m] in millimetres, shape (H, W)."""
        return np.asarray(np.clip(depth_m * np.float32(UNITS_PER_M), 0, MAX_UNITS), np.uint16)

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
