"""The node: topics, parameters, diagnostics and threads.

Whoever spins the node receives messages, and a thread of the node corrects the latest pair, so that a slow correction
leaves out frames and delays none.
"""

import re
import signal
import sys
import warnings
from array import array
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from copy import deepcopy
from functools import partial
from threading import Event
from time import monotonic
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.clock import Clock, ClockType
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import CameraInfo, Image

from voxdepth.errors import FrameError, VoxDepthError, no_such
from voxdepth.interrupts import ENDING
from voxdepth.ros import are_apart

from .health import Health, Reason
from .stream import TOPICS, Arrivals, Latest, Pairs, Settings

WARN_EVERY_S = 5.0
REMIND_EVERY_S = 60.0
REPORT_EVERY_S = 1.0
WAIT_S = 0.2
"""How often threads look whether ROS still runs, without images [s]."""
IMAGES = ("depth", "source", "confidence")
OF_ROS = re.compile(r"use_sim_time$|start_type_description_service$|qos_overrides\.")
"""Parameters that every node has."""
KINDS = {"image": Image, "depth": Image, "camera_info": CameraInfo}
"""Types of the messages of the topics."""


class VoxDepthNode(Node):
    """Subscribes to `image`, `depth` and `camera_info`; publishes `depth`, `source`, `confidence` and `camera_info`.

    What it publishes is below its own name, as in `/voxdepth/depth`; `/diagnostics` has its rate, its latency and what
    it leaves out. Any executor may spin it. It corrects in a thread of its own, which `destroy_node` ends; an error
    there is raised by whoever spins the node.

    Args:
        options: Keyword arguments of `rclpy.node.Node`, as `namespace` or `parameter_overrides`.

    Raises:
        VoxDepthError: A parameter makes no sense.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__("voxdepth", automatically_declare_parameters_from_overrides=True, **options)
        self._is_closed = Event()
        self._threads = ThreadPoolExecutor(1, thread_name_prefix="voxdepth")
        try:
            settings = self._settings()
            self._prepare(settings)
        except BaseException:
            self.destroy_node()
            raise
        self._latest: Latest[tuple[Image, Image, CameraInfo, float]] = Latest()
        self._info: CameraInfo | None = None
        self._image_topics = {name: self.create_publisher(Image, f"~/{name}", 1) for name in IMAGES}
        self._info_topic = self.create_publisher(CameraInfo, "~/camera_info", 1)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 1)
        self._pairs = Pairs(settings.slop_s)
        self._health = Health(monotonic())
        topics = {name: self.resolve_topic_name(name) for name in TOPICS}
        self._arrivals = Arrivals(topics, monotonic(), once=("camera_info",))
        self.create_subscription(CameraInfo, "camera_info", self._keep_info, qos_profile_sensor_data)
        for number, topic in enumerate(("image", "depth")):
            self.create_subscription(Image, topic, partial(self._keep_image, number), qos_profile_sensor_data)
        # A simulated clock may stand still.
        self.create_timer(REPORT_EVERY_S, self._report, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._work = self._threads.submit(self._correct_until_closed)
        self.get_logger().info(f"waiting for {', '.join(self._arrivals.topics.values())}")

    def destroy_node(self) -> None:
        """End the correction, after the frame that is being corrected, and destroy the node."""
        self._is_closed.set()
        self._threads.shutdown()
        super().destroy_node()

    def _settings(self) -> Settings:
        """Declare the parameters that nobody gave, and read all; one that the node does not have is reported."""
        # 5000 is a number as well as 5000.0; a change while the node runs would have no effect.
        kind = ParameterDescriptor(dynamic_typing=True, read_only=True)
        defaults, given = Settings().model_dump(), self.get_parameters_by_prefix("")
        for name in given.keys() - defaults.keys():
            if not OF_ROS.match(name):  # A file may have parameters for all nodes.
                self.get_logger().warning(no_such("parameter", name, defaults))
        for name, value in defaults.items():
            if name in given:
                self.set_descriptor(name, kind)
            else:
                self.declare_parameter(name, value, kind)
        return Settings.of({name: self.get_parameter(name).value for name in defaults})

    def _prepare(self, settings: Settings) -> None:
        """Make what corrects messages; it is compiled before the topics are subscribed to, so that no frame waits."""
        self._corrector = settings.message_corrector()
        self.get_logger().info(f"preparing {settings.corrector}; the first time on a machine it is compiled")
        self._corrector.prepare()
        self._corrector.tell = self.get_logger().info

    def _correct_until_closed(self) -> None:
        """Correct the latest images until the node or ROS ends."""
        try:
            while self.context.ok() and not self._is_closed.is_set():
                taken = self._latest.take(WAIT_S)
                if taken is not None:
                    self._correct(*taken)
        finally:
            self._corrector.close()

    def _correct(self, gray: Image, depth: Image, info: CameraInfo, received_s: float) -> None:
        if are_apart(gray, depth) or are_apart(info, depth):
            ids = ", ".join(repr(message.header.frame_id) for message in (gray, depth, info))
            text = f"image, depth and camera_info must be of one camera, but are in the coordinate frames {ids}"
            self.get_logger().warning(text, throttle_duration_sec=REMIND_EVERY_S)
        try:
            images = self._corrector.correct(gray, depth, info)
        except FrameError as error:
            self._health.leave_out(Reason.UNUSABLE, why=str(error))
            self.get_logger().warning(f"a frame is left out: {error}", throttle_duration_sec=WARN_EVERY_S)
            return
        try:
            self._publish(images, depth.header, info)
        except Exception:
            if self.context.ok():  # Otherwise ROS has ended meanwhile, and its publishers with it.
                raise
        self._health.corrected(monotonic() - received_s, self._corrector.facts)

    def _keep_info(self, info: CameraInfo) -> None:
        self._arrivals.note("camera_info", monotonic())
        self._info = info

    def _keep_image(self, topic: int, image: Image) -> None:
        self._arrivals.note(TOPICS[topic], monotonic())
        n_before = self._pairs.n_alone
        pair = self._pairs.add(topic, image)
        n_alone = self._pairs.n_alone - n_before
        self._health.leave_out(Reason.ALONE, n_alone)
        if n_alone and (many := self._pairs.many_alone()):
            text = f"{many} had no partner within slop_s, as in topics of different rates"
            self.get_logger().warning(text, throttle_duration_sec=REMIND_EVERY_S)
        if pair is not None:
            self._keep_pair(*pair)

    def _keep_pair(self, gray: Image, depth: Image) -> None:
        if self._info is None:
            self._health.leave_out(Reason.NO_CAMERA)
        elif self._latest.put((gray, depth, self._info, monotonic())):
            self._health.leave_out(Reason.OLD)

    def _report(self) -> None:
        """Tell how the correction does, and what has not come; an error of the correction is raised here."""
        if self._work.done():
            self._work.result()
        if missing := self._arrivals.missing(monotonic(), self._published):
            self.get_logger().warning(missing, throttle_duration_sec=WARN_EVERY_S)
        report = self._health.report(monotonic())
        status = DiagnosticStatus(
            level=DiagnosticStatus.OK if report.is_well else DiagnosticStatus.WARN,
            name=f"{self.get_fully_qualified_name().lstrip('/')}: depth correction",
            message=missing or report.summary,
            values=[KeyValue(key=key, value=value) for key, value in report.values.items()],
        )
        message = DiagnosticArray(status=[status])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)

    def _published(self, name: str) -> list[str]:
        """Return the topics of others that have the type of one of ours."""
        kind = KINDS[name]
        full = f"{kind.__module__.partition('.')[0]}/msg/{kind.__name__}"
        own = f"{self.get_fully_qualified_name()}/"
        return [
            topic
            for topic, kinds in self.get_topic_names_and_types()
            if full in kinds and self.count_publishers(topic) and not topic.startswith(own)
        ]

    def _publish(self, images: Mapping[str, Mapping[str, Any]], header: Any, info: CameraInfo) -> None:
        """Publish the images and the camera with the header of the depth."""
        described = deepcopy(info)
        described.header = header
        self._info_topic.publish(described)
        for name, fields in images.items():
            # Any other type of data is checked byte by byte.
            data = array("B", fields["data"].tobytes())
            self._image_topics[name].publish(Image(header=header, **{**fields, "data": data}))


def run() -> None:
    """Run the node until ROS or a signal ends it; what cannot be run ends the program in one line."""
    try:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:
        sys.exit(f"voxdepth: {' '.join(str(error).split())}")
    try:
        node = VoxDepthNode()
        _spin(node)
    except VoxDepthError as error:
        sys.exit(f"voxdepth: {error}")
    finally:
        rclpy.try_shutdown()


def _spin(node: VoxDepthNode) -> None:
    """Receive messages until ROS or a signal ends.

    The handlers of rclpy are not used: they end ROS while threads use it, and a wait that begins just then never ends.
    """
    is_ended = Event()
    for number in ENDING:
        signal.signal(number, lambda *_: is_ended.set())
    warnings.showwarning = lambda message, *_: node.get_logger().warning(str(message))
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        with suppress(ExternalShutdownException):
            while rclpy.ok() and not is_ended.is_set():
                executor.spin_once(timeout_sec=WAIT_S)
    finally:
        node.destroy_node()
        executor.shutdown()
