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
    arguments = parser.parse_args()
    n = round(arguments.rate * arguments.seconds)
    parameters = {"corrector": arguments.corrector, "depth_encoding": arguments.encoding, "baseline_m": 0.05}
    with Peer("listener") as listener, node_process(NAMESPACE, **parameters) as node:
        node.wait_for_text("waiting for", GRACE_S)
        listener.request("listens", namespace=NAMESPACE, reliable=True)
        size = arguments.size.split("x")
        with Process("-m", "tests.ros.player", NAMESPACE, *size, str(n), str(arguments.rate)) as player:
            assert player.ended(arguments.seconds + GRACE_S) == 0, player.text
    sent_s = {message["stamp_ns"]: message["sent_s"] for message in map(json.loads, player.lines)}
    came_s = {message["stamp_ns"]: message["at_s"] for message in listener.received(f"{NAMESPACE}/voxdepth/depth")}
    took_ms = [1000 * (at_s - sent_s[stamp_ns]) for stamp_ns, at_s in came_s.items()]
    median, most = np.percentile(took_ms, [50, 95])
    sys.stdout.write(
        f"{arguments.size} at {arguments.rate:g} Hz, {arguments.corrector}, {arguments.encoding}: {median:.1f} ms "
        f"in the median, 95 % within {most:.1f} ms; {n - len(came_s)} of {n} frames left out\n"
    )


if __name__ == "__main__":
    main()
