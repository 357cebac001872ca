"""A camera as a process of its own: it publishes what lines of JSON on its standard input ask for.

A line has a `namespace`, `reliable`, whether it waits for subscribers (`wait`), and `messages`, each with the name of a
topic, the time at which it is sent, after the first [s], and what is in it.
"""

import json
import sys
import time
from array import array
from typing import Any

import numpy as np
import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, Image

from .telling import tell

KNOWN_AFTER_S = 0.5
TYPES = {"16UC1": "<u2", "32FC1": "<f4"}


class Camera:
    """Publishers by namespace and quality of service."""

    def __init__(self) -> None:
        self._node = Node("camera")
        self._made: dict[Any, Any] = {}

    def run(self, request: dict[str, Any]) -> None:
        """Publish the messages of a line."""
        made = [(each, self._message(each)) for each in request["messages"]]
        n_before = len(self._made)
        for topic in {each["topic"] for each in request["messages"]}:
            self._publisher(request, topic, is_awaited=request.get("wait", True))
        # A subscriber that the publisher knows need not know the publisher yet.
        time.sleep(KNOWN_AFTER_S if len(self._made) > n_before else 0)
        start_s = time.monotonic()
        for each, message in made:
            time.sleep(max(0.0, start_s + each.get("at_s", 0.0) - time.monotonic()))
            self._publisher(request, each["topic"]).publish(message)

    def _publisher(self, request: dict[str, Any], topic: str, is_awaited: bool = False) -> Any:
        key = (request["namespace"], topic, request.get("reliable", True))
        if key not in self._made:
            quality = ReliabilityPolicy.RELIABLE if key[2] else ReliabilityPolicy.BEST_EFFORT
            kind = CameraInfo if topic == "camera_info" else Image
            profile = QoSProfile(depth=20, reliability=quality)
            self._made[key] = self._node.create_publisher(kind, f"{key[0]}/{topic}", profile)
        until_s = time.monotonic() + 20
        while is_awaited and not self._made[key].get_subscription_count() and time.monotonic() < until_s:
            time.sleep(0.01)
        return self._made[key]

    def _message(self, given: dict[str, Any]) -> Any:
        height, width = given.get("shape", (24, 32))
        if given["topic"] == "camera_info":
            focal_px = given.get("focal_px", width / 2)
            right = -given.get("baseline_m", 0.0) * focal_px
            k = [focal_px, 0.0, width / 2 - 0.5, 0.0, focal_px, height / 2 - 0.5, 0.0, 0.0, 1.0]
            p = [*k[:3], right, *k[3:6], 0.0, *k[6:], 0.0]
            message = CameraInfo(height=height, width=width, distortion_model="plumb_bob", d=[0.0] * 5, k=k, p=p)
        else:
            encoding = given["encoding"]
            kind = TYPES.get(encoding, "u1")
            pixels = np.full((height, width, len(np.atleast_1d(given["value"]))), given["value"], kind)
            message = Image(height=height, width=width, encoding=encoding, data=array("B", pixels.tobytes()))
            message.step = pixels.nbytes // height
        message.header.frame_id = given.get("frame_id", "left")
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(given["stamp_ns"], 10**9)
        return message


def main() -> None:
    rclpy.init()
    camera = Camera()
    tell(ready=True)
    for line in sys.stdin:
        camera.run(json.loads(line))
        tell(sent=True)
    rclpy.shutdown()


if __name__ == "__main__":
    main()
