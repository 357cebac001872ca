"""Bags and the messages of ROS itself: what ROS serialises is read by us, and what we write by ROS."""

from array import array
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Header

from tests.commands import invoke
from voxdepth.datasets import open_dataset
from voxdepth.ros import camera_info_fields, depth_of, gray_of, header_of
from voxdepth.types import Intrinsics

pytestmark = pytest.mark.ros
CAMERA = Intrinsics.from_hfov(width_px=48, height_px=32, hfov_deg=80)
N_FRAMES = 4
KINDS: dict[str, Any] = {"Image": Image, "CameraInfo": CameraInfo}
SECOND, NANOSECOND = 1_700_000_000, 987_654_321


def header(index: int) -> Header:
    made = Header(frame_id="left_optical")
    made.stamp.sec, made.stamp.nanosec = SECOND + index, NANOSECOND
    return made


def an_image(index: int, pixels: np.ndarray, encoding: str) -> Image:
    height, width = pixels.shape[:2]
    data, step = array("B", pixels.tobytes()), pixels.nbytes // height
    return Image(header=header(index), height=height, width=width, encoding=encoding, step=step, data=data)


def messages(index: int) -> dict[str, Any]:
    """What a camera publishes, in each encoding that has units."""
    random = np.random.default_rng(index)
    depth_mm = random.integers(500, 9000, CAMERA.shape, np.uint16)
    described = CameraInfo(header=header(index), **camera_info_fields(CAMERA))
    return {
        "/cam/depth/camera_info": described,
        "/cam/left/image": an_image(index, random.integers(0, 256, (*CAMERA.shape, 3), np.uint8), "rgb8"),
        "/cam/depth/image": an_image(index, depth_mm, "16UC1"),
        "/cam/floats/camera_info": described,
        "/cam/floats/image": an_image(index, (depth_mm / 1000).astype(np.float32), "32FC1"),
    }


@pytest.fixture(scope="module", params=StoragePlugin)
def bag(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bag of messages that ROS has serialised."""
    store, path = get_typestore(Stores.ROS2_JAZZY), tmp_path_factory.mktemp("bag") / "walk"
    with Writer(path, version=8, storage_plugin=request.param) as writer:
        topics = {
            topic: writer.add_connection(topic, f"sensor_msgs/msg/{type(message).__name__}", typestore=store)
            for topic, message in messages(0).items()
        }
        for index in range(N_FRAMES):
            for topic, message in messages(index).items():
                writer.write(topics[topic], header_of(message).stamp_ns + 5, serialize_message(message))
    return path


@pytest.mark.parametrize("topic", ["/cam/depth/image", "/cam/floats/image"])
def test_we_read_what_ros_has_serialised(bag: Path, topic: str) -> None:
    frames = open_dataset(bag, depth_topic=topic, gray_topic="/cam/left/image")
    assert len(frames) == N_FRAMES
    assert frames.intrinsics == CAMERA
    for index in range(N_FRAMES):
        given = messages(index)
        np.testing.assert_array_equal(frames[index].depth_m, depth_of(given[topic]))
        np.testing.assert_array_equal(frames[index].gray, gray_of(given["/cam/left/image"]))
        assert frames.header(index) == header_of(given[topic])


def raw(path: Path) -> Iterator[tuple[str, Any, Any]]:
    """The messages of a bag: topic, as rosbags reads it, and as ROS does."""
    with AnyReader([path]) as reader:
        for connection, _, data in reader.messages():
            kind = KINDS[connection.msgtype.rpartition("/")[2]]
            yield connection.topic, reader.deserialize(data, connection.msgtype), deserialize_message(data, kind)


def test_ros_reads_what_we_write(bag: Path, tmp_path: Path) -> None:
    chosen = ("--depth-topic", "/cam/depth/image", "--gray-topic", "/cam/left/image")
    invoke("correct", bag, *chosen, "--corrector", "median", "--out", tmp_path / "out.mcap")
    topics = set()
    for topic, ours, theirs in raw(tmp_path / "out.mcap"):
        topics.add(topic)
        assert header_of(theirs) == header_of(ours)
        assert (theirs.height, theirs.width) == CAMERA.shape
        if isinstance(theirs, CameraInfo):
            assert Intrinsics.from_camera_info(theirs) == CAMERA
        else:
            assert (theirs.encoding, theirs.step, bytes(theirs.data)) == (ours.encoding, ours.step, bytes(ours.data))
    assert topics == {f"/voxdepth/{name}" for name in ("gray", "depth", "source", "confidence", "camera_info")}
