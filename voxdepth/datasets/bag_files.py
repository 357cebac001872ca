"""The messages of a bag: RealSense and ROS 1 (`.bag`), ROS 2 (a folder, `.db3` or `.mcap`).

Every topic is read by a reader of its own, forwards, since some files have no index by which a message could be found.
"""

import weakref
from bisect import bisect_left
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import DatasetError
from ..ros import Header, header_of
from .files import list_folder

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader

SUFFIXES = (".bag", ".db3", ".mcap")
METADATA = "metadata.yaml"
"""File that describes a folder of ROS 2."""
UNIT_BYTES = 4
"""librealsense appends a float, the unit of depth, to images of ROS 1, which the definition of the message lacks."""
IMAGE, COMPRESSED, CAMERA_INFO = (f"sensor_msgs/msg/{name}" for name in ("Image", "CompressedImage", "CameraInfo"))


def bag_in(path: Path) -> Path | None:
    """Return what is to be opened: the path of a file or of a ROS 2 folder, or the only bag in a folder; else None."""
    if path.is_file():
        return path if path.suffix in SUFFIXES else None
    if (path / METADATA).is_file():
        return path
    found = [file for file in list_folder(path) if file.suffix in SUFFIXES and file.is_file()]
    return found[0] if len(found) == 1 else None


class Bag:
    """The topics of a bag, and their first messages.

    Raises:
        DatasetError: The bag is damaged, or cannot be read for another reason.
        ModuleNotFoundError: The package `rosbags` is not installed.
    """

    def __init__(self, path: Path) -> None:
        self.path, self._reader = path, _open(path)
        weakref.finalize(self, self._reader.close)
        self.topics = {connection.topic: connection.msgtype for connection in self._reader.connections}
        """Type of the messages by topic."""

    def first(self, topic: str) -> Any:
        """Return the first message of a topic, or None where it has none."""
        messages = _messages(self._reader, self.path, topic) if topic in self.topics else iter(())
        return next((message for _, message in messages), None)

    def stream(self, topic: str) -> "Stream":
        """Return all messages of a topic."""
        return Stream(self.path, topic)


class Stream:
    """The messages of one topic, in the order in which they were received.

    All of them are read once, so that a damaged file is found before anything is made of it.
    """

    def __init__(self, path: Path, topic: str) -> None:
        self.topic, self._path = topic, path
        self._reader = _open(path)
        weakref.finalize(self, self._reader.close)
        self.received_ns: list[int] = []
        self.headers: list[Header] = []
        for received_ns, message in _messages(self._reader, path, topic):
            self.received_ns.append(received_ns)
            self.headers.append(header_of(message))
        self._next, self._later = 0, _messages(self._reader, path, topic)

    def __len__(self) -> int:
        return len(self.headers)

    def __getitem__(self, index: int) -> Any:
        """Read one message, quickly if it is one after that before."""
        if index < self._next:
            start_ns = self.received_ns[index]
            self._next = bisect_left(self.received_ns, start_ns)
            self._later = _messages(self._reader, self._path, self.topic, start_ns)
        for _, message in self._later:
            self._next += 1
            if self._next > index:
                return message
        raise DatasetError(f"expected {len(self)} messages of {self.topic} in {self._path}, got {self._next}")


def _open(path: Path) -> "AnyReader":
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    for part in list_folder(path):
        if part.exists() and not (part.is_file() or part.is_dir()):  # To open a pipe would wait for its writer.
            raise DatasetError(f"expected files in the bag {path}, got something else in {part}; restore it")
    with _bag_errors(path):
        # Definitions in the bag count before those of this store: some bags of ROS 2 have none.
        reader = AnyReader([path], default_typestore=get_typestore(Stores.LATEST))
        reader.open()
    return reader


def _messages(reader: "AnyReader", path: Path, topic: str, start_ns: int | None = None) -> Iterator[tuple[int, Any]]:
    """Yield when each message of a topic was received [ns], and the message."""
    connections = [connection for connection in reader.connections if connection.topic == topic]
    with _bag_errors(path):
        for connection, received_ns, data in reader.messages(connections, start=start_ns):
            yield received_ns, _deserialised(reader, data, connection.msgtype)


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
