"""ROS messages become arrays and back: encodings, rows, byte orders, compression, and what is refused."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.bags import ROS1, ROS2, S, camera_info, compressed, image, message
from tests.sequences import encoded
from voxdepth.errors import FrameError
from voxdepth.ros import (
    DEPTH_FIELDS,
    camera_info_fields,
    confidence_fields,
    depth_fields,
    depth_of,
    frame_of,
    gray_of,
    header_of,
    source_fields,
)
from voxdepth.types import Intrinsics

SHAPE = (5, 7)
CAMERA = Intrinsics(fx_px=6.5, fy_px=6.25, cx_px=3.25, cy_px=2.5, width_px=7, height_px=5)
UNITS = np.random.default_rng(0).integers(0, 65536, SHAPE, np.uint16)
COLOURS = np.random.default_rng(1).integers(0, 256, (*SHAPE, 4), np.uint8)
LEVELS = COLOURS[..., 0]


def an_image(*arguments: Any, **options: Any) -> Any:
    return message("sensor_msgs/msg/Image", image(*arguments, **options))


def a_compressed(data: bytes, format: str) -> Any:
    return message("sensor_msgs/msg/CompressedImage", compressed(data, format))


@pytest.mark.parametrize("padding", [0, 3])
@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize(
    ("encoding", "kind", "steps"),
    [("16UC1", "u2", 1000), ("mono16", "u2", 1000), ("16FC1", "f2", 1), ("32FC1", "f4", 1), ("64FC1", "f8", 1)],
)
def test_depth_is_the_same_in_every_encoding_byte_order_and_length_of_rows(
    encoding: str, kind: str, steps: int, order: str, padding: int
) -> None:
    stored = np.linspace(0.5 * steps, 9 * steps, 35).reshape(SHAPE).astype(order + kind)
    given = an_image(stored, encoding, padding=padding)
    for units_per_m, depth_m in ((steps, depth_of(given)), (500, depth_of(given, 500))):
        assert depth_m.dtype == np.float32
        np.testing.assert_array_equal(depth_m, stored.astype(np.float32) / np.float32(units_per_m))


@pytest.mark.parametrize("padding", [0, 5])
def test_gray_images_stay_as_they_are(padding: int) -> None:
    for encoding in ("mono8", "8UC1"):
        np.testing.assert_array_equal(gray_of(an_image(LEVELS, encoding, padding=padding)), LEVELS)
    np.testing.assert_array_equal(gray_of(a_compressed(encoded(LEVELS), "mono8; png compressed ")), LEVELS)


def test_the_order_of_the_channels_makes_no_difference() -> None:
    rgb, alpha = np.ascontiguousarray(COLOURS[..., :3]), COLOURS
    bgr, bgra = np.ascontiguousarray(rgb[..., ::-1]), np.ascontiguousarray(alpha[..., [2, 1, 0, 3]])
    expected = np.rint(rgb @ [0.299, 0.587, 0.114])
    for encoding, pixels in (("rgb8", rgb), ("bgr8", bgr), ("rgba8", alpha), ("bgra8", bgra)):
        gray = gray_of(an_image(pixels, encoding, padding=2))
        assert gray.dtype == np.uint8
        np.testing.assert_allclose(gray, expected, atol=1)


def test_what_is_written_is_read_again() -> None:
    depth_m = np.where(UNITS > 30_000, UNITS / np.float32(1000), 0).astype(np.float32)
    written = message("sensor_msgs/msg/Image", {"header": (S, "left"), **depth_fields(depth_m)})
    stored = np.frombuffer(written.data, "<f4").reshape(SHAPE)
    np.testing.assert_array_equal(np.isnan(stored), depth_m == 0)  # REP 118
    np.testing.assert_array_equal(depth_of(written), depth_m)
    levels = np.arange(35, dtype=np.uint8).reshape(SHAPE)
    for fields in (source_fields(levels), confidence_fields((levels / 255).astype(np.float32))):
        np.testing.assert_array_equal(gray_of(message("sensor_msgs/msg/Image", {"header": (S, ""), **fields})), levels)


def test_depth_in_millimetres_has_half_the_bytes_and_no_depth_is_0() -> None:
    depth_m = np.array([[0, 0.0004, 0.0126, 2.3456, 65.534, 70]], np.float32)
    written = message("sensor_msgs/msg/Image", {"header": (S, "left"), **DEPTH_FIELDS["16UC1"](depth_m)})
    assert (written.encoding, len(written.data)) == ("16UC1", depth_m.nbytes // 2)
    np.testing.assert_allclose(depth_of(written), [[0, 0.001, 0.013, 2.346, 65.534, 0]], atol=1e-6)


@pytest.mark.parametrize("store", [ROS1, ROS2], ids=["ros1", "ros2"])
def test_a_camera_and_a_header_survive_a_message(store: Any) -> None:
    info = message("sensor_msgs/msg/CameraInfo", camera_info(CAMERA, (17 * S + 5, "eye")), store)
    assert Intrinsics.from_camera_info(info) == CAMERA
    assert header_of(info) == (17 * S + 5, "eye")
    right = message("sensor_msgs/msg/CameraInfo", camera_info(CAMERA, baseline_m=0.12), store)
    assert Intrinsics.from_camera_info(right).baseline_m == pytest.approx(0.12)
    assert Intrinsics.from_camera_info(right, baseline_m=0.05).baseline_m == 0.05


def test_a_camera_without_a_projection_is_that_of_its_camera_matrix_unless_it_is_distorted() -> None:
    fields = camera_info_fields(CAMERA) | {"p": np.zeros(12)}
    assert Intrinsics.from_camera_info(SimpleNamespace(**fields)) == CAMERA
    fields["d"] = np.array([0.1, 0, 0, 0, 0])
    with pytest.raises(FrameError, match="rectify the images"):
        Intrinsics.from_camera_info(SimpleNamespace(**fields))
    with pytest.raises(FrameError, match="is the camera calibrated"):
        Intrinsics.from_camera_info(SimpleNamespace(**fields | {"k": np.zeros(9), "d": np.zeros(5)}))


def test_a_frame_has_the_stamp_of_its_depth() -> None:
    gray = an_image(LEVELS, "mono8", (2 * S, "left"))
    depth = an_image(UNITS, "16UC1", (2 * S + 10**7, "left"))
    assert frame_of(gray, depth).stamp_s == 2.01
    with pytest.raises(FrameError, match="the depth has 7x4 pixels and the gray image 7x5: take"):
        frame_of(gray, an_image(UNITS[1:], "16UC1"))


def test_compressed_depth_of_16_bits_is_read_with_and_without_a_header() -> None:
    with_header, without = bytes(12) + encoded(UNITS), encoded(UNITS)
    for data, format in (
        (with_header, "16UC1; compressedDepth png"),
        (with_header, "mono16; compressedDepth"),
        (without, "16UC1; png compressed "),
        (with_header, ""),
        (without, ""),
    ):
        np.testing.assert_array_equal(depth_of(a_compressed(data, format)), UNITS / np.float32(1000))


def test_floats_in_millimetres_are_asked_about() -> None:
    packed = bytes(4) + np.array([1e8, -1], "<f4").tobytes() + encoded(UNITS)
    for given in (an_image(UNITS.astype("<f4"), "32FC1"), a_compressed(packed, "32FC1; compressedDepth")):
        with pytest.raises(FrameError, match=r"got \d+(\.\d+)? m with units_per_m = 1; state units_per_m"):
            depth_of(given)


@pytest.mark.parametrize("format", ["32FC1; tiff compressed ", "tiff"])
def test_a_tiff_of_floats_is_depth_in_metres(format: str) -> None:
    metres = np.linspace(0.5, 9, 35, dtype=np.float32).reshape(SHAPE)
    np.testing.assert_array_equal(depth_of(a_compressed(encoded(metres, ".tiff"), format)), metres)


def test_compressed_depth_of_floats_is_read_to_the_step_it_was_stored_in() -> None:
    depth_m = np.linspace(0.5, 9, 35, dtype=np.float32).reshape(SHAPE)
    depth_m[2, 3] = 0
    a = 100 * (100 + 1)  # as compressed_depth_image_transport for 100 steps, exact at 100 m, and 10 m at most
    b = 1 - a / 10
    with np.errstate(divide="ignore"):
        stored = np.where(depth_m > 0, a / depth_m + b, 0).astype(np.uint16)
    header = np.array([0], "<i4").tobytes() + np.array([a, b], "<f4").tobytes()
    read_m = depth_of(a_compressed(header + encoded(stored), "32FC1; compressedDepth png"))
    np.testing.assert_array_equal(depth_of(a_compressed(header + encoded(stored), "compressedDepth")), read_m)
    assert read_m[2, 3] == 0
    assert (np.abs(read_m - depth_m) <= depth_m**2 / a * 1.01).all()
    assert np.abs(read_m - depth_m).max() > 0


@pytest.mark.parametrize("format", ["rgb8; jpeg compressed bgr8", "bgr8; png compressed bgr8", "jpeg", "png", ""])
def test_compressed_images_become_gray(format: str) -> None:
    flat = np.full((*SHAPE, 3), (40, 80, 120), np.uint8)
    data = encoded(flat, ".png" if "png" in format else ".jpg")
    np.testing.assert_allclose(gray_of(a_compressed(data, format)), 0.114 * 40 + 0.587 * 80 + 0.299 * 120, atol=2)


@pytest.mark.parametrize(
    ("read", "given", "problem"),
    [
        (depth_of, an_image(LEVELS, "mono8"), "expected depth as 16UC1, .*got the encoding 'mono8'"),
        (depth_of, an_image(UNITS, "bayer_rggb16"), "got the encoding 'bayer_rggb16'"),
        (gray_of, an_image(UNITS, "16UC1"), "expected a gray image as mono8"),
        (depth_of, a_compressed(bytes(12) + b"rvl", "16UC1; compressedDepth rvl"), r"cannot decode .*Depth rvl"),
        (depth_of, a_compressed(bytes(12) + encoded(UNITS)[:-40], "16UC1; compressedDepth png"), "cannot decode"),
        (depth_of, a_compressed(b"short", "16UC1; compressedDepth png"), "cannot decode"),
        (depth_of, a_compressed(bytes(12) + encoded(LEVELS), "16UC1; compressedDepth"), "16 bits in one channel"),
        (depth_of, a_compressed(encoded(LEVELS), "16UC1; png compressed"), "16 bits in one channel"),
        (gray_of, a_compressed(b"", "jpeg"), "cannot decode"),
        (gray_of, a_compressed(encoded(UNITS), "png"), "expected a compressed image of 8 bits"),
    ],
)  # fmt: skip
def test_what_is_no_image_of_that_kind_is_refused(read: Any, given: Any, problem: str) -> None:
    with pytest.raises(FrameError, match=problem):
        read(given)


@pytest.mark.parametrize(
    "change", [{"step": 13}, {"step": 15}, {"height": 4}, {"height": 6}, {"height": 0}, {"width": 8}]
)
def test_an_image_whose_bytes_do_not_fit_its_size_is_refused(change: dict[str, int]) -> None:
    with pytest.raises(FrameError, match="the message is damaged"):
        depth_of(message("sensor_msgs/msg/Image", image(UNITS, "16UC1") | change))
