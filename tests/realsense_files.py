"""Files that librealsense itself records, of a camera that exists in software alone."""

import ctypes
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from voxdepth.types import Intrinsics

PERIOD_S = 0.033


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
            frame = rs.software_video_frame()
            frame.stride, frame.bpp, frame.pixels = pixels.strides[0], pixels.itemsize, pixels
            frame.timestamp, frame.frame_number = 1000 * (1 + PERIOD_S * index), index
            frame.domain = rs.timestamp_domain.hardware_clock
            frame.profile = profile.as_video_stream_profile()
            sensor.on_video_frame(frame)
            queue.wait_for_frame(5000)
        time.sleep(PERIOD_S)  # A .db3 has the times at which it was recorded.
    recorded.stop()
    recorded.close()
    return path


def _stream(rs: Any, camera: Intrinsics, uid: int, kind: Any, index: int, format: Any, n_bytes: int) -> Any:
    stream = rs.video_stream()
    stream.type, stream.index, stream.uid, stream.fmt, stream.bpp, stream.fps = kind, index, uid, format, n_bytes, 30
    stream.width, stream.height = camera.width_px, camera.height_px
    lens = stream.intrinsics
    lens.width, lens.height = camera.width_px, camera.height_px
    lens.fx, lens.fy, lens.ppx, lens.ppy = camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px
    stream.intrinsics = lens
    return stream
