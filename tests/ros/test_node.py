"""The node on real ROS 2: rclpy over Fast DDS, with camera, node and listener as processes of their own."""

import itertools
import json
import os
import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from .correctors import SLOW_S
from .processes import PATIENCE_S, ROOT, Peer, Process, listening, node_process, wait_until

pytestmark = pytest.mark.ros
S = 10**9
NUMBERS = itertools.count(1)
COMPILING_S = 60.0
TRIES = 5
AFTER_INFO_S = 0.03
"""When images are sent, after a camera_info: messages of several topics may arrive in any order."""
ECHO = "tests.ros.correctors:echo"


def a_namespace() -> str:
    """A namespace that no other test has, nor another run of them."""
    return f"/t{os.getpid()}_{next(NUMBERS)}"


def info(stamp_ns: int, **fields: Any) -> dict[str, Any]:
    return {"topic": "camera_info", "stamp_ns": stamp_ns, **fields}


def gray(stamp_ns: int, value: Any = 7, encoding: str = "mono8", **fields: Any) -> dict[str, Any]:
    own = {"topic": "image", "stamp_ns": stamp_ns, "value": value, "encoding": encoding}
    return {**own, "at_s": AFTER_INFO_S, **fields}


def depth(stamp_ns: int, value: float = 2000, encoding: str = "16UC1", **fields: Any) -> dict[str, Any]:
    return {**gray(stamp_ns, value, encoding), "topic": "depth", **fields}


def a_frame(stamp_ns: int, **fields: Any) -> list[dict[str, Any]]:
    return [message(stamp_ns, **fields) for message in (info, gray, depth)]


class Wired(NamedTuple):
    """A node with a camera before it and a listener behind it."""

    node: Process
    camera: Peer
    listener: Peer
    namespace: str

    def send(self, *messages: dict[str, Any], **options: Any) -> None:
        """Send messages, and return when they have been sent."""
        self.camera.request("sent", namespace=self.namespace, messages=messages, **options)

    def received(self, name: str = "depth") -> list[dict[str, Any]]:
        return self.listener.received(f"{self.namespace}/voxdepth/{name}")

    def corrected(self, *messages: dict[str, Any], **options: Any) -> list[dict[str, Any]]:
        """Send the messages of a frame, and return the depths that are published then; a frame sent again is late."""
        n_before = len(self.received())
        return self.send_until(lambda: self.received()[n_before:], *messages, **options)

    def send_until(self, is_so: Callable[[], Any], *messages: dict[str, Any], **options: Any) -> Any:
        """Send messages, and again where the node does not know their publishers yet, until a condition is true."""
        for _ in range(TRIES):
            self.send(*messages, **options)
            with suppress(AssertionError):
                return wait_until(is_so, PATIENCE_S / TRIES)
        raise AssertionError(f"nothing came of the messages; what the node told:\n{self.node.text[-3000:]}")

    def reported(self) -> dict[str, Any]:
        """What the node reported last of itself."""
        name = f"{self.namespace[1:]}/voxdepth: depth correction"

        def own() -> list[dict[str, Any]]:
            return [reported for reported in self.listener.received("diagnostics") if reported["name"] == name]

        return wait_until(own)[-1]

    def wait_until_reported(self, is_so: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """Wait until what the node reported last of itself is so."""
        return wait_until(lambda: is_so(last := self.reported()) and last)


@contextmanager
def wired(camera: Peer, listener: Peer, *arguments: str, reliable: bool = True, **parameters: Any) -> Iterator[Wired]:
    """Start a node; it has a subscriber, and waits for images."""
    namespace = a_namespace()
    with node_process(namespace, *arguments, **parameters) as node:
        node.wait_for_text("waiting for", COMPILING_S)
        listener.request("listens", namespace=namespace, reliable=reliable)
        yield Wired(node, camera, listener, namespace)


@pytest.fixture(scope="module")
def echo(camera: Peer, listener: Peer) -> Iterator[Wired]:
    """A node that adds a millimetre to the depth for each gray level."""
    with wired(camera, listener, corrector=ECHO, baseline_m=0.07, baselin_m=0.1, use_sim_time=False) as wires:
        yield wires


def test_the_node_prepares_the_corrector_before_it_subscribes_and_opens_no_socket(echo: Wired) -> None:
    reported = echo.node.text
    assert reported.index("preparing tests.ros.correctors:echo") < reported.index(
        f"waiting for {echo.namespace}/image, "
    )
    for each in (echo.node, echo.camera, echo.listener):
        assert not listening(each.process.pid)


def test_every_encoding_is_read_with_its_unit_and_published_in_metres_with_the_header_of_the_depth(echo: Wired) -> None:
    grays = {"mono8": (100, 100), "rgb8": ([200, 100, 12], 120), "bgr8": ([200, 100, 12], 85)}
    depths = {"16UC1": 2000, "32FC1": 2.0}
    for number, (gray_encoding, depth_encoding) in enumerate(itertools.product(grays, depths)):
        stamp_ns = (10 + number) * S + 123_456_789
        value, level = grays[gray_encoding]
        (out,) = echo.corrected(
            info(stamp_ns, frame_id="left"),
            gray(stamp_ns, value, gray_encoding, frame_id="left_ir"),
            depth(stamp_ns, depths[depth_encoding], depth_encoding, frame_id="left_optical"),
        )
        assert (out["stamp_ns"], out["frame_id"], out["encoding"]) == (stamp_ns, "left_optical", "32FC1")
        assert out["value"] == pytest.approx(2 + level / 1000, abs=1e-6)
    for name, encoding, value in (("source", "mono8", 1.0), ("confidence", "mono8", 255.0)):
        last = wait_until(lambda name=name: [each for each in echo.received(name) if each["stamp_ns"] == stamp_ns])
        assert (last[0]["encoding"], last[0]["value"], last[0]["frame_id"]) == (encoding, value, "left_optical")
    described = wait_until(lambda: [each for each in echo.received("camera_info") if each["stamp_ns"] == stamp_ns])
    assert (described[0]["focal_px"], described[0]["frame_id"]) == (16.0, "left_optical")


def test_a_camera_that_trembles_is_the_same_and_one_that_changes_is_reported(echo: Wired) -> None:
    n_before = echo.node.text.count("corrects a camera")
    for index in range(6):
        echo.corrected(*a_frame((20 + index) * S, focal_px=16 + 1e-6 * (index % 3)))
    assert echo.node.text.count("corrects a camera") <= max(n_before, 1)
    echo.corrected(*a_frame(30 * S, focal_px=20.0))
    echo.node.wait_for_text("32x24 pixels, focal length 20 px, baseline 0.07 m")
    echo.corrected(*a_frame(31 * S, shape=(12, 16)))
    echo.node.wait_for_text("16x12 pixels, focal length 8 px, baseline 0.07 m")


@pytest.mark.parametrize(
    ("second", "messages", "reported"),
    [
        (40, [gray(40 * S, encoding="yuv422"), depth(40 * S)], "expected a gray image as mono8"),
        (41, [gray(41 * S), depth(41 * S, encoding="mono8", value=9)], "expected depth as 16UC1"),
        (42, [gray(42 * S, shape=(12, 16)), depth(42 * S)], "the gray image 16x12"),
        (43, [gray(43 * S, shape=(12, 16)), depth(43 * S, shape=(12, 16))], "frames of this camera have shape"),
        (44, [gray(44 * S), depth(44 * S, value=2e6, encoding="32FC1")], "expected a median depth"),
    ],
)
def test_what_cannot_be_used_is_reported_and_the_next_frame_is_corrected(
    echo: Wired, second: int, messages: list[Any], reported: str
) -> None:
    n_before = len(echo.received())
    echo.send(info(second * S), *messages)
    # Warnings are 5 s apart at least, the diagnostics one.
    assert echo.wait_until_reported(lambda status: reported in status["message"])["level"] == 1
    assert echo.corrected(*a_frame(second * S + S // 2))[0]["stamp_ns"] == second * S + S // 2
    assert len(echo.received()) == n_before + 1


def test_a_frame_that_is_late_is_left_out_and_stamps_that_go_back_are_a_new_stream(echo: Wired) -> None:
    stamps_ns = [50 * S, 50 * S + 33_000_000, 50 * S + 10_000_000, 50 * S + 66_000_000]
    for stamp_ns in stamps_ns:
        echo.send(*a_frame(stamp_ns))
        time.sleep(0.1)
    wait_until(lambda: echo.received()[-1]["stamp_ns"] == stamps_ns[-1])
    assert [each["stamp_ns"] for each in echo.received()][-3:] == [stamps_ns[0], stamps_ns[1], stamps_ns[3]]
    (out,) = echo.corrected(*a_frame(2 * S))
    assert out["stamp_ns"] == 2 * S
    line = echo.node.wait_for_text("the stamps go back from")
    assert line.startswith("[WARN]")
    assert line.endswith("a new stream begins")
    assert echo.corrected(*a_frame(60 * S))[0]["stamp_ns"] == 60 * S


@pytest.mark.parametrize("rate_hz", [60, 90])
def test_at_high_rates_each_depth_has_its_own_image_also_after_one_is_lost(echo: Wired, rate_hz: int) -> None:
    n, start_ns = 60, (100 + rate_hz) * S
    messages = [info(start_ns)]
    for k in range(n):
        stamp_ns = start_ns + round(k * S / rate_hz)
        pair = [gray(stamp_ns, 10 + k % 20), depth(stamp_ns, 1000 * (1 + k % 20))]
        messages += [{**each, "at_s": 0.3 + k / rate_hz} for each in (pair if k not in (5, 6, 30) else pair[1:])]
    n_before = len(echo.received())
    echo.send(*messages)
    wait_until(lambda: echo.received()[-1]["stamp_ns"] == start_ns + round((n - 1) * S / rate_hz))
    outs = echo.received()[n_before:]
    assert n / 4 < len(outs) <= n - 3, "three have no image; on a busy machine, more are left out"
    for out in outs:
        k = round((out["stamp_ns"] - start_ns) / S * rate_hz)
        assert out["value"] == pytest.approx(1 + k % 20 + (10 + k % 20) / 1000, abs=1e-5)


def test_publishers_of_either_quality_are_received_and_one_that_dies_may_return(echo: Wired) -> None:
    for second, reliable in ((300, False), (301, True)):
        with Peer("camera") as other:
            returned = echo._replace(camera=other)
            assert returned.corrected(*a_frame(second * S), reliable=reliable)[0]["stamp_ns"] == second * S
            other.kill()
    assert echo.corrected(*a_frame(302 * S))[0]["stamp_ns"] == 302 * S


def test_a_parameter_cannot_be_set_while_the_node_runs_and_that_is_reported(echo: Wired) -> None:
    name = f"{echo.namespace}/voxdepth"
    for values in ({"slop_s": 0.01}, {"corrector": "nonsense"}):
        (answer,) = echo.listener.request("set", node=name, set=values)
        assert not answer["ok"]
        assert "read-only" in answer["reason"]


def test_a_parameter_that_the_node_does_not_have_is_reported(echo: Wired) -> None:
    (line,) = [line for line in echo.node.lines if "there is no parameter" in line]
    assert "there is no parameter 'baselin_m' (did you mean baseline_m?)" in line


def test_the_diagnostics_count_what_is_corrected_and_left_out(echo: Wired) -> None:
    echo.corrected(*a_frame(400 * S))
    n = len(echo.received())
    status = echo.wait_until_reported(
        lambda status: int(status["values"]["corrected"]) >= n and status["message"] == "corrects"
    )
    assert status["level"] == 0
    values = status["values"]
    assert 0 < float(values["rate [Hz]"]) < 30
    assert 0 < float(values["latency, median [ms]"]) <= float(values["latency, 95 % [ms]"])
    reasons = ("a newer pair came", "no partner", "no camera_info yet", "unusable")
    assert {f"left out: {reason}" for reason in reasons} < {*values}
    last = echo.wait_until_reported(lambda status: "latency, median [ms]" not in status["values"])
    assert (last["level"], last["message"]) == (1, "no frame to correct")


def test_of_frames_that_come_too_fast_the_newest_is_corrected_and_none_is_late(camera: Peer, listener: Peer) -> None:
    with wired(camera, listener, corrector="tests.ros.correctors:slow", reliable=False) as wires:
        n, rate_hz = 60, 30
        stamps_ns = [10 * S + round(k * S / rate_hz) for k in range(n)]
        pairs = [(gray(ns, at_s=k / rate_hz), depth(ns, at_s=k / rate_hz)) for k, ns in enumerate(stamps_ns)]
        wires.corrected(*a_frame(S))
        n_before = len(wires.received())
        wires.send(*itertools.chain(*pairs))
        wait_until(lambda: wires.received()[-1]["stamp_ns"] == stamps_ns[-1], 3)
        numbers = [stamps_ns.index(each["stamp_ns"]) for each in wires.received()[n_before:]]
        assert numbers == sorted(set(numbers)), "none is late"
        gaps = [b - a for a, b in itertools.pairwise(numbers)]
        assert max(gaps) <= 3 * SLOW_S * rate_hz, "what is corrected is new"
        assert len(numbers) < n / 2
        status = wires.wait_until_reported(lambda status: status["values"]["left out: a newer pair came"] != "0")
        assert int(status["values"]["left out: a newer pair came"]) <= n - len(numbers)


def test_parameters_come_from_a_file_too_and_millimetres_have_half_the_bytes(
    camera: Peer, listener: Peer, tmp_path: Path
) -> None:
    parameters = {"depth_encoding": "16UC1", "corrector": ECHO, "units_per_m": 5000, "baseline_m": 0.095}
    text = json.dumps({"/**/voxdepth": {"ros__parameters": parameters}})
    (tmp_path / "mine.yaml").write_text(text)
    with wired(camera, listener, "--params-file", str(tmp_path / "mine.yaml")) as wires:
        (out,) = wires.corrected(*a_frame(S))
        assert (out["encoding"], out["n_bytes"]) == ("16UC1", 2 * 24 * 32)
        assert out["value"] == pytest.approx(2000 / 5000 + 7 / 1000)
        wires.node.wait_for_text("baseline 0.095 m")


def test_a_camera_info_may_come_late_and_has_the_baseline_of_a_right_camera(camera: Peer, listener: Peer) -> None:
    with wired(camera, listener, corrector="temporal[fill=all]") as wires:
        wires.send(gray(S), depth(S))
        time.sleep(0.5)
        assert not wires.received()
        wires.corrected(info(2 * S, baseline_m=0.12), gray(2 * S), depth(2 * S))
        wires.node.wait_for_text("baseline 0.12 m")
        wires.wait_until_reported(lambda status: status["values"].get("tracking") == "first_frame")


def test_topics_that_nobody_publishes_are_reported_with_those_that_there_are(camera: Peer, listener: Peer) -> None:
    node = partial(wired, camera, listener, corrector=ECHO)
    with node() as all_misnamed, node() as one_misnamed, node() as no_camera:
        name = one_misnamed.namespace
        image_alone = (
            f"no message has come yet for image ({name}/image), which nobody publishes: of its type there are "
        )

        def is_without_image() -> bool:
            never = one_misnamed.reported()["message"].partition("; no message has come any more")[0]
            return never.startswith(image_alone) and f"{name}/infra1" in never and "; " not in never

        # Someone publishes the depth, but the image has another name; nobody subscribes to that.
        one_misnamed.send_until(is_without_image, info(S), depth(S), gray(S, topic="infra1"), wait=False)
        one_misnamed.node.wait_for_text(image_alone)
        assert "no partner" not in one_misnamed.node.text
        reported = all_misnamed.node.wait_for_text("no message has come yet for")
        assert all(
            f"{name} ({all_misnamed.namespace}/{name})" in reported for name in ("image", "depth", "camera_info")
        )
        all_misnamed.wait_until_reported(lambda status: "no message has come yet" in status["message"])
        left_out = "left out: no camera_info yet"
        no_camera.send_until(lambda: int(no_camera.reported()["values"][left_out]), gray(S), depth(S))
        reported = no_camera.node.wait_for_text("no message has come yet for camera_info (")
        assert f"({no_camera.namespace}/camera_info), which nobody publishes" in reported


def test_a_defect_of_the_corrector_ends_the_node_with_its_traceback(camera: Peer, listener: Peer) -> None:
    with wired(camera, listener, corrector="tests.ros.correctors:failing") as wires:
        wires.send_until(lambda: wires.node.process.poll() is not None, *a_frame(S))
        assert wires.node.ended() == 1
        assert "a defect of the corrector" in wires.node.text


def test_the_program_of_the_readme_corrects_two_cameras(camera: Peer, listener: Peer, tmp_path: Path) -> None:
    text = (ROOT / "ros2" / "voxdepth_ros" / "README.md").read_text()
    (program,) = (code for code in re.findall(r"```python\n(.*?)```", text, re.DOTALL) if "VoxDepthNode" in code)
    names = [a_namespace()[1:] for _ in range(2)]
    for name, own in zip(("front", "rear"), names, strict=True):
        program = program.replace(f'"{name}"', f'"{own}"')
    (tmp_path / "program.py").write_text(program)
    with Process(str(tmp_path / "program.py")) as node:
        node.wait_for(lambda lines: sum("waiting for" in line for line in lines) == 2, COMPILING_S)
        for number, name in enumerate(names):
            listener.request("listens", namespace=f"/{name}", reliable=True)
            image = gray(S + number, topic="left/image_rect")
            Wired(node, camera, listener, f"/{name}").corrected(info(S), image, depth(S + number))
        assert node.text.count("baseline 0.095 m") == 2
        assert node.end() == 0, node.text
        assert "Traceback" not in node.text
