"""Measures how long depth takes from the camera through the node to a subscriber, and how much is left out.

    build/ros/bin/python -m tests.ros.speed [--size 640x360] [--rate 30] [--seconds 30] [--corrector temporal]

The time of a frame goes from when its images have been sent to when its depth has come; all are processes of their own.
"""

import argparse
import json
import sys

import numpy as np

from .processes import Peer, Process, node_process

NAMESPACE = "/speed"
GRACE_S = 60.0


def main() -> None:
    """Run the processes and print a line."""
    parser = argparse.ArgumentParser(prog="python -m tests.ros.speed")
    parser.add_argument("--size", default="640x360")
    parser.add_argument("--rate", type=float, default=30.0, help="frames in a second")
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--corrector", default="temporal")
    parser.add_argument("--encoding", default="32FC1", help="of the depth that is published")
    asked = parser.parse_args()
    n = round(asked.rate * asked.seconds)
    listener = Peer("listener")
    node = node_process(NAMESPACE, corrector=asked.corrector, depth_encoding=asked.encoding, baseline_m=0.05)
    try:
        node.wait_for_text("waiting for", GRACE_S)
        listener.asked("listens", namespace=NAMESPACE, reliable=True)
        size = asked.size.split("x")
        player = Process("-m", "tests.ros.player", NAMESPACE, *size, str(n), str(asked.rate))
        assert player.ended(asked.seconds + GRACE_S) == 0, player.text
        node.end()
    finally:
        node.close()
        listener.close()
    sent_s = {told["stamp_ns"]: told["sent_s"] for told in map(json.loads, player.lines)}
    came_s = {told["stamp_ns"]: told["at_s"] for told in listener.received(f"{NAMESPACE}/voxdepth/depth")}
    took_ms = [1000 * (at_s - sent_s[stamp_ns]) for stamp_ns, at_s in came_s.items()]
    median, most = np.percentile(took_ms, [50, 95])
    sys.stdout.write(
        f"{asked.size} at {asked.rate:g} Hz, {asked.corrector}, {asked.encoding}: {median:.1f} ms in the median, "
        f"95 % within {most:.1f} ms; {n - len(came_s)} of {n} frames left out\n"
    )


if __name__ == "__main__":
    main()
