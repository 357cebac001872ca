"""A subscriber as a process of its own: it tells in lines of JSON what it receives.

Lines of JSON on its standard input name a `namespace` to listen to, or a `node` with parameters to `set`.
"""

import json
import sys
import time
from contextlib import suppress
from functools import partial
from threading import Thread
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, Image

from voxdepth.ros import depth_of, gray_of

from .telling import tell

READERS = {"32FC1": depth_of, "16UC1": depth_of, "mono8": gray_of}


def tell_image(topic: str, message: Image) -> None:
    at_s = time.monotonic()
    value = float(np.median(READERS[message.encoding](message)))
    tell_message(topic, message, encoding=message.encoding, n_bytes=len(message.data), value=value, at_s=at_s)


def tell_camera(topic: str, message: CameraInfo) -> None:
    tell_message(topic, message, focal_px=message.k[0])


def tell_message(topic: str, message: Any, **facts: Any) -> None:
    stamp_ns = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
    tell(topic=topic, stamp_ns=stamp_ns, frame_id=message.header.frame_id, **facts)


def tell_diagnostics(message: DiagnosticArray) -> None:
    for status in message.status:
        values = {each.key: each.value for each in status.values}
        tell(topic="diagnostics", name=status.name, level=status.level[0], message=status.message, values=values)


KINDS = dict.fromkeys(("depth", "source", "confidence"), (Image, tell_image)) | {
    "camera_info": (CameraInfo, tell_camera)
}


class Listener:
    """Subscribes to what nodes publish."""

    def __init__(self) -> None:
        self.node = Node("listener")
        self.node.create_subscription(DiagnosticArray, "/diagnostics", tell_diagnostics, 10)

    def obey(self) -> None:
        """Do what the lines of the standard input ask for, and end ROS after them."""
        for line in sys.stdin:
            request = json.loads(line)
            if "set" in request:
                self._set(request["node"], request["set"])
            else:
                self._listen(request["namespace"], request["reliable"])
        rclpy.shutdown()

    def _listen(self, namespace: str, reliable: bool) -> None:
        quality = ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
        for name, (kind, callback) in KINDS.items():
            topic = f"{namespace}/voxdepth/{name}"
            self.node.create_subscription(
                kind, topic, partial(callback, topic), QoSProfile(depth=20, reliability=quality)
            )
            while not self.node.count_publishers(topic):
                time.sleep(0.01)
        tell(listens=namespace)

    def _set(self, name: str, values: dict[str, Any]) -> None:
        client = AsyncParameterClient(self.node, name)
        client.wait_for_services(10)
        future = client.set_parameters([Parameter(key, value=value) for key, value in values.items()])
        future.add_done_callback(
            lambda done: tell(set=[{"ok": each.successful, "reason": each.reason} for each in done.result().results])
        )


def main() -> None:
    rclpy.init()
    listener = Listener()
    Thread(target=listener.obey, daemon=True).start()
    tell(ready=True)
    with suppress(ExternalShutdownException):
        rclpy.spin(listener.node)


if __name__ == "__main__":
    main()
