"""The filters of librealsense itself, behind a depth camera that exists in software alone."""

import ctypes
from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt

from ..types import Intrinsics

PERIOD_S, TIMEOUT_MS = 0.033, 5000
Units = npt.NDArray[np.uint16]
"""A depth image in millimetres."""


def librealsense() -> Any:
    """Return the module `pyrealsense2`.

    Raises:
        ImportError: It is not installed.
        OSError: It is, but a library that it needs is not, as libusb.
    """
    try:
        import libusb_package  # Its wheel has the library, where the system does not.
    except ImportError:
        pass
    else:
        ctypes.CDLL(str(libusb_package.get_library_path()), mode=ctypes.RTLD_GLOBAL)
    import pyrealsense2

    return pyrealsense2


class SoftwareCamera:
    """A depth camera that shows what it is given.

    Args:
        camera: Its intrinsics and baseline.

    Raises:
        ImportError: See `librealsense`.
        OSError: See `librealsense`.
    """

    def __init__(self, camera: Intrinsics) -> None:
        self.rs, self._n_frames = librealsense(), 0
        self._sensor = self.rs.software_device().add_sensor("depth")
        self._profile = self._sensor.add_video_stream(
            video_stream(self.rs, camera, 0, self.rs.stream.depth, 0, self.rs.format.z16, 2)
        )
        self._sensor.add_read_only_option(self.rs.option.depth_units, 0.001)
        self._sensor.add_read_only_option(self.rs.option.stereo_baseline, 1000 * (camera.baseline_m or 0))
        self._queue = self.rs.frame_queue(1, True)
        self._sensor.open(self._profile)
        self._sensor.start(self._queue)

    def recommended_filters(self) -> list[Any]:
        """Return the filters that the documents of librealsense recommend, in order, with their default settings."""
        rs = self.rs
        to_disparity, to_depth = rs.disparity_transform(True), rs.disparity_transform(False)
        return [to_disparity, rs.spatial_filter(), rs.temporal_filter(), to_depth, rs.hole_filling_filter()]

    def frame(self, units: Units) -> Any:
        """Return a frame of librealsense with a depth image of shape (H, W)."""
        self._sensor.on_video_frame(video_frame(self.rs, self._profile, np.ascontiguousarray(units), self._n_frames))
        self._n_frames += 1
        return self._queue.wait_for_frame(TIMEOUT_MS)

    @staticmethod
    def filtered(frame: Any, filters: Iterable[Any]) -> Any:
        """Return what filters make of a frame."""
        for each in filters:
            frame = each.process(frame)
        return frame


def video_frame(rs: Any, profile: Any, pixels: npt.NDArray[Any], index: int) -> Any:
    """Return a frame of a stream of librealsense with an image.

    Args:
        rs: The module `pyrealsense2`.
        profile: Profile of the stream.
        pixels: Its image in C order, shape (H, W).
        index: Number of the frame, from which its time follows.
    """
    frame = rs.software_video_frame()
    frame.stride, frame.bpp, frame.pixels = pixels.strides[0], pixels.itemsize, pixels
    frame.timestamp, frame.frame_number = 1000 * (1 + PERIOD_S * index), index
    frame.domain = rs.timestamp_domain.hardware_clock
    frame.profile = profile.as_video_stream_profile()
    return frame


def video_stream(rs: Any, camera: Intrinsics, uid: int, kind: Any, index: int, pixel_format: Any, n_bytes: int) -> Any:
    """Return a stream of librealsense of images of a camera at 30 Hz.

    Args:
        rs: The module `pyrealsense2`.
        camera: Intrinsics of the images.
        uid: Number of the stream, another one for each.
        kind: Its `rs.stream`, as in `rs.stream.depth`.
        index: Number of the stream among those of its kind.
        pixel_format: Its `rs.format`, as in `rs.format.z16`.
        n_bytes: Bytes of a pixel.
    """
    stream = rs.video_stream()
    stream.type, stream.index, stream.uid, stream.fmt, stream.bpp, stream.fps = (
        kind,
        index,
        uid,
        pixel_format,
        n_bytes,
        30,
    )
    stream.width, stream.height = camera.width_px, camera.height_px
    lens = stream.intrinsics
    lens.width, lens.height = camera.width_px, camera.height_px
    lens.fx, lens.fy, lens.ppx, lens.ppy = camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px
    stream.intrinsics = lens
    return stream
