"""The node: topics, parameters and threads.

The executor receives messages in a thread of its own, and the main thread corrects the latest pair, so that a slow
correction leaves out frames and delays none.
"""

import sys
from array import array
from collections.abc import Mapping
from contextlib import suppress
from copy import deepcopy
from functools import partial
from threading import Thread
from time import monotonic
from typing import Any

import rclpy
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import CameraInfo, Image

from voxdepth.errors import FrameError, VoxDepthError
from voxdepth.ros import are_apart

from .stream import TOPICS, Arrivals, Latest, Pairs, Settings

WARN_EVERY_S = 5.0
REMIND_EVERY_S = 60.0
WAIT_S = 0.2
"""How often both threads look whether ROS still runs, without images [s]."""
IMAGES = ("depth", "source", "confidence")


class VoxDepthNode(Node):
    """Subscribes to `image`, `depth` and `camera_info`; publishes `depth`, `source`, `confidence` and `camera_info`.

    What it publishes is below its own name, as in `/voxdepth/depth`. Parameters that make no sense are a `ConfigError`.
    """

    def __init__(self) -> None:
        super().__init__("voxdepth")
        # 5000 is a number as well as 5000.0; a change while the node runs would have no effect.
        kind = ParameterDescriptor(dynamic_typing=True, read_only=True)
        defaults = Settings().model_dump()
        given = {name: self.declare_parameter(name, value, kind).value for name, value in defaults.items()}
        settings = Settings.of(given)
        self._corrector = settings.message_corrector()
        self._corrector.prepare()
        self._corrector.tell = self.get_logger().info
        self._latest: Latest[tuple[Image, Image, CameraInfo]] = Latest()
        self._info: CameraInfo | None = None
        self._image_topics = {name: self.create_publisher(Image, f"~/{name}", 1) for name in IMAGES}
        self._info_topic = self.create_publisher(CameraInfo, "~/camera_info", 1)
        self._pairs = Pairs(settings.slop_s)
        self._arrivals = Arrivals({name: self.resolve_topic_name(name) for name in TOPICS}, monotonic())
        self.create_subscription(CameraInfo, "camera_info", self._keep_info, qos_profile_sensor_data)
        for number, topic in enumerate(("image", "depth")):
            self.create_subscription(Image, topic, partial(self._keep_image, number), qos_profile_sensor_data)
        self.get_logger().info(f"waiting for {', '.join(self._arrivals.topics.values())}")

    def correct_until_shutdown(self) -> None:
        """Correct the latest images until ROS ends; call it outside of the executor."""
        try:
            while rclpy.ok():
                taken = self._latest.take(WAIT_S)
                if taken is not None:
                    self._correct(*taken)
                if missing := self._arrivals.missing(monotonic()):
                    self.get_logger().warning(missing, throttle_duration_sec=WARN_EVERY_S)
        finally:
            self._corrector.close()

    def _correct(self, gray: Image, depth: Image, info: CameraInfo) -> None:
        if are_apart(gray, depth) or are_apart(info, depth):
            ids = ", ".join(repr(message.header.frame_id) for message in (gray, depth, info))
            text = f"image, depth and camera_info must be of one camera, but are in the coordinate frames {ids}"
            self.get_logger().warning(text, throttle_duration_sec=REMIND_EVERY_S)
        try:
            images = self._corrector.correct(gray, depth, info)
        except FrameError as error:
            self.get_logger().warning(f"a frame is left out: {error}", throttle_duration_sec=WARN_EVERY_S)
            return
        try:
            self._publish(images, depth.header, info)
        except Exception:
            if rclpy.ok():  # Otherwise ROS has ended meanwhile, and its publishers with it.
                raise

    def _keep_info(self, info: CameraInfo) -> None:
        self._arrivals.note("camera_info")
        self._info = info

    def _keep_image(self, topic: int, image: Image) -> None:
        self._arrivals.note(TOPICS[topic])
        pair = self._pairs.add(topic, image)
        if self._pairs.are_many_alone:
            text = f"{self._pairs.n_alone} images so far had no partner within slop_s, as in topics of different rates"
            self.get_logger().warning(text, throttle_duration_sec=REMIND_EVERY_S)
        if pair is not None and self._info is not None:
            self._latest.put((*pair, self._info))

    def _publish(self, images: Mapping[str, Mapping[str, Any]], header: Any, info: CameraInfo) -> None:
        """Publish the images and the camera with the header of the depth."""
        described = deepcopy(info)
        described.header = header
        self._info_topic.publish(described)
        for name, fields in images.items():
            # Any other type of data is checked byte by byte.
            data = array("B", fields["data"].tobytes())
            self._image_topics[name].publish(Image(header=header, **{**fields, "data": data}))


def main() -> None:
    """Run the node until ROS ends."""
    rclpy.init()
    try:
        node = VoxDepthNode()
    except VoxDepthError as error:
        rclpy.try_shutdown()
        sys.exit(f"voxdepth: {error}")
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    receiver = Thread(target=_receive, args=(executor,), daemon=True)
    receiver.start()
    try:
        with suppress(KeyboardInterrupt):
            node.correct_until_shutdown()
    finally:
        rclpy.try_shutdown()
        receiver.join()
        node.destroy_node()


def _receive(executor: SingleThreadedExecutor) -> None:
    """Receive messages until ROS ends.

    A wait without a limit would never end where ROS does just before it begins, as by SIGTERM.
    """
    with suppress(ExternalShutdownException):
        while rclpy.ok():
            executor.spin_once(timeout_sec=WAIT_S)
