"""The ROS 2 node without ROS: what it makes of messages, and how it is wired, by stand-ins for rclpy."""

import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any
from unittest import mock

import numpy as np
import pytest
import yaml

from tests.bags import S, camera_info, image, message
from voxdepth.corrector_spec import CorrectorSpec
from voxdepth.errors import FrameError
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
    assert paired((0, 100), (1, 120), (0, 200), (1, 221))[0] == [(100, 120)]
    assert paired((0, 100), (1, 100), (0, 133), (1, 134), slop_s=0.0)[0] == [(100, 100)]


def test_the_nearest_image_is_taken_and_those_before_it_are_left_out() -> None:
    images = (0, 100), (0, 110), (0, 130), (1, 112), (1, 113), (1, 131)
    assert paired(*images) == ([(110, 112), (130, 131)], 1)


def test_an_image_waits_until_there_are_too_many_later_ones() -> None:
    waiting = [(0, 100 * k) for k in range(1, 7)]
    assert paired(*waiting, (1, 200))[0] == [(200, 200)]
    assert paired(*waiting, (1, 100))[0] == []


def test_images_from_before_the_other_topic_began_are_not_told() -> None:
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


def test_topics_of_steadily_other_times_are_paired_at_once() -> None:
    n, n_right = exact_pairs(1000 / 60, {50}, offset_ms=6.0)
    assert (n, n_right) == (299, 299)


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


# The node, with stand-ins for what it uses of ROS


class Publisher:
    def __init__(self) -> None:
        self.sent: list[Any] = []

    def publish(self, sent: Any) -> None:
        self.sent.append(sent)


class FakeNode:
    """The methods of rclpy.node.Node that the node uses."""

    def __init__(self, name: str) -> None:
        self.told: list[str] = []
        self.topics: dict[str, Publisher] = {}
        self.callbacks: dict[str, Callable[[Any], None]] = {}
        self.warnings: list[str] = []
        self.settings: dict[str, Any] = {}

    def declare_parameter(self, name: str, value: Any, descriptor: Any) -> Any:
        self.settings[name] = value
        given = PARAMETERS.get(name, value)
        assert descriptor.dynamic_typing
        assert descriptor.read_only, "a change would have no effect"
        return SimpleNamespace(value=given)

    def create_publisher(self, kind: Any, topic: str, depth: int) -> Publisher:
        return self.topics.setdefault(topic, Publisher())

    def create_subscription(self, kind: Any, topic: str, callback: Any, qos: Any) -> None:
        self.callbacks[topic] = callback

    def get_logger(self) -> Any:
        return SimpleNamespace(
            warning=lambda text, throttle_duration_sec: self.warnings.append(text), info=self.told.append
        )

    def resolve_topic_name(self, name: str) -> str:
        return f"/camera/{name}"


class FakeExecutor:
    """Those of an executor; what waits without a limit never ends."""

    def add_node(self, node: Any) -> None:
        pass

    def spin_once(self, timeout_sec: float) -> None:
        time.sleep(min(timeout_sec, 0.01))


PARAMETERS: dict[str, Any] = {"corrector": "median", "units_per_m": 0, "baseline_m": 0}


@pytest.fixture
def node(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The node with stand-ins; ROS runs until all pairs are corrected."""

    def create(**fields: Any) -> Any:
        assert type(fields["data"]).__name__ == "array" and fields["data"].typecode == "B"
        return SimpleNamespace(**fields)

    modules: dict[str, dict[str, Any]] = {
        "rclpy": {"ok": lambda: True},
        "rclpy.executors": {"ExternalShutdownException": RuntimeError, "SingleThreadedExecutor": FakeExecutor},
        "rclpy.node": {"Node": FakeNode},
        "rclpy.qos": {"qos_profile_sensor_data": "sensor data"},
        "rcl_interfaces": {},
        "rcl_interfaces.msg": {"ParameterDescriptor": SimpleNamespace},
        "sensor_msgs": {},
        "sensor_msgs.msg": {"Image": create, "CameraInfo": SimpleNamespace},
    }
    for name, content in modules.items():
        module = ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)
    return import_module("voxdepth_ros.node").VoxDepthNode()


def receive(node: Any, gray: Any, depth: Any) -> None:
    node.callbacks["image"](gray)
    node.callbacks["depth"](depth)


def run(node: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the node correct what waits."""
    answers = iter([True, False, False])
    monkeypatch.setattr(sys.modules["rclpy"], "ok", lambda: next(answers))
    node.correct_until_shutdown()


def test_the_node_publishes_the_latest_pair_with_the_header_of_its_depth(
    node: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    receive(node, gray_message(S), depth_message(S))
    node.callbacks["camera_info"](info_message())
    for stamp_ns in (2 * S, 3 * S):
        receive(node, gray_message(stamp_ns), depth_message(stamp_ns))
    run(node, monkeypatch)
    assert node.topics.keys() == {"~/depth", "~/source", "~/confidence", "~/camera_info"}
    for topic in node.topics.values():
        assert [header_of(sent) for sent in topic.sent] == [(3 * S, "left_optical")]
    (described,) = node.topics["~/camera_info"].sent
    assert Intrinsics.from_camera_info(described).shape == CAMERA.shape
    assert depth_of(node.topics["~/depth"].sent[0]).shape == CAMERA.shape


def test_the_node_warns_of_a_bad_frame_and_goes_on(node: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    node.callbacks["camera_info"](info_message())
    receive(node, gray_message(S), gray_message(S))
    run(node, monkeypatch)
    assert "a frame is left out: expected depth as 16UC1" in node.warnings[0]
    assert not node.topics["~/depth"].sent
    receive(node, gray_message(2 * S), depth_message(2 * S))
    run(node, monkeypatch)
    assert len(node.topics["~/depth"].sent) == 1


def test_the_node_warns_of_images_without_a_partner_and_of_other_cameras(
    node: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    node.callbacks["camera_info"](info_message())
    receive(node, gray_message(S), depth_message(S))
    for stamp_ns in range(2 * S, 16 * S, S):
        assert not node.warnings
        node.callbacks["depth"](depth_message(stamp_ns))
    node.callbacks["depth"](depth_message(16 * S))
    assert node.warnings[-1] == "10 images so far had no partner within slop_s, as in topics of different rates"
    gray = gray_message(16 * S)
    gray.header.frame_id = "rear"
    node.callbacks["image"](gray)
    run(node, monkeypatch)
    assert "of one camera, but are in the coordinate frames 'rear', 'left_optical', 'left'" in node.warnings[-1]
    assert len(node.topics["~/depth"].sent) == 1


def test_a_publisher_that_ros_has_ended_is_no_error(node: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def ended(message: Any) -> None:
        raise RuntimeError("the context is invalid")

    node.callbacks["camera_info"](info_message())
    monkeypatch.setattr(node.topics["~/camera_info"], "publish", ended)
    receive(node, gray_message(S), depth_message(S))
    run(node, monkeypatch)
    node._corrector.correct(gray_message(2 * S), depth_message(2 * S), info_message())
    receive(node, gray_message(3 * S), depth_message(3 * S))
    monkeypatch.setattr(sys.modules["rclpy"], "ok", lambda: True)
    with pytest.raises(RuntimeError, match="context is invalid"):
        node.correct_until_shutdown()


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"slop_s": -1}, "parameters of the node: slop_s: expected at least 0, got -1"),
        ({"units_per_m": "many"}, "parameters of the node: units_per_m: expected a valid number, got 'many'"),
        ({"corrector": "temporl"}, "there is no corrector 'temporl' (did you mean temporal?)"),
        ({"corrector": "temporal[fil=all]"}, "unknown key 'fil'"),
        ({"config": "nowhere.toml"}, "cannot read the config 'nowhere.toml' as TOML"),
    ],
)
def test_parameters_that_make_no_sense_end_the_node_in_one_line(
    node: Any, given: dict[str, Any], told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in given.items():
        monkeypatch.setitem(PARAMETERS, name, value)
    monkeypatch.setattr(sys.modules["rclpy"], "init", lambda: None, raising=False)
    monkeypatch.setattr(sys.modules["rclpy"], "try_shutdown", lambda: None, raising=False)
    with pytest.raises(SystemExit) as ended:
        import_module("voxdepth_ros.node").main()
    assert str(ended.value.code).startswith("voxdepth: ")
    assert told in str(ended.value.code)
    assert "\n" not in str(ended.value.code)


def test_a_corrector_with_settings_counts_before_the_file(node: Any, tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text("fill = 'sure'\nshadow_factor = 1.0\n")
    settings = stream().Settings.of({"corrector": "temporal[fill=all]", "config": str(tmp_path / "mine.toml")})
    assert settings.message_corrector()._spec.config == {"fill": "all", "shadow_factor": 1.0}


@pytest.mark.parametrize("corrector", ["realsense", "temporal", "global-smoother"])
def test_without_a_baseline_the_assumed_one_serves_every_corrector_and_is_told(corrector: str) -> None:
    told: list[str] = []
    messages = stream().MessageCorrector(CorrectorSpec(name=corrector))
    messages.tell = told.append
    messages.correct(gray_message(S), depth_message(S), info_message())
    assert told == [
        f"{corrector} corrects a camera of 32x24 pixels, focal length {CAMERA.fx_px:.6g} px, baseline 0.05 m "
        "(assumed: camera_info has none; set baseline_m)"
    ]


def test_topics_without_a_message_are_told_after_a_while(node: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    assert node.told == ["waiting for /camera/image, /camera/depth, /camera/camera_info"]
    run(node, monkeypatch)
    assert not node.warnings
    receive(node, gray_message(S), depth_message(S))
    now_s = time.monotonic()
    monkeypatch.setattr(sys.modules["voxdepth_ros.node"], "monotonic", lambda: now_s + 6)
    run(node, monkeypatch)
    (warning,) = node.warnings
    assert warning.startswith("no message has come yet for camera_info (/camera/camera_info): is it published")
    node.callbacks["camera_info"](info_message())
    run(node, monkeypatch)
    assert len(node.warnings) == 1


def test_the_node_ends_with_ros_although_no_message_comes(node: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    runs = [True]
    ended: list[str] = []
    fake = {"init": lambda: None, "ok": lambda: bool(runs), "try_shutdown": runs.clear}
    for name, call in fake.items():
        monkeypatch.setattr(sys.modules["rclpy"], name, call, raising=False)
    monkeypatch.setattr(FakeNode, "destroy_node", lambda self: ended.append("node"), raising=False)
    monkeypatch.setattr(type(node), "correct_until_shutdown", lambda self: None)
    import_module("voxdepth_ros.node").main()
    assert ended == ["node"]


def test_the_parameters_of_the_file_are_those_of_the_node(node: Any) -> None:
    given = yaml.safe_load((PACKAGE / "config" / "voxdepth.yaml").read_text())["/**/voxdepth"]["ros__parameters"]
    assert given == node.settings


def test_every_file_that_is_installed_exists() -> None:
    setup = (PACKAGE / "setup.py").read_text()
    for name in ("package.xml", "launch/voxdepth.launch.py", "config/voxdepth.yaml", "resource/voxdepth_ros"):
        assert (PACKAGE / name).is_file()
        assert name.replace("voxdepth_ros", "{NAME}") in setup or name in setup
