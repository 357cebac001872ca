"""Bags of ROS 1 and librealsense (`.bag`), and of ROS 2 (a folder, `.db3` or `.mcap`): depth and gray of one camera.

A topic of depth or gray is found by the type of its messages and their encoding, see `voxdepth.ros`; the gray one is of
the same camera as the depth. Images are matched by nearest time within 20 ms, and a frame has the stamp of its depth.
Where no header of a topic has a stamp, the times at which messages were received count.

The `camera_info` lies beside the image, and the baseline is in that of a right camera, whose `P[3]` is negative. A
`calibration.toml` in the folder of the bag counts before both, field by field. Depth of 16 bits is in millimetres.

librealsense stores the topics of a stream below `/device_0/sensor_0/`, where options of the sensor give the unit of the
depth and the baseline in millimetres.
"""

import re
import weakref
from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import DatasetError, FrameError
from ..ros import DEPTH_ENCODINGS, GRAY_ENCODINGS, Header, encoding_of, frame_of, header_of
from ..types import Frame, Intrinsics
from ..units import Unit
from .files import CALIBRATION, calibration_path, camera_fields, choose_unit, intrinsics_from, list_folder, stated
from .pairs import WITHIN_S, matched

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader

SUFFIXES = (".bag", ".db3", ".mcap")
METADATA = "metadata.yaml"
"""File that describes a folder of ROS 2."""
IMAGE, COMPRESSED, CAMERA_INFO = (f"sensor_msgs/msg/{name}" for name in ("Image", "CompressedImage", "CameraInfo"))
UNIT_BYTES = 4
"""librealsense appends a float, the unit of depth, to images of ROS 1, which the definition of the message lacks."""
SENSOR = re.compile(r"/device_\d+/sensor_\d+")
"""Where librealsense puts the streams and options of a sensor."""
RIGHT_INFRARED = ("/Infrared_2/", "/infra2/")
"""Parts of the topics of the right camera of librealsense and realsense-ros, whose `camera_info` may be that of the
left one."""
COLOURS = [encoding for encoding, (channels, _) in GRAY_ENCODINGS.items() if channels > 1]
"""Encodings of colour images."""
COPIES = re.compile(r"/compressed(Depth)?$")
"""What ends the topic of a compressed copy of an image."""
SAME_LENS = 1e-3
"""Relative difference of the numbers of one lens."""


def bag_in(path: Path) -> Path | None:
    """Return what is to be opened: the path of a file or of a ROS 2 folder, or the only bag in a folder; else None."""
    if path.is_file():
        return path if path.suffix in SUFFIXES else None
    if (path / METADATA).is_file():
        return path
    found = [file for file in list_folder(path) if file.suffix in SUFFIXES and file.is_file()]
    return found[0] if len(found) == 1 else None


class BagDataset:
    """The frames of one camera in a bag.

    Args:
        path: A bag, or a folder with one.
        intrinsics: Intrinsics that take precedence over all others.
        depth_topic: Topic of the depth; None takes the only one.
        gray_topic: Topic of the gray image; None takes the only one of the same camera.
        units_per_m: Steps of a metre in the depth, which take precedence as the intrinsics do.

    Raises:
        DatasetError: The bag is damaged, has no or several images of depth or gray of one camera, no camera, or no two
            images of one time.
        ModuleNotFoundError: The package `rosbags` is not installed.
    """

    format = "bag"

    def __init__(
        self,
        path: Path,
        intrinsics: Intrinsics | None = None,
        *,
        depth_topic: str | None = None,
        gray_topic: str | None = None,
        within_s: float = WITHIN_S,
        units_per_m: float | None = None,
    ) -> None:
        found = bag_in(path)
        if found is None:
            raise DatasetError(f"expected a bag in {path}, got none or several: name a file ({', '.join(SUFFIXES)})")
        images = Images(Bag(found))
        depth = images.depth(depth_topic)
        gray = images.gray(gray_topic, depth)
        self._path = path
        self.intrinsics = intrinsics or _intrinsics(path, images, depth, gray)
        self._units_per_m = choose_unit(path, units_per_m, Unit(images.units_per_m(depth))).units_per_m
        self._depth, self._gray = Stream(found, depth), Stream(found, gray)
        self._frames = self._matched(within_s)

    @classmethod
    def lacking(cls, path: Path) -> str:
        """What is missing for a bag, in words; empty if there is one."""
        return "" if bag_in(path) else f"one file {' or '.join(SUFFIXES)}, or metadata.yaml of ROS 2"

    def __len__(self) -> int:
        """Number of frames."""
        return len(self._frames)

    def name(self, index: int) -> str:
        """Number of the frame."""
        return f"{range(len(self))[index]:06d}"

    def header(self, index: int) -> Header:
        """Time of a frame and the coordinate frame of its depth."""
        stamp_ns, depth, _ = self._frames[index]
        return Header(stamp_ns, self._depth.headers[depth].frame_id)

    def __getitem__(self, index: int) -> Frame:
        """See `Dataset`; a negative index counts from the end."""
        stamp_ns, depth, gray = self._frames[index]
        images = self._gray[gray], self._depth[depth]
        try:
            frame = frame_of(*images, stamp_s=stamp_ns / 1e9, units_per_m=self._units_per_m)
        except FrameError as error:
            where = f"message {depth} of {self._depth.topic} and {gray} of {self._gray.topic} in {self._path}"
            raise DatasetError(f"{where} give no frame: {error}") from error
        if frame.depth_m.shape != (shape := self.intrinsics.shape):
            raise DatasetError(
                f"expected {shape[1]}x{shape[0]} pixels in {self._path}, as camera_info or {CALIBRATION} says, got "
                f"{frame.depth_m.shape[1]}x{frame.depth_m.shape[0]}; correct the camera, or choose other topics"
            )
        return frame

    def _matched(self, within_s: float) -> list[tuple[int, int, int]]:
        """Stamp [ns] and messages of depth and gray of every frame, in order of time."""
        streams = self._depth, self._gray
        has_stamps = all(any(header.stamp_ns for header in stream.headers) for stream in streams)
        times_ns = [stream.times_ns(has_stamps) for stream in streams]
        origin_ns = times_ns[0][0]  # The nanoseconds since 1970 do not fit into a float.
        depth, gray = (_in_order([(t - origin_ns) / 1e9 for t in times]) for times in times_ns)
        frames = matched(depth, gray, *(f"{stream.topic} of {self._path}" for stream in streams), within_s=within_s)
        return [(times_ns[0][i], i, j) for _, i, j in frames]


def _in_order(times_s: Sequence[float]) -> list[tuple[float, int]]:
    """Times and numbers of messages by time. Drivers send an image again now and then at once; the first one counts."""
    return sorted((t, k) for k, t in enumerate(times_s) if k == 0 or t != times_s[k - 1])


def _intrinsics(path: Path, images: "Images", depth: str, gray: str) -> Intrinsics:
    """The camera of the depth, or else of the gray image; fields of a calibration beside the bag count before it."""
    calibration, values = calibration_path(path), camera_fields(path)
    if values:
        known: dict[str, Any] = {}
        with suppress(DatasetError):  # The calibration may be there because the camera_info describes no camera.
            camera = images.camera(depth) or images.camera(gray)
            known = {} if camera is None else stated(camera)
        return intrinsics_from({**known, **values}, calibration)
    camera = images.camera(depth) or images.camera(gray)
    if camera is None:
        raise DatasetError(
            f"{path} has no camera_info for {depth} or {gray}; record it, or write the camera into {calibration}"
        )
    return camera


class Images:
    """Which topics of a bag are depth, gray and camera of one view, by their first messages."""

    def __init__(self, bag: "Bag") -> None:
        self._bag = bag
        self._images = bag.firsts(IMAGE, COMPRESSED)
        self._infos = bag.firsts(CAMERA_INFO)

    def depth(self, named: str | None) -> str:
        """The topic of the depth: the one that is named, or the only one; anything else is a `DatasetError`."""
        topics = self._of_kind(lambda first: encoding_of(first) in DEPTH_ENCODINGS)
        return self._chosen(named, topics, f"depth ({', '.join(DEPTH_ENCODINGS)})", "--depth-topic")

    def gray(self, named: str | None, depth: str) -> str:
        """The topic of the gray or colour image: the one that is named, or the only one of the camera of the depth."""
        topics = [topic for topic in self._of_kind(_is_gray) if self._may_be_of(depth, topic)]
        what = f"the camera of {depth} in gray or colour ({', '.join(GRAY_ENCODINGS)})"
        return self._chosen(named, topics, what, "--gray-topic")

    def camera(self, topic: str) -> Intrinsics | None:
        """The camera of an image by the `camera_info` nearest to it, with the baseline of the bag if it has one.

        Raises:
            DatasetError: The `camera_info` describes no camera.
        """
        info = self._info(topic)
        if info is None:
            return None
        try:
            return Intrinsics.from_camera_info(info, baseline_m=self._baseline_m(topic))
        except FrameError as error:
            raise DatasetError(
                f"the camera_info of {topic} in {self._bag.path} describes no camera: {error}"
            ) from error

    def units_per_m(self, topic: str) -> float | None:
        """The steps of a metre in the depth; None where the bag does not state them."""
        unit_m = self._option(topic, "Depth_Units")
        return float(f"{1 / unit_m:.6g}") if unit_m else None  # The option is a float of 32 bits.

    def _chosen(self, named: str | None, topics: Sequence[str], what: str, option: str) -> str:
        path = self._bag.path
        if named in self._images:
            return named
        if named is not None:
            listed = self._listed(self._images)
            raise DatasetError(f"there are no images in the topic {named} of {path}; choose one of: {listed}")
        if len(topics) == 1:
            return topics[0]
        if topics:
            raise DatasetError(f"{path} has several images of {what}: {self._listed(topics)}; choose one with {option}")
        raise DatasetError(
            f"expected images of {what} in {path}, got {self._listed(self._images)}; record them, or choose one with "
            f"{option}"
        )

    def _listed(self, topics: Iterable[str]) -> str:
        shown = ((topic, self._images[topic]) for topic in sorted(topics))
        listed = ", ".join(f"{topic} ({getattr(first, 'encoding', None) or first.format})" for topic, first in shown)
        return listed or "no images"

    def _of_kind(self, is_kind: Callable[[Any], bool]) -> list[str]:
        """Topics of a kind of images, without compressed copies of topics that are there as they are."""
        found = [topic for topic, first in self._images.items() if is_kind(first)]
        return [topic for topic in found if _original(topic) == topic or _original(topic) not in found]

    def _may_be_of(self, depth: str, gray: str) -> bool:
        """Whether nothing says that a gray image is of another camera than the depth.

        A colour image in another coordinate frame is: depth must be aligned to it.
        """
        if any(part in gray for part in RIGHT_INFRARED):
            return False
        first, second = (_lens_of(self._info(topic)) for topic in (depth, gray))
        if first is not None and second is not None:
            return _is_same(first, second)
        return encoding_of(self._images[gray]) not in COLOURS or not self._are_apart(depth, self._images[gray])

    def _are_apart(self, topic: str, other: Any) -> bool:
        """Whether an image and another message name different coordinate frames."""
        frame_ids = {self._images[topic].header.frame_id, other.header.frame_id}
        return len(frame_ids) == 2 and "" not in frame_ids

    def _info(self, topic: str) -> Any:
        """The `camera_info` that shares most of its path with an image, or has its coordinate frame; None without.

        One that lies elsewhere and names another coordinate frame is of another camera.
        """
        shared = {name: _n_shared(name, topic) for name in self._infos}
        nearest = [name for name, n in shared.items() if n == max(shared.values())]
        if len(nearest) > 1:
            frame_id = self._images[topic].header.frame_id
            nearest = [name for name in nearest if self._infos[name].header.frame_id == frame_id]
        if len(nearest) != 1:
            return None
        info, is_beside = self._infos[nearest[0]], _folder(nearest[0]) == _folder(topic)
        return info if is_beside or not self._are_apart(topic, info) else None

    def _baseline_m(self, topic: str) -> float | None:
        """The baseline of the sensor, or of the only stereo pair whose topics are beside those of the image."""
        in_mm = self._option(topic, "Stereo_Baseline")
        if in_mm:
            return in_mm / 1000
        beside = _folder(_folder(_original(topic))) + "/"
        lenses = [_lens_of(info) for name, info in self._infos.items() if name.startswith(beside)]
        found = {round(lens.baseline_m, 6) for lens in lenses if lens is not None and lens.baseline_m is not None}
        return found.pop() if len(found) == 1 else None

    def _option(self, topic: str, name: str) -> float | None:
        """The value of an option of the sensor of a topic, which files of librealsense have."""
        sensor = SENSOR.match(topic)
        message = self._bag.first(f"{sensor[0]}/option/{name}/value") if sensor else None
        try:
            return None if message is None else float(message.data)
        except ValueError as error:
            raise DatasetError(f"expected a number as {name} of {topic} in {self._bag.path}: {error}") from error


def _is_gray(first: Any) -> bool:
    """Whether it has 8 bits; a compressed image that does not say its encoding has."""
    return encoding_of(first) in GRAY_ENCODINGS or not (hasattr(first, "encoding") or encoding_of(first))


def _lens_of(info: Any) -> Intrinsics | None:
    """The camera of a `camera_info`, with a baseline if it is the right one of a pair; None without or of no camera."""
    with suppress(FrameError):
        return None if info is None else Intrinsics.from_camera_info(info)
    return None


def _is_same(first: Intrinsics, second: Intrinsics) -> bool:
    """Whether two cameras have one lens, and none is the right one of a pair."""
    a, b = ((lens.fx_px, lens.fy_px, lens.cx_px, lens.cy_px, *lens.shape) for lens in (first, second))
    return first.baseline_m == second.baseline_m and bool(np.allclose(a, b, rtol=SAME_LENS))


def _original(topic: str) -> str:
    """The topic whose images a topic of compressed images has."""
    return COPIES.sub("", topic)


def _folder(topic: str) -> str:
    """The part of a topic that the image and the `camera_info` of one camera share."""
    return topic.rsplit("/", 1)[0]


def _n_shared(first: str, second: str) -> int:
    """Number of parts that two topics have in common from the beginning on."""
    alike = [a == b for a, b in zip(first.split("/"), second.split("/"), strict=False)]
    return [*alike, False].index(False)


class Bag:
    """The open file of a bag. Any fault of it is a `DatasetError`."""

    def __init__(self, path: Path) -> None:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore

        self.path = path
        for part in list_folder(path):
            if part.exists() and not (part.is_file() or part.is_dir()):  # To open a pipe would wait for its writer.
                raise DatasetError(f"expected files in the bag {path}, got something else in {part}; restore it")
        with _bag_errors(path):
            # Definitions in the bag count before those of this store: some bags of ROS 2 have none.
            self._reader = AnyReader([path], default_typestore=get_typestore(Stores.LATEST))
            self._reader.open()
        weakref.finalize(self, self._reader.close)

    def first(self, topic: str) -> Any:
        """The first message of a topic, or None where it has none."""
        return next((message for _, message in self.messages(topic)), None)

    def firsts(self, *kinds: str) -> dict[str, Any]:
        """The first messages of all topics of some types that have one."""
        topics = [connection.topic for connection in self._reader.connections if connection.msgtype in kinds]
        return {topic: message for topic in topics if (message := self.first(topic)) is not None}

    def messages(self, topic: str, start_ns: int | None = None) -> Iterator[tuple[int, Any]]:
        """Yield when each message of a topic was received [ns], and the message."""
        connections = [connection for connection in self._reader.connections if connection.topic == topic]
        if not connections:
            return
        with _bag_errors(self.path):
            for connection, received_ns, data in self._reader.messages(connections, start=start_ns):
                yield received_ns, _deserialised(self._reader, data, connection.msgtype)


class Stream:
    """The messages of one topic, in the order in which they were received.

    All of them are read once, so that a damaged file is found before anything is made of it. They are read forwards by
    a reader of their own, since some files have no index by which a message could be found.
    """

    def __init__(self, path: Path, topic: str) -> None:
        self.topic, self._bag = topic, Bag(path)
        self.received_ns: list[int] = []
        self.headers: list[Header] = []
        for received_ns, message in self._bag.messages(topic):
            self.received_ns.append(received_ns)
            self.headers.append(header_of(message))
        self._next, self._later = 0, self._bag.messages(topic)

    def times_ns(self, has_stamps: bool) -> list[int]:
        """Times of the messages [ns]: those of their headers, or else those of their reception."""
        return [header.stamp_ns for header in self.headers] if has_stamps else self.received_ns

    def __getitem__(self, index: int) -> Any:
        """Read one message, quickly if it is one after that before."""
        if index < self._next:
            start_ns = self.received_ns[index]
            self._next = bisect_left(self.received_ns, start_ns)
            self._later = self._bag.messages(self.topic, start_ns)
        for _, message in self._later:
            self._next += 1
            if self._next > index:
                return message
        n, path = len(self.headers), self._bag.path
        raise DatasetError(f"expected {n} messages of {self.topic} in {path}, got {self._next}")


def _deserialised(reader: "AnyReader", data: bytes, kind: str) -> Any:
    from rosbags.highlevel import AnyReaderError

    try:
        return reader.deserialize(data, kind)
    except AnyReaderError:
        if reader.is2 or kind != IMAGE:
            raise
        return reader.deserialize(data[:-UNIT_BYTES], kind)


@contextmanager
def _bag_errors(path: Path) -> Iterator[None]:
    """Turn any error of the block into a `DatasetError`: for damaged files rosbags raises errors of many types."""
    try:
        yield
    except (DatasetError, ModuleNotFoundError):
        raise
    except Exception as error:
        reason = " ".join(f"{error}".split()) or type(error).__name__
        raise DatasetError(
            f"cannot read the bag {path} ({reason}); if it was cut short, repair it with `rosbag reindex` (ROS 1), "
            "`ros2 bag reindex` or `mcap recover`"
        ) from error
