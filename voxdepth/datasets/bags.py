"""Bags of ROS 1 and librealsense (`.bag`), and of ROS 2 (a folder, `.db3` or `.mcap`): depth and gray of one camera.

A topic of depth or gray is found by the type of its messages and their encoding, see `voxdepth.ros`; the gray one is of
the same camera as the depth, and rectified, unless the depth is aligned to it as it is. Images are matched by nearest
time within 20 ms, in the order in which they were recorded, and a frame has the stamp of its depth. Where stamps do not
increase, or match none of the other topic, the times at which messages were received count for both.

The `camera_info` lies beside the image and is the same for all images. The baseline is in that of a right camera, whose
`P[3]` is negative. A `calibration.toml` in the folder of the bag counts before both: the whole camera, or its baseline
alone. Depth of 16 bits is in millimetres.

librealsense stores the topics of a stream below `/device_0/sensor_0/`, where options of the sensor give the unit of the
depth and the baseline in millimetres.
"""

import re
import warnings
import weakref
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import DatasetError, FrameError
from ..ros import (
    DEPTH_ENCODINGS,
    GRAY_ENCODINGS,
    LABELS,
    Header,
    are_apart,
    encoding_of,
    frame_of,
    header_of,
    values_of,
)
from ..types import SAME_LENS, Frame, Intrinsics, is_distorted
from ..units import Unit
from . import WITHIN_S
from .files import CALIBRATION, calibration_path, choose_intrinsics, choose_unit, list_folder, no_camera
from .pairs import matched

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader
    from rosbags.interfaces import Connection

SUFFIXES = (".bag", ".db3", ".mcap")
METADATA = "metadata.yaml"
"""File that describes a folder of ROS 2."""
IMAGE, COMPRESSED, CAMERA_INFO = (f"sensor_msgs/msg/{name}" for name in ("Image", "CompressedImage", "CameraInfo"))
FIELDS = {
    IMAGE: ("height", "width", "encoding", "is_bigendian", "step", "data"),
    COMPRESSED: ("format", "data"),
    CAMERA_INFO: ("height", "width"),
}
"""What is read of a message beside its header, by its type."""
UNIT_BYTES = 4
"""librealsense appends a float, the unit of depth, to images of ROS 1, which the definition of the message lacks."""
SENSOR = re.compile(r"/device_\d+/sensor_\d+")
"""Where librealsense puts the streams and options of a sensor."""
RIGHT_INFRARED = ("/Infrared_2/", "/infra2/")
"""Parts of the topics of the right camera of librealsense and realsense-ros, whose `camera_info` may be that of the
left one."""
ALIGNED = "aligned_depth_to"
"""Part of the topics of depth that realsense-ros draws in the view of another image, with the distortion of that."""
COPIES = re.compile(r"/compressed(Depth)?$")
"""What ends the topic of a compressed copy of an image."""
AT_ONCE_NS = 5_000_000
"""Time within which an image is received that a driver sends again [ns]."""
ZSTD = b"\x28\xb5\x2f\xfd"
"""How compressed data begin."""
END_NS = 2**64
"""End of the times of MCAP [ns]. Those before 1970 are stored as if they were after 2262, and rosbags leaves them out
of some files unless they are requested."""
UNREADABLE = re.compile("support|json|proto|ros1|flatbuffer")
"""Words in errors of rosbags about bags that are whole."""
REPAIR = "if it was cut short, repair it with `rosbag reindex` (ROS 1), `ros2 bag reindex` or `mcap recover`"
CONVERT = "convert it to a bag of ROS 2 with messages in CDR, or give the bag that it was made of"


def bag_in(path: Path) -> Path | None:
    """Return what is to be opened: the path of a file or of a ROS 2 folder, or the only bag in a folder; else None."""
    if path.is_file():
        return path if path.suffix in SUFFIXES else None
    if (path / METADATA).is_file():
        return path
    found = [file for file in list_folder(path) if file.suffix in SUFFIXES and file.is_file()]
    return found[0] if len(found) == 1 else None


class BagDataset:
    """The frames of one camera in a bag, or in a folder with one; it is made as `open_dataset` does.

    Args:
        path: A bag, or a folder with one.
        intrinsics: Those of the caller; None for those of `calibration.toml` or of the bag.
        depth_topic: Topic of the depth; None for the only one.
        gray_topic: Topic of the gray or colour image; None for the only one of the same camera.
        within_s: Largest difference of the times of a depth and a gray image of one frame.
        units_per_m: Steps of a metre in the depth; None for what `calibration.toml` or the bag says.
        baseline_m: Baseline in place of that of the intrinsics [m]; None for theirs.

    Raises:
        DatasetError: The bag is damaged, has no or several images of depth or gray of one camera, no camera or several,
            or no two images of one time.
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
        baseline_m: float | None = None,
    ) -> None:
        found = bag_in(path)
        assert found is not None, "nothing is lacking"
        self._path = path
        images = ImageTopics(Bag(found))
        depth = images.depth(depth_topic)
        gray = images.gray(gray_topic, depth)
        self.intrinsics = choose_intrinsics(path, intrinsics, lambda: images.camera(depth, gray), baseline_m)
        self.unit = choose_unit(path, units_per_m, images.unit(depth))
        self._depth, self._gray = Stream(found, depth), Stream(found, gray)
        self._frames = _frames(self._depth, self._gray, within_s)

    @classmethod
    def missing(cls, path: Path) -> str:
        """Return what is missing for a bag, in words; empty if there is one."""
        return "" if bag_in(path) else f"one file {' or '.join(SUFFIXES)}, or metadata.yaml of ROS 2"

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self._frames)

    def assumed(self) -> Iterator[str]:
        """See `Dataset`."""
        if self.unit.convention:
            with self._named(*self._frames[0][1:]):
                yield self.unit.description(values_of(self._depth[self._frames[0][1]]))

    def name(self, index: int) -> str:
        """Return the number of the frame."""
        return f"{range(len(self))[index]:06d}"

    def header(self, index: int) -> Header:
        """Return the time of a frame and the coordinate frame of its depth."""
        stamp_ns, depth, _ = self._frames[index]
        return Header(stamp_ns, self._depth.headers[depth].frame_id)

    def __getitem__(self, index: int) -> Frame:
        """See `Dataset`; a negative index counts from the end."""
        stamp_ns, depth, gray = self._frames[index]
        with self._named(depth, gray):
            images = self._gray[gray], self._depth[depth]
            frame = frame_of(*images, stamp_s=stamp_ns / 1e9, units_per_m=self.unit.units_per_m)
        if frame.depth_m.shape != (shape := self.intrinsics.shape):
            raise DatasetError(
                f"expected {shape[1]}x{shape[0]} pixels in {self._path}, as camera_info or {CALIBRATION} says, got "
                f"{frame.depth_m.shape[1]}x{frame.depth_m.shape[0]}; correct the camera, or choose other topics"
            )
        return frame

    @contextmanager
    def _named(self, depth: int, gray: int) -> Iterator[None]:
        """Name the messages of a frame in an error of the block."""
        try:
            yield
        except FrameError as error:
            where = f"message {depth} of {self._depth.topic} and {gray} of {self._gray.topic} in {self._path}"
            raise DatasetError(f"{where} give no frame: {error}") from error


def _frames(depth: "Stream", gray: "Stream", within_s: float) -> list[tuple[int, int, int]]:
    """Return time [ns] and messages of depth and gray of every frame, in the order of recording."""
    faults: list[str] = []  # Not the errors, which would keep the file open.
    for by_stamp in (True, False):
        try:
            times = depth.times(by_stamp), gray.times(by_stamp)
            origin_ns = times[0][0][0]  # The nanoseconds since 1970 do not fit into a float.
            first, second = ([((t - origin_ns) / 1e9, (t, k)) for t, k in stream] for stream in times)
            pairs = matched(first, second, depth.source, gray.source, within_s=within_s)
        except DatasetError as fault:
            faults.append(str(fault))
            continue
        if faults:
            instead = "the times at which the images were received count in place of all stamps"
            warnings.warn(f"{faults[0]}: {instead}", stacklevel=3)
        return [(*i, j) for _, i, (_, j) in pairs]
    raise DatasetError(f"{faults[0]}. Nor do the times of reception serve: {faults[1]}. Record the images again")


class ImageTopics:
    """Which topics of a bag are depth, gray and camera of one view, by their first messages."""

    def __init__(self, bag: "Bag") -> None:
        self._bag = bag
        self._images = bag.firsts(IMAGE, COMPRESSED)
        self._infos = bag.firsts(CAMERA_INFO)
        self._mismatches: dict[str, str] = {}

    def depth(self, named: str | None) -> str:
        """Return the topic of the depth: the one that is named, or the only one; anything else is a `DatasetError`."""
        topics = self._of_kind(lambda first: encoding_of(first) in DEPTH_ENCODINGS)
        return self._chosen(named, topics, f"depth ({', '.join(DEPTH_ENCODINGS)})", "--depth-topic")

    def gray(self, named: str | None, depth: str) -> str:
        """Return the topic of the gray or colour image: the one that is named, or the only one of the depth's camera.

        One that is named gets a warning if something says that it is of another camera.
        """
        topics = [topic for topic in self._of_kind(_is_gray) if not LABELS.search(topic)]
        self._mismatches = {topic: mismatch for topic in topics if (mismatch := self._mismatch(depth, topic))}
        what = f"the camera of {depth} in gray or colour ({', '.join(GRAY_ENCODINGS)})"
        chosen = self._chosen(named, [topic for topic in topics if topic not in self._mismatches], what, "--gray-topic")
        if chosen in self._mismatches:
            warnings.warn(f"{chosen} of {self._bag.path} is taken although it {self._mismatches[chosen]}", stacklevel=3)
        return chosen

    def camera(self, depth: str, gray: str) -> Intrinsics:
        """Return the camera of the depth, or else of the gray image, by the `camera_info` nearest to it.

        The baseline is that of the bag if it has one.

        Raises:
            DatasetError: There is no `camera_info`, or one of them describes no camera, or several in turn.
        """
        names = dict.fromkeys(name for name in map(self._info, (depth, gray)) if name)
        cameras = [self._constant(name) for name in names]
        if not cameras:
            raise no_camera(f"{self._bag.path} has no camera_info for {depth} or {gray}", self._bag.path)
        return replace(cameras[0], baseline_m=self._baseline_m(depth) or cameras[0].baseline_m)

    def unit(self, topic: str) -> Unit:
        """Return the unit of the depth; the usual one where the bag does not state it."""
        unit_m = self._option(topic, "Depth_Units")
        # The option is a float of 32 bits.
        return Unit(float(f"{1 / unit_m:.6g}")) if unit_m else Unit(convention="ROS has it (REP 118)")

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
        kinds = {topic: getattr(self._images[topic], "encoding", "") or self._images[topic].format for topic in topics}
        mismatches = {topic: f", which {mismatch}" for topic, mismatch in self._mismatches.items()}
        return (
            ", ".join(f"{topic} ({kinds[topic]}{mismatches.get(topic, '')})" for topic in sorted(kinds)) or "no images"
        )

    def _of_kind(self, is_kind: Callable[[Any], bool]) -> list[str]:
        """Return topics of a kind of images, without compressed copies of topics that are there as they are."""
        found = [topic for topic, first in self._images.items() if is_kind(first)]
        return [topic for topic in found if _original(topic) == topic or _original(topic) not in found]

    def _mismatch(self, depth: str, gray: str) -> str:
        """Return what says that a gray image shows another view than the depth, as a clause; empty if nothing does."""
        if any(part in gray for part in RIGHT_INFRARED):
            return "is that of the right camera"
        infos = [self._infos.get(self._info(topic)) for topic in (depth, gray)]
        first, second = map(_lens_of, infos)
        if first is not None and second is not None and not first.is_same_camera(second):
            return "has another lens or size by its camera_info"
        is_rectified = "rect" in _original(gray).rsplit("/", 1)[-1]
        if not is_rectified and is_distorted(infos[1]) and ALIGNED not in depth:
            return "is distorted by its camera_info, and not rectified by its name; image_proc rectifies"
        if are_apart(self._images[depth], self._images[gray]):
            ids = (self._images[topic].header.frame_id for topic in (gray, depth))
            return "is in the coordinate frame {!r}, and the depth in {!r}".format(*ids)
        return ""

    def _info(self, topic: str) -> str:
        """Return the `camera_info` that shares most of its path with an image, or has its coordinate frame; "" without.

        One that lies elsewhere and names another coordinate frame is of another camera.
        """
        image = self._images[topic]
        shared = {name: _n_shared(name, topic) for name in self._infos}
        nearest = [name for name, n in shared.items() if n == max(shared.values())]
        if len(nearest) > 1:
            nearest = [name for name in nearest if self._infos[name].header.frame_id == image.header.frame_id]
        fitting = [x for x in nearest if _folder(x) == _folder(topic) or not are_apart(image, self._infos[x])]
        return fitting[0] if len(nearest) == len(fitting) == 1 else ""

    def _constant(self, name: str) -> Intrinsics:
        """Return the camera of a `camera_info`, which must be the same in all messages."""
        first = None
        for number, (_, info) in enumerate(self._bag.messages(name)):
            where = f"message {number} of {name} in {self._bag.path}, at {header_of(info).stamp_ns / 1e9:.6f} s,"
            try:
                lens = Intrinsics.from_camera_info(info)
            except FrameError as error:
                raise DatasetError(f"{where} describes no camera: {error}") from error
            first = first or lens
            if not first.is_same_camera(lens):
                raise DatasetError(
                    f"{where} describes another camera than before, {lens} after {first}: cut the bag there, or state "
                    f"the camera of all images in {calibration_path(self._bag.path)}"
                )
        assert first is not None, "it was found by its first message"
        return first

    def _baseline_m(self, topic: str) -> float | None:
        """Return the baseline of the sensor, or of the only stereo pair whose topics are beside those of the image."""
        in_mm = self._option(topic, "Stereo_Baseline")
        if in_mm:
            return in_mm / 1000
        beside = _folder(_folder(_original(topic))) + "/"
        lenses = [_lens_of(info) for name, info in self._infos.items() if name.startswith(beside)]
        found = [lens.baseline_m for lens in lenses if lens is not None and lens.baseline_m is not None]
        return found[0] if found and np.allclose(found, found[0], rtol=SAME_LENS) else None

    def _option(self, topic: str, name: str) -> float | None:
        """Return the value of an option of the sensor of a topic, which files of librealsense have."""
        sensor = SENSOR.match(topic)
        message = self._bag.first(f"{sensor[0]}/option/{name}/value") if sensor else None
        try:
            return None if message is None else float(message.data)
        except ValueError as error:
            raise DatasetError(f"expected a number as {name} of {topic} in {self._bag.path}: {error}") from error


def _is_gray(first: Any) -> bool:
    """Return whether an image has 8 bits; a compressed one that does not say its encoding has."""
    return encoding_of(first) in GRAY_ENCODINGS or not (hasattr(first, "encoding") or encoding_of(first))


def _lens_of(info: Any) -> Intrinsics | None:
    """Return the camera of a `camera_info`, with a baseline if it is a pair's right one; None without one."""
    with suppress(FrameError):
        return None if info is None else Intrinsics.from_camera_info(info)
    return None


def _original(topic: str) -> str:
    """Return the topic whose images a topic of compressed images has."""
    return COPIES.sub("", topic)


def _folder(topic: str) -> str:
    """Return the part of a topic that the image and the `camera_info` of one camera share."""
    return topic.rsplit("/", 1)[0]


def _n_shared(first: str, second: str) -> int:
    """Return the number of parts that two topics have in common from the beginning on."""
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
            kinds = {getattr(each.ext, "serialization_format", "cdr") for each in self._reader.connections} - {"cdr"}
            if kinds:
                raise ValueError(f"messages in {', '.join(kinds)} are not supported")
        weakref.finalize(self, self._reader.close)

    def first(self, topic: str) -> Any:
        """Return the first message of a topic, or None where it has none."""
        return next((message for _, message in self.messages(topic)), None)

    def firsts(self, *kinds: str) -> dict[str, Any]:
        """Return the first messages of all topics of some types that have one."""
        topics = [connection.topic for connection in self._reader.connections if connection.msgtype in kinds]
        return {topic: message for topic in topics if (message := self.first(topic)) is not None}

    def recorded(self, topic: str) -> list[int]:
        """Return the numbers of the messages of a topic, as `messages` gives them, in the order of recording.

        It gives them by file and time, which is another order where a clock was set back.
        """
        reader: Any = self._reader.readers[0]
        connections = self._connections(topic)
        with _bag_errors(self.path):
            if self._reader.is2:
                parts = enumerate(_storages(self._reader))
                times = [(number, time_ns) for number, part in parts for time_ns in _stored_ns(part, topic)]
            else:
                # An entry is time, chunk and offset: by the latter two, messages lie as they were written.
                index = sorted(e[1:] + e[:1] for each in connections for e in reader.indexes[each.id])
                times = [(0, time_ns) for *_, time_ns in index]
        # `read` lists the messages as they are read; the argsort of an argsort is the place of each in that list.
        read = sorted(range(len(times)), key=times.__getitem__)
        return sorted(read, key=read.__getitem__)

    def messages(self, topic: str, start_ns: int | None = None) -> Iterator[tuple[int, Any]]:
        """Yield when each message of a topic was received [ns], and the message."""
        connections = self._connections(topic)
        if not connections:
            return
        is_sqlite = self._reader.is2 and hasattr(_storages(self._reader)[0], "dbconn")
        with _bag_errors(self.path):
            end_ns = None if is_sqlite else END_NS
            for connection, received_ns, data in self._reader.messages(connections, start_ns, end_ns):
                message = _deserialised(self._reader, data, connection.msgtype)
                _require_fields(message, connection.msgtype)
                yield received_ns, message

    def _connections(self, topic: str) -> list["Connection"]:
        return [connection for connection in self._reader.connections if connection.topic == topic]


class Stream:
    """The messages of one topic, in the order in which they are read.

    All of them are read once, so that a damaged file is found before anything is made of it. They are read forwards by
    a reader of their own, since some files have no index by which a message could be found.
    """

    def __init__(self, path: Path, topic: str) -> None:
        self.topic, self.source = topic, f"{topic} of {path}"
        self._bag = Bag(path)
        self.received_ns: list[int] = []
        self.headers: list[Header] = []
        repeats = set()
        before: tuple[int, Any] | None = None
        for number, read in enumerate(self._bag.messages(topic)):
            self.received_ns.append(read[0])
            self.headers.append(header_of(read[1]))
            if before is not None and _is_repeat(*before, *read):
                repeats.add(number)
            before = None if number in repeats else read
        recorded = self._bag.recorded(topic)
        if len(recorded) != len(self.headers) or self.received_ns != sorted(self.received_ns):
            raise DatasetError(
                f"expected {self.source} to be indexed by the times of its {len(recorded)} messages, got "
                f"{len(self.headers)}, or others; {REPAIR}"
            )
        self._recorded = [number for number in recorded if number not in repeats]
        self._next, self._later = 0, self._bag.messages(topic)

    def times(self, by_stamp: bool) -> list[tuple[int, int]]:
        """Return time [ns] and number of each message in the order of recording: its stamp, or when it was received.

        Raises:
            DatasetError: The times do not increase.
        """
        times_ns = [header.stamp_ns for header in self.headers] if by_stamp else [*map(_signed, self.received_ns)]
        for before, number in pairwise(self._recorded):
            if times_ns[number] <= times_ns[before]:
                what = "stamps" if by_stamp else "times of reception"
                before_s, after_s = (f"{times_ns[each] / 1e9:.6f} s of message {each}" for each in (before, number))
                raise DatasetError(f"expected {what} of {self.source} that increase, got {after_s} after {before_s}")
        return [(times_ns[number], number) for number in self._recorded]

    def __getitem__(self, number: int) -> Any:
        """Read one message, quickly if it is one after that before."""
        if number < self._next:
            start_ns = min(self.received_ns[number:])
            self._next = number - sum(time_ns >= start_ns for time_ns in self.received_ns[:number])
            self._later = self._bag.messages(self.topic, start_ns)
        for _, message in self._later:
            self._next += 1
            if self._next > number:
                return message
        raise DatasetError(f"expected {len(self.headers)} messages in {self.source}, got {self._next}")


def _is_repeat(before_ns: int, before: Any, received_ns: int, message: Any) -> bool:
    """Return whether an image is that before, which drivers send again at once now and then."""
    is_of_its_time = received_ns - before_ns < AT_ONCE_NS and header_of(before) == header_of(message)
    return is_of_its_time and np.array_equal(before.data, message.data)


def _stored_ns(storage: Any, topic: str) -> list[int]:
    """Return when the messages of a topic in a file of ROS 2 were received [ns], as they lie in the file."""
    if hasattr(storage, "dbconn"):
        query = "SELECT timestamp FROM messages JOIN topics ON topic_id = topics.id WHERE name = ? ORDER BY messages.id"
        return [time_ns for (time_ns,) in storage.dbconn.execute(query, (topic,))]
    connections = [connection for connection in storage.connections if connection.topic == topic]
    return [time_ns for _, time_ns, _ in storage.messages_scan(connections, stop=END_NS)]


def _storages(reader: "AnyReader") -> list[Any]:
    """Return the files of a bag of ROS 2."""
    storage: Any = reader.readers[0].storage  # type: ignore[union-attr]
    return list(getattr(storage, "storages", [storage]))


def _signed(time_ns: int) -> int:
    """Return a time [ns] that was stored unsigned."""
    return time_ns - END_NS if time_ns >= END_NS // 2 else time_ns


def _require_fields(message: Any, kind: str) -> None:
    """Raise an `AttributeError` for a message whose definition in the bag lacks what is read of its kind."""
    if kind in FIELDS:
        header_of(message)
        for name in FIELDS[kind]:
            getattr(message, name)


def _deserialised(reader: "AnyReader", data: bytes, kind: str) -> Any:
    from rosbags.highlevel import AnyReaderError

    if reader.is2 and data.startswith(ZSTD):  # rosbags decompresses the messages of a folder alone.
        from ..zstandard import zstd

        data = zstd.decompress(data)
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
        if "Profile" in reason:
            reason = f"its profile is {_profile(path)!r}, and that of ROS 2 alone is supported"
        remedy = CONVERT if UNREADABLE.search(reason) else REPAIR
        raise DatasetError(f"cannot read the bag {path} ({reason}); {remedy}") from error


def _profile(path: Path) -> str:
    """Return the profile in the header of an MCAP file, or of one in a folder."""
    with (next(path.glob("*.mcap")) if path.is_dir() else path).open("rb") as file:
        header = file.read(64)
    return header[21 : 21 + int.from_bytes(header[17:21], "little")].decode(errors="replace")
