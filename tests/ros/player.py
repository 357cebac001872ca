"""A camera that plays the walk of `voxdepth bench`, as a process of its own; it tells when it has sent each frame."""

import argparse
import time
from array import array
from typing import Any

import rclpy
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, Image

from voxdepth.ros import camera_info_fields, gray_fields, millimetre_fields
from voxdepth.tools.benchmark import camera_of, played, walk

from .telling import tell

N_IMAGES = 60
KNOWN_AFTER_S = 2.0


def a_message(fields: dict[str, Any]) -> Image:
    return Image(**{**fields, "data": array("B", fields["data"].tobytes())})


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("namespace")
    for name in ("width_px", "height_px", "n"):
        parser.add_argument(name, type=int)
    parser.add_argument("rate_hz", type=float)
    arguments = parser.parse_args()
    rclpy.init()
    node, camera = Node("player"), camera_of(arguments.width_px, arguments.height_px)
    kinds = {"camera_info": CameraInfo, "image": Image, "depth": Image}
    topics = {name: node.create_publisher(kind, f"{arguments.namespace}/{name}", 5) for name, kind in kinds.items()}
    info, images = CameraInfo(**camera_info_fields(camera)), list(walk(N_IMAGES, camera))
    time.sleep(KNOWN_AFTER_S)
    start_s = time.monotonic()
    for k, frame in enumerate(played(images, arguments.n)):
        gray, depth = a_message(gray_fields(frame.gray)), a_message(millimetre_fields(frame.depth_m))
        time.sleep(max(0.0, start_s + k / arguments.rate_hz - time.monotonic()))
        stamp = node.get_clock().now().to_msg()
        for name, message in {"camera_info": info, "image": gray, "depth": depth}.items():
            message.header.stamp, message.header.frame_id = stamp, "left"
            topics[name].publish(message)
        tell(stamp_ns=stamp.sec * 10**9 + stamp.nanosec, sent_s=time.monotonic())
    rclpy.shutdown()


if __name__ == "__main__":
    main()
