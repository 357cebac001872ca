"""The ROS 2 node without ROS: what it makes of messages, and how it is wired, by stand-ins for rclpy."""

import re
import signal
import sys
import time
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import replace
from importlib import import_module
from importlib.abc import MetaPathFinder
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any
from unittest import mock

import numpy as np
import pytest
import yaml

from tests.bags import S, camera_info, image, message
from tests.signals import delivered
from voxdepth.corrector_spec import CorrectorSpec
from voxdepth.errors import FrameError
from voxdepth.interrupts import ENDING
from voxdepth.registry import create_corrector
from voxdepth.ros import depth_of, frame_of, gray_of, header_of
from voxdepth.types import Intrinsics

PACKAGE = Path(__file__).parents[2] / "ros2" / "voxdepth_ros"
CAMERA = Intrinsics.from_hfov(width_px=32, height_px=24, hfov_deg=80, baseline_m=0.07)
WIDE = Intrinsics.from_hfov(width_px=48, height_px=24, hfov_deg=100)


@pytest.fixture(autouse=True)
def package(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The package of the node, imported for this test alone."""
    monkeypatch.syspath_prepend(str(PACKAGE))
    yield
    for name in [name for name in sys.modules if name.startswith("voxdepth_ros")]:
        del sys.modules[name]


def gray_message(stamp_ns: int, camera: Intrinsics = CAMERA, encoding: str = "mono8") -> Any:
    pixels = np.random.default_rng(stamp_ns).integers(0, 256, camera.shape, np.uint8)
    return message("sensor_msgs/msg/Image", image(pixels, encoding, (stamp_ns, "left"), padding=3))


def depth_message(stamp_ns: int, camera: Intrinsics = CAMERA) -> Any:
    pixels = np.random.default_rng(stamp_ns + 1).integers(0, 9000, camera.shape, np.uint16)
    pixels[:4] = 0
    return message("sensor_msgs/msg/Image", image(pixels, "16UC1", (stamp_ns, "left_optical")))


def stamp_of(stamp_ms: int) -> Any:
    """What has nothing but a header."""
    stamp = SimpleNamespace(sec=stamp_ms // 1000, nanosec=stamp_ms % 1000 * 1_000_000)
    return SimpleNamespace(header=SimpleNamespace(stamp=stamp, frame_id=""))


def info_message(camera: Intrinsics = CAMERA) -> Any:
    return message("sensor_msgs/msg/CameraInfo", camera_info(camera, (S, "left")))


def stream() -> ModuleType:
    return import_module("voxdepth_ros.stream")


def test_a_frame_becomes_what_the_corrector_makes_of_it() -> None:
    corrector = stream().MessageCorrector(CorrectorSpec(name="temporal"), baseline_m=0.07, units_per_m=500)
    reference = create_corrector("temporal", CAMERA)
    for index in range(3):
        gray, depth = gray_message(S + index), depth_message(S + index)
        fields = corrector.correct(gray, depth, info_message())
        expected = reference.process(frame_of(gray, depth, units_per_m=500))
        made = {name: message("sensor_msgs/msg/Image", {"header": (0, ""), **fields[name]}) for name in fields}
        np.testing.assert_array_equal(depth_of(made["depth"]), expected.depth_m)
        np.testing.assert_array_equal(gray_of(made["source"]), expected.source)
        np.testing.assert_allclose(gray_of(made["confidence"]) / 255, expected.confidence, atol=0.002)


@pytest.mark.filterwarnings("ignore:the stamps go back")
def test_another_camera_gets_a_new_corrector_and_an_earlier_stamp_a_new_stream(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[Any] = []

    def create(spec: CorrectorSpec, camera: Intrinsics) -> Any:
        made.append(mock.Mock(wraps=create_corrector("median", camera), close=mock.Mock()))
        return made[-1]

    monkeypatch.setattr(CorrectorSpec, "create", create)
    corrector = stream().MessageCorrector(CorrectorSpec(name="median"), baseline_m=0.07)
    for stamp_ns in (S, 2 * S, S, 3 * S):
        corrector.correct(gray_message(stamp_ns), depth_message(stamp_ns), info_message())
    assert [call[0] for call in made[0].method_calls] == ["process", "process", "reset", "process", "process"]
    corrector.correct(gray_message(S, WIDE), depth_message(S, WIDE), info_message(WIDE))
    assert [len(made), made[0].method_calls[-1][0], made[1].close.called] == [2, "close", False]
    corrector.close()
    made[1].close.assert_called_once()


@pytest.mark.parametrize(
    ("gray", "depth", "info"),
    [
        (gray_message(9 * S, encoding="yuv422"), depth_message(9 * S), info_message()),
        (gray_message(9 * S), gray_message(9 * S), info_message()),
        (gray_message(9 * S, WIDE), depth_message(9 * S), info_message()),
        (gray_message(9 * S), depth_message(9 * S), info_message(WIDE)),
        (gray_message(S), depth_message(S), info_message()),
    ],
)
def test_bad_messages_are_frame_errors_and_the_next_good_one_is_corrected(gray: Any, depth: Any, info: Any) -> None:
    corrector = stream().MessageCorrector(CorrectorSpec(name="temporal"))
    corrector.correct(gray_message(S), depth_message(S), info_message())
    with pytest.raises(FrameError):
        corrector.correct(gray, depth, info)
    assert corrector.correct(gray_message(10 * S), depth_message(10 * S), info_message())


class Cameras:
    """`camera_info` whose numbers differ from frame to frame as those of one camera do, or by more."""

    def __init__(self, **change: float) -> None:
        self._change = change

    def __call__(self, index: int) -> Any:
        moved = {name: getattr(CAMERA, name) + (index % 3) * value for name, value in self._change.items()}
        return message("sensor_msgs/msg/CameraInfo", camera_info(replace(CAMERA, **moved), (S, "left")))


@pytest.mark.parametrize(
    ("change", "n_made"),
    [
        ({"fx_px": 1e-6, "fy_px": 1e-6}, 1),
        ({"cx_px": 0.01}, 1),
        ({"fx_px": 1e-3, "cy_px": -1e-3}, 1),
        ({"fx_px": 0.1}, 6),
    ],
)
def test_a_calibration_that_trembles_keeps_the_corrector(
    change: dict[str, float], n_made: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = []
    create = CorrectorSpec.create
    monkeypatch.setattr(CorrectorSpec, "create", lambda spec, camera: made.append(camera) or create(spec, camera))
    corrector, info = stream().MessageCorrector(CorrectorSpec(name="median")), Cameras(**change)
    for index in range(6):
        corrector.correct(gray_message(S + index), depth_message(S + index), info(index))
    assert len(made) == n_made


def test_a_late_frame_is_left_out_and_the_memory_is_kept() -> None:
    spec = CorrectorSpec(name="temporal")
    corrector, reference = stream().MessageCorrector(spec), stream().MessageCorrector(spec)
    for index in range(4):
        stamp_ns = S + index * 33_000_000
        if index == 3:
            for late_ns in (stamp_ns - 50_000_000, stamp_ns - 33_000_000):
                with pytest.raises(FrameError, match="it comes late"):
                    corrector.correct(gray_message(late_ns), depth_message(late_ns), info_message())
        both = [
            each.correct(gray_message(stamp_ns), depth_message(stamp_ns), info_message())
            for each in (corrector, reference)
        ]
    assert all(np.array_equal(both[0][name]["data"], both[1][name]["data"]) for name in both[0])


def paired(*images: tuple[int, int], slop_s: float = 0.02) -> tuple[list[tuple[int, ...]], int]:
    """The stamps of the pairs of images, which are topics and stamps [ms], and the number of images left out."""
    pairs = stream().Pairs(slop_s)
    found = [pairs.add(topic, stamp_of(stamp_ms)) for topic, stamp_ms in images]
    stamps_ms = [tuple(header_of(image).stamp_ns // 1_000_000 for image in pair) for pair in found if pair is not None]
    return stamps_ms, pairs.n_alone


def test_images_are_paired_in_the_order_of_the_topics() -> None:
    assert paired((0, 100), (1, 100), (1, 133), (0, 133)) == ([(100, 100), (133, 133)], 0)


def test_stamps_may_differ_by_the_slop_and_no_more() -> None:
    assert paired((0, 50), (0, 100), (1, 120), (0, 200), (1, 221))[0] == [(100, 120)]
    assert paired((0, 100), (1, 100), (0, 133), (1, 134), slop_s=0.0)[0] == [(100, 100)]


def test_the_nearest_image_is_taken_and_those_before_it_are_left_out() -> None:
    images = (0, 100), (0, 110), (0, 130), (1, 112), (1, 113), (1, 131)
    assert paired(*images) == ([(110, 112), (130, 131)], 1)


def test_an_image_waits_until_there_are_too_many_later_ones() -> None:
    waiting = [(0, 100 * k) for k in range(1, 7)]
    assert paired(*waiting, (1, 200))[0] == [(200, 200)]
    assert paired(*waiting, (1, 100))[0] == []


def test_images_from_before_the_other_topic_began_are_not_reported() -> None:
    waiting = [(0, 100 * k) for k in range(1, 9)]
    assert paired(*waiting, (1, 800)) == ([(800, 800)], 0)
    assert paired((1, 50), *waiting, (1, 800)) == ([(800, 800)], 8)


def exact_pairs(period_ms: float, lost: set[int], offset_ms: float = 0.0) -> tuple[int, int]:
    """The number of pairs of 300 images of two topics, some of the first lost, and of those of one time."""
    both = [(topic, round(k * period_ms) + round(topic * offset_ms), k) for k in range(300) for topic in (0, 1)]
    pairs, _ = paired(*((topic, ms) for topic, ms, k in both if topic or k not in lost))
    return len(pairs), sum(depth_ms - gray_ms == round(offset_ms) for gray_ms, depth_ms in pairs)


@pytest.mark.parametrize("period_ms", [1000 / 30, 1000 / 60, 1000 / 90, 1000 / 200])
@pytest.mark.parametrize("lost", [{10}, {10, 11, 12}, set(range(20, 300, 7))])
def test_after_a_lost_image_each_depth_has_its_own_image_at_every_rate(period_ms: float, lost: set[int]) -> None:
    assert exact_pairs(period_ms, lost) == (300 - len(lost), 300 - len(lost))


@pytest.mark.parametrize("period_ms", [1000 / 60, 1000 / 90])
def test_where_the_first_image_is_lost_the_next_one_is_not_taken_for_it(period_ms: float) -> None:
    assert exact_pairs(period_ms, {0}) == (299, 299)


def test_topics_of_steadily_other_times_are_paired_once_their_period_is_known() -> None:
    n, n_right = exact_pairs(1000 / 60, {50}, offset_ms=6.0)
    assert (n, n_right) == (298, 298), "the first one waits for what the period is"


def test_a_late_image_loses_no_pair_but_its_own() -> None:
    on_time = [(topic, 33 * k) for k in range(1, 20) for topic in (0, 1)]
    late = [*on_time[:20], (0, 303), *on_time[20:]]
    assert paired(*late)[0] == paired(*on_time)[0]
    waits = [*on_time[:21], (0, 303), *on_time[21:]]
    assert paired(*waits)[0] == paired(*on_time)[0]


def test_a_topic_of_half_the_rate_leaves_every_second_image_of_the_other_out() -> None:
    twice, once = [(0, ms) for ms in range(0, 400, 33)], [(1, ms) for ms in range(0, 400, 66)]
    pairs, n_alone = paired(*sorted(twice + once, key=lambda image: image[1]))
    assert (len(pairs), n_alone) == (7, 6)


def test_a_bag_that_begins_again_is_paired_from_its_first_images_on() -> None:
    ended = [(0, 9000 + 33 * k) for k in range(9)]
    again = [(topic, 100 * k) for k in range(1, 9) for topic in (0, 1)]
    assert paired((1, 8000), *ended, *again)[0] == [(100 * k, 100 * k) for k in range(1, 9)]


def test_the_latest_item_wins() -> None:
    latest = stream().Latest()
    assert latest.take(0.001) is None
    for item in range(3):
        latest.put(item)
    assert (latest.take(0.001), latest.take(0.001)) == (2, None)


# The node, with stand-ins for what it uses of ROS; tests/ros runs it with ROS itself


class Publisher:
    def __init__(self) -> None:
        self.sent: list[Any] = []

    def publish(self, sent: Any) -> None:
        self.sent.append(sent)


class FakeNode:
    """The methods of rclpy.node.Node that the node uses."""

    def __init__(self, name: str, **options: Any) -> None:
        self.reported: list[str] = []
        self.topics: dict[str, Publisher] = {}
        self.callbacks: dict[str, Callable[[Any], None]] = {}
        self.warnings: list[str] = []
        self.settings: dict[str, Any] = {}
        self.options = options
        self.described: list[str] = []
        self.published = {"/camera/infra1": ["sensor_msgs/msg/Image"], "/voxdepth/depth": ["sensor_msgs/msg/Image"]}
        self.is_running = self.is_there = True
        self.context = SimpleNamespace(ok=lambda: self.is_running)

    def get_parameters_by_prefix(self, prefix: str) -> dict[str, Any]:
        assert not prefix
        return {name: SimpleNamespace(value=value) for name, value in PARAMETERS.items()}

    def declare_parameter(self, name: str, value: Any, descriptor: Any) -> None:
        assert name not in PARAMETERS
        self.settings[name] = value
        self.set_descriptor(name, descriptor)

    def set_descriptor(self, name: str, descriptor: Any) -> None:
        self.described.append(name)
        assert descriptor.dynamic_typing
        assert descriptor.read_only, "a change would have no effect"

    def get_parameter(self, name: str) -> Any:
        return SimpleNamespace(value={**self.settings, **PARAMETERS}[name])

    def create_publisher(self, kind: Any, topic: str, depth: int) -> Publisher:
        return self.topics.setdefault(topic, Publisher())

    def create_subscription(self, kind: Any, topic: str, callback: Any, qos: Any) -> None:
        self.callbacks[topic] = callback

    def create_timer(self, period_s: float, callback: Any, clock: Any) -> None:
        self.tick = callback

    def get_logger(self) -> Any:
        return SimpleNamespace(
            warning=lambda text, throttle_duration_sec=0: self.warnings.append(text), info=self.reported.append
        )

    def get_clock(self) -> Any:
        return SimpleNamespace(now=lambda: SimpleNamespace(to_msg=lambda: "now"))

    def get_fully_qualified_name(self) -> str:
        return "/voxdepth"

    def get_topic_names_and_types(self) -> list[tuple[str, list[str]]]:
        return list(self.published.items())

    def count_publishers(self, topic: str) -> int:
        return int(topic in self.published)

    def resolve_topic_name(self, name: str) -> str:
        return f"/camera/{name}"

    def destroy_node(self) -> None:
        self.is_there = False


def a_message(**fields: Any) -> Any:
    return SimpleNamespace(header=SimpleNamespace(), **fields)


def an_image(**fields: Any) -> Any:
    assert type(fields["data"]).__name__ == "array" and fields["data"].typecode == "B"
    return SimpleNamespace(**fields)


Image = type("Image", (), {"__module__": "sensor_msgs.msg._image", "__new__": lambda cls, **fields: an_image(**fields)})
CameraInfo = type("CameraInfo", (), {"__module__": "sensor_msgs.msg._camera_info"})
Status = type("DiagnosticStatus", (SimpleNamespace,), {"OK": b"\0", "WARN": b"\1"})
MODULES: dict[str, dict[str, Any]] = {
    "diagnostic_msgs": {},
    "diagnostic_msgs.msg": {"DiagnosticArray": a_message, "DiagnosticStatus": Status, "KeyValue": SimpleNamespace},
    "rclpy": {},
    "rclpy.clock": {"Clock": SimpleNamespace, "ClockType": SimpleNamespace(STEADY_TIME="steady")},
    "rclpy.executors": {"ExternalShutdownException": RuntimeError, "SingleThreadedExecutor": None},
    "rclpy.node": {"Node": FakeNode},
    "rclpy.qos": {"qos_profile_sensor_data": "sensor data"},
    "rclpy.signals": {"SignalHandlerOptions": SimpleNamespace(NO="none")},
    "rcl_interfaces": {},
    "rcl_interfaces.msg": {"ParameterDescriptor": SimpleNamespace},
    "sensor_msgs": {},
    "sensor_msgs.msg": {"Image": Image, "CameraInfo": CameraInfo},
}
PARAMETERS: dict[str, Any] = {"corrector": "median", "units_per_m": 0, "baseline_m": 0}


@pytest.fixture
def ros(monkeypatch: pytest.MonkeyPatch) -> None:
    """Stand-ins for ROS."""
    for name, content in MODULES.items():
        module = ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)


@pytest.fixture
def node(ros: None) -> Iterator[Any]:
    """The node with stand-ins; its thread runs."""
    made = import_module("voxdepth_ros.node").VoxDepthNode()
    yield made
    made.destroy_node()
    assert made._work.done()


def receive(node: Any, gray: Any, depth: Any) -> None:
    node.callbacks["image"](gray)
    node.callbacks["depth"](depth)


def wait_until(is_so: Callable[[], Any]) -> None:
    until_s = time.monotonic() + 10
    while not is_so():
        assert time.monotonic() < until_s
        time.sleep(0.002)


def status_of(node: Any) -> Any:
    """What the node tells of itself."""
    node.tick()
    (status,) = node.topics["/diagnostics"].sent[-1].status
    return status


def test_the_node_publishes_with_the_header_of_the_depth(node: Any) -> None:
    receive(node, gray_message(S), depth_message(S))
    node.callbacks["camera_info"](info_message())
    receive(node, gray_message(2 * S), depth_message(2 * S))
    wait_until(lambda: node.topics["~/confidence"].sent)
    assert node.topics.keys() == {"~/depth", "~/source", "~/confidence", "~/camera_info", "/diagnostics"}
    for name in node.topics.keys() - {"/diagnostics"}:
        assert [header_of(sent) for sent in node.topics[name].sent] == [(2 * S, "left_optical")]
    (described,) = node.topics["~/camera_info"].sent
    assert Intrinsics.from_camera_info(described).shape == CAMERA.shape
    assert depth_of(node.topics["~/depth"].sent[0]).shape == CAMERA.shape


def test_the_node_warns_of_a_bad_frame_and_goes_on(node: Any) -> None:
    node.callbacks["camera_info"](info_message())
    receive(node, gray_message(S), gray_message(S))
    wait_until(lambda: node.warnings)
    assert "a frame is left out: expected depth as 16UC1" in node.warnings[0]
    assert not node.topics["~/depth"].sent
    assert (status_of(node).level, status_of(node).message) == (b"\1", "no frame to correct")
    receive(node, gray_message(2 * S), depth_message(2 * S))
    wait_until(lambda: node.topics["~/confidence"].sent)
    assert len(node.topics["~/depth"].sent) == 1


def test_the_diagnostics_tell_of_all_that_is_left_out(node: Any) -> None:
    receive(node, gray_message(S), depth_message(S))
    node.callbacks["camera_info"](info_message())
    receive(node, gray_message(2 * S), gray_message(2 * S))
    wait_until(lambda: node.warnings)
    status = status_of(node)
    assert status.name == "voxdepth: depth correction"
    assert status.level == b"\1"
    assert status.message.startswith("frames left out: 1, the last one: expected depth as 16UC1, ")
    values = {each.key: each.value for each in status.values}
    assert (values["left out: no camera_info yet"], values["left out: unusable"]) == ("1", "1")
    receive(node, gray_message(3 * S), depth_message(3 * S))
    wait_until(lambda: status_of(node).message == "corrects")


def test_images_that_are_lost_now_and_then_are_not_many() -> None:
    pairs = stream().Pairs(slop_s=0.02)
    for index in range(400):
        for topic in (0, 1) if index % 20 != 7 else (1,):
            pairs.add(topic, stamp_of(100 * index))
    assert pairs.n_alone == 20
    assert not pairs.many_alone()
    for index in range(400, 420):
        pairs.add(1, stamp_of(100 * index))
    assert pairs.many_alone() == "17 of the last 100 images"


def test_the_node_warns_of_images_without_a_partner_and_of_other_cameras(node: Any) -> None:
    node.callbacks["camera_info"](info_message())
    receive(node, gray_message(S), depth_message(S))
    wait_until(lambda: node.topics["~/confidence"].sent)
    for stamp_ns in range(2 * S, 16 * S, S):
        assert not node.warnings
        node.callbacks["depth"](depth_message(stamp_ns))
    node.callbacks["depth"](depth_message(16 * S))
    assert node.warnings[-1] == "10 of the last 10 images had no partner within slop_s, as in topics of different rates"
    gray = gray_message(16 * S)
    gray.header.frame_id = "rear"
    node.callbacks["image"](gray)
    wait_until(lambda: len(node.topics["~/confidence"].sent) == 2)
    assert "of one camera, but are in the coordinate frames 'rear', 'left_optical', 'left'" in node.warnings[-1]


def test_a_publisher_that_ros_has_ended_is_no_error_and_any_other_is_that_of_who_spins_the_node(node: Any) -> None:
    def ended(message: Any) -> None:
        calls.append(message)
        raise RuntimeError("the context is invalid")

    calls: list[Any] = []
    node.topics["~/camera_info"].publish = ended
    node.callbacks["camera_info"](info_message())
    node.context.ok = lambda: not calls
    receive(node, gray_message(S), depth_message(S))
    wait_until(node._work.done)
    node.tick()
    again = type(node)()
    again.topics["~/camera_info"].publish = ended
    again.callbacks["camera_info"](info_message())
    receive(again, gray_message(S), depth_message(S))
    wait_until(again._work.done)
    with pytest.raises(RuntimeError, match="context is invalid"):
        again.tick()


@pytest.mark.parametrize("number", ENDING)
def test_a_signal_while_the_node_is_imported_ends_it_with_0(number: int, monkeypatch: pytest.MonkeyPatch) -> None:
    class Interrupting(MetaPathFinder):
        def find_spec(self, name: str, *_: Any) -> None:
            if name == "voxdepth_ros.node":
                signal.raise_signal(number)

    handlers = {each: signal.getsignal(each) for each in ENDING}
    monkeypatch.setattr(sys, "meta_path", [Interrupting(), *sys.meta_path])
    with delivered(number), pytest.raises(SystemExit) as exit:
        import_module("voxdepth_ros.__main__").main()
    assert exit.value.code == 0
    for each, handler in handlers.items():
        signal.signal(each, handler)


def test_another_program_makes_the_node_with_options_of_its_own(ros: None) -> None:
    node = import_module("voxdepth_ros.node").VoxDepthNode(namespace="/rear")
    assert node.options == {"namespace": "/rear", "automatically_declare_parameters_from_overrides": True}
    node.destroy_node()
    assert not node.is_there


@pytest.mark.parametrize(
    ("given", "reported"),
    [
        ({"slop_s": -1}, "parameters of the node: slop_s: expected at least 0, got -1"),
        ({"slop_s": float("nan")}, "parameters of the node: slop_s: expected"),
        ({"slop_s": float("inf")}, "parameters of the node: slop_s: expected"),
        ({"units_per_m": "many"}, "parameters of the node: units_per_m: expected a valid number, got 'many'"),
        ({"units_per_m": 0.5}, "units_per_m must be a number of 1 to 1,000,000, got 0.5"),
        ({"baseline_m": 50.0}, "the stereo baseline must be 0.001 to 10 m, got 50.0 m"),
        ({"depth_encoding": "mono8"}, "parameters of the node: depth_encoding: expected"),
        ({"corrector": "temporl"}, "there is no corrector 'temporl' (did you mean temporal?)"),
        ({"corrector": "temporal[fil=all]"}, "unknown key 'fil'"),
        ({"config": "nowhere.toml"}, "cannot read the config 'nowhere.toml' as TOML"),
    ],
)
def test_parameters_that_make_no_sense_end_the_node_in_one_line(
    ros: None, given: dict[str, Any], reported: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in given.items():
        monkeypatch.setitem(PARAMETERS, name, value)
    ended = []
    destroy = FakeNode.destroy_node
    monkeypatch.setattr(FakeNode, "destroy_node", lambda node: ended.append(node) or destroy(node))
    monkeypatch.setattr(sys.modules["rclpy"], "init", lambda signal_handler_options: None, raising=False)
    monkeypatch.setattr(sys.modules["rclpy"], "try_shutdown", lambda: None, raising=False)
    with pytest.raises(SystemExit) as exit:
        import_module("voxdepth_ros.node").run()
    assert str(exit.value.code).startswith("voxdepth: ")
    assert reported in str(exit.value.code)
    assert "\n" not in str(exit.value.code)
    assert len(ended) == 1


def test_a_corrector_with_settings_counts_before_the_file(node: Any, tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text("fill = 'sure'\nshadow_factor = 1.0\n")
    settings = stream().Settings.of({"corrector": "temporal[fill=all]", "config": str(tmp_path / "mine.toml")})
    assert settings.message_corrector()._spec.config == {"fill": "all", "shadow_factor": 1.0}


@pytest.mark.parametrize("corrector", ["realsense", "temporal", "global-smoother"])
def test_without_a_baseline_the_assumed_one_serves_every_corrector_and_is_reported(corrector: str) -> None:
    reported: list[str] = []
    messages = stream().MessageCorrector(CorrectorSpec(name=corrector))
    messages.tell = reported.append
    messages.correct(gray_message(S), depth_message(S), info_message())
    assert reported == [
        f"{corrector} corrects a camera of 32x24 pixels, focal length {CAMERA.fx_px:.6g} px, baseline 0.05 m "
        "(assumed: camera_info has none; set baseline_m)"
    ]


def test_topics_without_a_message_are_reported_after_a_while_with_those_that_there_are(
    node: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert node.reported[0].startswith("preparing median")
    assert node.reported[1:] == ["waiting for /camera/image, /camera/depth, /camera/camera_info"]
    assert status_of(node).message == "no frame to correct"
    assert not node.warnings
    node.callbacks["depth"](depth_message(S))
    now_s = time.monotonic()
    monkeypatch.setattr(sys.modules["voxdepth_ros.node"], "monotonic", lambda: now_s + 6)
    node.callbacks["depth"](depth_message(2 * S))
    reported = (
        "no message has come yet for image (/camera/image), which nobody publishes: of its type there are "
        "/camera/infra1; camera_info (/camera/camera_info), which nobody publishes, nor anything of its type"
    )
    assert status_of(node).message == node.warnings[-1] == reported
    node.published = {"/camera/camera_info": ["sensor_msgs/msg/CameraInfo"]}
    node.callbacks["image"](gray_message(S))
    node.tick()
    reported = "no message has come yet for camera_info (/camera/camera_info), which is published"
    assert node.warnings[-1] == reported
    node.callbacks["camera_info"](info_message())
    node.tick()
    assert len(node.warnings) == 2
    monkeypatch.setattr(sys.modules["voxdepth_ros.node"], "monotonic", lambda: now_s + 9)
    node.callbacks["image"](gray_message(3 * S))
    monkeypatch.setattr(sys.modules["voxdepth_ros.node"], "monotonic", lambda: now_s + 12)
    reported = (
        "no message has come any more for depth (/camera/depth), which nobody publishes, nor anything of its type"
    )
    assert status_of(node).message == node.warnings[-1] == reported, "a camera_info that came once is enough"


@pytest.mark.parametrize(
    ("given", "reported"),
    [
        ("baselin_m", "there is no parameter 'baselin_m' (did you mean baseline_m?)"),
        ("slop", "there is no parameter 'slop' (did you mean slop_s?)"),
        ("use_sim_times", "there is no parameter 'use_sim_times'; choose one of: corrector, config, "),
        ("use_sim_time", ""),
        ("qos_overrides./depth.subscription.depth", ""),
    ],
)
def test_a_parameter_that_the_node_does_not_have_is_reported(
    ros: None, given: str, reported: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(PARAMETERS, given, 0.1)
    node = import_module("voxdepth_ros.node").VoxDepthNode()
    node.destroy_node()
    assert [line.startswith(reported) for line in node.warnings] == [True] * bool(reported)


def test_the_parameters_of_the_file_are_those_of_the_node(node: Any) -> None:
    given = yaml.safe_load((PACKAGE / "config" / "voxdepth.yaml").read_text())["/**/voxdepth"]["ros__parameters"]
    assert given == stream().Settings().model_dump()
    assert given.keys() == {*node.described}


def test_the_command_of_the_node_is_that_of_the_launch_file_and_not_the_librarys() -> None:
    setup, launch = (PACKAGE / "setup.py").read_text(), (PACKAGE / "launch" / "voxdepth.launch.py").read_text()
    library = tomllib.loads((PACKAGE.parents[1] / "pyproject.toml").read_text())["project"]["scripts"]
    (command,) = re.findall(r'"(\w+) = {NAME}', setup)
    assert command not in library
    assert f'executable="{command}"' in launch


def test_every_file_that_is_installed_exists() -> None:
    setup = (PACKAGE / "setup.py").read_text()
    for name in ("package.xml", "launch/voxdepth.launch.py", "config/voxdepth.yaml", "resource/voxdepth_ros"):
        assert (PACKAGE / name).is_file()
        assert name.replace("voxdepth_ros", "{NAME}") in setup or name in setup
