"""How the node ends: by signals at any time, and by arguments that make no sense."""

import os
import random
import signal
import time
from contextlib import ExitStack

import pytest

from .processes import node_process

pytestmark = pytest.mark.ros
STARTS = int(os.environ.get("VOXDEPTH_ROS_STARTS", "2"))
"""Starts that are ended by each signal, at random times."""
BAD = {
    "slop_s:=-1": "slop_s: expected at least 0, got -1",
    "baseline_m:=50": "the stereo baseline must be 0.001 to 10 m, got 50",
    "corrector:=temporal[fil=all]": "unknown key 'fil'",
    "slop_s:=[1,": "parameter override rule: '-p slop_s:=[1,'",
}
"""Parameters, of which the last is none, and a part of what is reported."""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_node_at_any_time_with_0_and_without_a_traceback(number: int) -> None:
    for start in range(STARTS):
        with node_process("/ends", "-p", "corrector:=median") as node:
            node.wait_for_text("preparing" if start % 2 else "waiting for")
            time.sleep(random.Random(f"{number} {start}").uniform(0.0, 0.3))
            assert node.end(number, timeout_s=10) == 0, node.text
            assert "Traceback" not in node.text


def test_arguments_that_make_no_sense_end_the_node_in_one_line() -> None:
    with ExitStack() as stack:
        nodes = {given: stack.enter_context(node_process("/bad", "-p", given)) for given in BAD}
        for given, node in nodes.items():
            assert node.ended() == 1, node.text
            (line,) = [line for line in node.lines if "[rcl]: Failed to parse global arguments" not in line]
            assert line.startswith("voxdepth: ")
            assert BAD[given] in line
