"""ROS messages as arrays, and arrays as the fields of ROS messages.

Neither ROS nor a library of messages is imported: the functions read and give the fields that the messages have in
ROS 1 and ROS 2, so that the reader of bags, the writer of bags and the node share them.

Images of depth are `sensor_msgs/Image` with 16UC1 or mono16 in millimetres or floats in metres (REP 118), gray ones
have 8 bits in one channel or several. Of `sensor_msgs/CompressedImage` PNG, TIFF and JPEG are decoded; a PNG of 16 bits
is depth whatever its format is called. `compressedDepth` begins with 12 bytes, a format and two parameters a and b, and
stores floats as 16-bit `v` with depth = a / (v - b).
"""

import re
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from .errors import FrameError
from .types import FloatImage, Frame, GrayImage, Intrinsics
from .units import Unit, to_millimetres

TIMES_S = range(2**31)
"""Seconds that a time in ROS 2 can have."""
DEPTH_ENCODINGS = {"16UC1": "u2", "mono16": "u2", "16FC1": "f2", "32FC1": "f4", "64FC1": "f8"}
"""Types of the pixels of depth, without the order of their bytes, by encoding."""
GRAY_ENCODINGS: dict[str, tuple[int, int | None]] = {
    "mono8": (1, None),
    "8UC1": (1, None),
    "rgb8": (3, cv2.COLOR_RGB2GRAY),
    "bgr8": (3, cv2.COLOR_BGR2GRAY),
    "rgba8": (4, cv2.COLOR_RGBA2GRAY),
    "bgra8": (4, cv2.COLOR_BGRA2GRAY),
}
"""Number of channels and OpenCV's conversion to gray by encoding."""
STREAM_WORDS = {"depth", "left", "infra1", "infrared1", "ir", "optical", "frame", "link"}
"""Parts of the name of a coordinate frame that do not tell from which position a camera looks."""
LABELS = re.compile(r"/voxdepth/(source|confidence)$")
"""Topics of our own results that have the encoding of gray images and are none."""
PNG, GRAY_16 = b"\x89PNG", b"\x10\0"
"""How a PNG begins, and its bytes 24 and 25 where it has 16 bits in one channel."""
DEPTH_HEADER = np.dtype([("format", "<i4"), ("a", "<f4"), ("b", "<f4")])
"""What precedes the PNG in a message of compressed depth."""


class Header(NamedTuple):
    """The part of a `std_msgs/Header` that ROS 1 and ROS 2 share."""

    stamp_ns: int
    """Time of capture [ns]."""
    frame_id: str
    """Name of the coordinate frame."""


def header_of(message: Any) -> Header:
    """Return the header of a message."""
    stamp = message.header.stamp
    return Header(int(stamp.sec) * 10**9 + int(stamp.nanosec), str(message.header.frame_id))


def are_apart(first: Any, second: Any) -> bool:
    """Return whether the coordinate frames of two messages have names of cameras at different positions."""
    ids = [str(message.header.frame_id).lower() for message in (first, second)]
    positions = [[word for word in re.findall("[a-z0-9]+", name) if word not in STREAM_WORDS] for name in ids]
    return "" not in ids and positions[0] != positions[1]


def encoding_of(message: Any) -> str:
    """Return the encoding of an image, also of a compressed one; empty where a compressed image does not show it."""
    if hasattr(message, "encoding"):
        return str(message.encoding)
    first = str(message.format).split(";")[0].strip()
    if first in DEPTH_ENCODINGS or first in GRAY_ENCODINGS:
        return first
    data = np.frombuffer(message.data, np.uint8)
    start = _start_of_png(data)
    png = bytes(data[start : start + 26])
    if not (png.startswith(PNG) and png.endswith(GRAY_16)):
        return ""
    return "32FC1" if data[4:start].any() else "16UC1"  # The parameters of floats are not zero.


def frame_of(gray: Any, depth: Any, *, stamp_s: float | None = None, units_per_m: float | None = None) -> Frame:
    """Make a frame of two images.

    Args:
        gray: An `Image` or a `CompressedImage`, gray or in colour, see `gray_of`.
        depth: An `Image` or a `CompressedImage` of depth of the same size, see `depth_of`.
        stamp_s: Time of capture; None for the stamp of the depth.
        units_per_m: Steps of a metre in the depth, see `depth_of`.

    Raises:
        FrameError: An image is of another encoding, damaged, or they differ in size.
    """
    stamp_s = header_of(depth).stamp_ns / 1e9 if stamp_s is None else stamp_s
    levels, depth_m = gray_of(gray), depth_of(depth, units_per_m)
    if levels.shape != depth_m.shape:
        sizes = "{1}x{0} pixels and the gray image {3}x{2}".format(*depth_m.shape, *levels.shape)
        raise FrameError(f"the depth has {sizes}: take the gray image of its camera, or align the depth with it")
    return Frame(stamp_s=stamp_s, gray=levels, depth_m=depth_m)


def depth_of(message: Any, units_per_m: float | None = None) -> FloatImage:
    """Read depth [m], shape (H, W), float32; 0 = invalid, see `Unit.metres`.

    Args:
        message: An `Image` or a `CompressedImage`.
        units_per_m: Steps of a metre; None takes 1000 for 16 bits and 1 for floats if the depths fit that.

    Raises:
        FrameError: The message is no depth, or is damaged.
    """
    return Unit(units_per_m).metres(values_of(message))


def values_of(message: Any) -> npt.NDArray[Any]:
    """Read depth as it is stored, shape (H, W), see `depth_of`."""
    encoding = encoding_of(message)
    if not hasattr(message, "encoding"):
        return _decoded_depth(message, encoding)
    if encoding not in DEPTH_ENCODINGS:
        raise FrameError(f"expected depth as {', '.join(DEPTH_ENCODINGS)}, got the encoding {encoding!r}")
    return _pixels(message, np.dtype(DEPTH_ENCODINGS[encoding]), 1)


def gray_of(message: Any) -> GrayImage:
    """Read a gray or colour image of 8 bits as a gray one, shape (H, W), uint8.

    Raises:
        FrameError: The message is of another encoding, or is damaged.
    """
    encoding = encoding_of(message)
    if not hasattr(message, "encoding"):
        image = _decoded(message, np.frombuffer(message.data, np.uint8))
        if image.dtype != np.uint8:
            raise FrameError(f"expected a compressed image of 8 bits, got {image.dtype} ({message.format!r})")
        return np.asarray(image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)
    if encoding not in GRAY_ENCODINGS:
        raise FrameError(f"expected a gray image as {', '.join(GRAY_ENCODINGS)}, got the encoding {encoding!r}")
    channels, conversion = GRAY_ENCODINGS[encoding]
    pixels = _pixels(message, np.dtype("u1"), channels)
    return np.asarray(pixels if conversion is None else cv2.cvtColor(pixels, conversion), np.uint8)


def _pixels(message: Any, kind: np.dtype[Any], channels: int) -> npt.NDArray[Any]:
    """Return the pixels of an image without the padding of its rows, in the byte order of this machine.

    Returns:
        A copy, shape (H, W) for one channel, else (H, W, channels).
    """
    height, width, step = int(message.height), int(message.width), int(message.step)
    row, given = width * channels * kind.itemsize, len(message.data)
    if min(height, width) < 1 or step < row or given != step * height:
        raise FrameError(
            f"expected {height} rows of at least {row} bytes for {width}x{height} pixels of {message.encoding}, got "
            f"rows of {step} bytes and {given} bytes in all: the message is damaged"
        )
    rows = np.frombuffer(message.data, np.uint8).reshape(height, step)[:, :row]
    values = np.ascontiguousarray(rows).view(kind.newbyteorder(">" if message.is_bigendian else "<"))
    shape = (height, width) if channels == 1 else (height, width, channels)
    return values.reshape(shape).astype(kind)


def _decoded_depth(message: Any, encoding: str) -> npt.NDArray[Any]:
    """Return the depth of a compressed image in its units, shape (H, W), uint16 or float32."""
    data = np.frombuffer(message.data, np.uint8)
    start = _start_of_png(data)
    image, is_packed = _decoded(message, data[start:]), start == DEPTH_HEADER.itemsize and encoding == "32FC1"
    is_whole = image.dtype == np.uint16 and (is_packed or encoding != "32FC1")
    if image.ndim != 2 or not (is_whole or (image.dtype == np.float32 and encoding in ("", "32FC1"))):
        raise FrameError(
            f"expected depth of 16 bits in one channel, or floats in a TIFF, got {image.dtype} of shape {image.shape} "
            f"({message.format!r})"
        )
    if not is_packed:
        return image
    parameters = data[:start].view(DEPTH_HEADER)[0]
    with np.errstate(divide="ignore"):
        depth_m = float(parameters["a"]) / (image - float(parameters["b"]))
    return np.where(image > 0, depth_m, 0).astype(np.float32)


def _start_of_png(data: npt.NDArray[np.uint8]) -> int:
    """Return where a PNG begins, perhaps after a header of compressed depth; 0 for other data."""
    return max(bytes(data[: DEPTH_HEADER.itemsize + len(PNG)]).find(PNG), 0)


def _decoded(message: Any, data: npt.NDArray[np.uint8]) -> npt.NDArray[Any]:
    """Return a PNG, TIFF or JPEG in a compressed image, decoded."""
    try:
        image = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if len(data) else None
    except cv2.error:
        image = None
    if image is None:
        raise FrameError(
            f"cannot decode the compressed image ({message.format!r}): only whole PNG, TIFF and JPEG are read, neither "
            "RVL nor video; republish it as PNG"
        )
    return np.asarray(image)


def depth_fields(depth_m: FloatImage) -> dict[str, Any]:
    """Return depth [m], shape (H, W), 0 = invalid, as the fields of an `Image`: 32FC1 with NaN for invalid pixels."""
    return _fields(np.where(depth_m > 0, depth_m, np.float32(np.nan)).astype("<f4"), "32FC1")


def millimetre_fields(depth_m: FloatImage) -> dict[str, Any]:
    """Return depth [m], shape (H, W), as the fields of an `Image`: 16UC1, half as many bytes, see `to_millimetres`."""
    return _fields(to_millimetres(depth_m).astype("<u2"), "16UC1")


def gray_fields(gray: GrayImage) -> dict[str, Any]:
    """Return a gray image, shape (H, W), as the fields of an `Image`: mono8."""
    return _fields(gray, "mono8")


def source_fields(source: GrayImage) -> dict[str, Any]:
    """Return one `Source` per pixel, shape (H, W), as the fields of an `Image`: mono8."""
    return _fields(source, "mono8")


def confidence_fields(confidence: FloatImage) -> dict[str, Any]:
    """Return confidence in 0..1, shape (H, W), as the fields of an `Image`: mono8 with 255 for 1."""
    return _fields(confidence_levels(confidence), "mono8")


def confidence_levels(confidence: FloatImage) -> GrayImage:
    """Return confidence in 0..1 as gray levels in 0..255, shape (H, W), uint8."""
    return np.asarray(np.rint(confidence * 255), np.uint8)


def _fields(image: npt.NDArray[Any], encoding: str) -> dict[str, Any]:
    height, width = image.shape
    return {
        "height": height,
        "width": width,
        "encoding": encoding,
        "is_bigendian": 0,
        "step": width * image.itemsize,
        "data": np.frombuffer(image.tobytes(), np.uint8),
    }


DepthFields = Callable[[FloatImage], dict[str, Any]]
"""Makes the fields of an `Image` of depth [m], shape (H, W), 0 = invalid."""
DEPTH_FIELDS: Mapping[str, DepthFields] = {"32FC1": depth_fields, "16UC1": millimetre_fields}
"""What writes depth, by the encoding."""


def camera_info_fields(camera: Intrinsics) -> dict[str, Any]:
    """Return a camera as the fields of a ROS 2 `CameraInfo` of rectified images, but for those of binning and regions.

    The baseline is not among them: in a `CameraInfo` the right camera of a pair has it.
    """
    fx, fy, cx, cy = camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px
    return {
        "height": camera.height_px,
        "width": camera.width_px,
        "distortion_model": "plumb_bob",
        "d": np.zeros(5),
        "k": np.array([fx, 0, cx, 0, fy, cy, 0, 0, 1], np.float64),
        "r": np.eye(3).ravel(),
        "p": np.array([fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1, 0], np.float64),
    }
