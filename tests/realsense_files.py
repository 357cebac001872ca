"""What librealsense itself records and filters, of a camera that exists in software alone."""

import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from voxdepth.tools.librealsense import (
    PERIOD_S,
    TIMEOUT_MS,
    SoftwareCamera,
    librealsense,
    video_frame,
    video_stream,
)
from voxdepth.types import Intrinsics


def realsense() -> Any:
    """The module; a test without its wheel, or its libusb, is skipped."""
    try:
        return librealsense()
    except (ImportError, OSError) as error:
        pytest.skip(f"librealsense: {error}")


def software_camera(camera: Intrinsics) -> SoftwareCamera:
    """A camera that shows what it is given. A test without librealsense is skipped."""
    realsense()
    return SoftwareCamera(camera)


def through(sdk: SoftwareCamera, units: np.ndarray, filters: Iterable[Any]) -> np.ndarray:
    """What filters make of an image of uint16: depth, uint16, or disparity, float32."""
    image = np.array(sdk.filtered(sdk.frame(units), filters).get_data())
    return image.view(np.float32) if image.itemsize == 4 else image


def record_with_librealsense(
    path: Path, frames: Sequence[tuple[np.ndarray, np.ndarray]], camera: Intrinsics, unit_m: float = 0.001
) -> Path:
    """Record depth in units and left infrared images, from 1 s on; librealsense 2.59 and later write `.db3`."""
    rs = realsense()
    device = rs.software_device()
    sensor = device.add_sensor("Stereo Module")
    depth = sensor.add_video_stream(video_stream(rs, camera, 0, rs.stream.depth, 0, rs.format.z16, 2))
    gray = sensor.add_video_stream(video_stream(rs, camera, 1, rs.stream.infrared, 1, rs.format.y8, 1))
    sensor.add_read_only_option(rs.option.depth_units, unit_m)
    sensor.add_read_only_option(rs.option.stereo_baseline, 1000 * (camera.baseline_m or 0))
    recorder = rs.recorder(str(path), device)
    recorded, queue = recorder.query_sensors()[0], rs.frame_queue(50)
    recorded.open([depth, gray])
    recorded.start(queue)
    for index, images in enumerate(frames):
        for profile, pixels in zip((depth, gray), images, strict=True):
            sensor.on_video_frame(video_frame(rs, profile, pixels, index))
            queue.wait_for_frame(TIMEOUT_MS)
        time.sleep(PERIOD_S)  # A .db3 has the times at which it was recorded.
    recorded.stop()
    recorded.close()
    return path
