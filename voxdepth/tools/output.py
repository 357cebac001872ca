"""What a correction writes: a folder of images, perhaps with clouds of points, or an MCAP file of ROS 2."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Protocol

import cv2
import numpy.typing as npt

from ..datasets import Dataset
from ..ros import (
    TIMES_S,
    Header,
    camera_info_fields,
    confidence_fields,
    confidence_levels,
    depth_fields,
    gray_fields,
    source_fields,
)
from ..types import CorrectedDepth, Frame
from ..units import to_millimetres
from .errors import ToolError
from .picture import before_and_after
from .point_cloud import ply

if TYPE_CHECKING:
    from rosbags.rosbag2 import Writer

CONFIG, FRAMES, REPORT = "config.toml", "frames.csv", "report.json"
"""Texts about a correction: what it depends on, one row for each frame, and their summary."""
PICTURE = "picture.png"
"""The last frame, before and after."""
DEPTH, CONFIDENCE = "depth", "confidence"
"""Sub-folders with one PNG of every frame."""
Encoder = Callable[[Frame, CorrectedDepth], bytes]
"""Makes the content of a file of a frame and its correction."""
IMAGES: Mapping[str, Encoder] = {
    f"{DEPTH}/{{}}.png": lambda frame, corrected: encode(to_millimetres(corrected.depth_m)),
    f"{CONFIDENCE}/{{}}.png": lambda frame, corrected: encode(confidence_levels(corrected.confidence)),
    "source/{}.png": lambda frame, corrected: encode(corrected.source),
}
"""Files of every frame in a folder, by their path with {} for the name of the frame."""
POINTS = "points/{}.ply"
MCAP = ".mcap"
TOPICS = "/voxdepth"
"""Where the topics of a bag begin."""
BAG_VERSION: Final = 8
"""Version of the metadata of a bag, the oldest that rosbags writes."""


class Output(Protocol):
    """Where a correction goes."""

    def add(self, index: int, frame: Frame, corrected: CorrectedDepth) -> None:
        """Write a frame and its correction."""

    def describe(self, texts: Mapping[str, str]) -> None:
        """Write the texts about the correction, by name, after all frames."""


class Folder:
    """Files of every frame, and the texts as files."""

    def __init__(self, folder: Path, dataset: Dataset, files: Mapping[str, Encoder]) -> None:
        self._folder, self._dataset, self._files = folder, dataset, files
        self._newest: tuple[Frame, CorrectedDepth] | None = None
        for path in files:
            (folder / path).parent.mkdir(parents=True)

    def add(self, index: int, frame: Frame, corrected: CorrectedDepth) -> None:
        """See `Output`."""
        for path, encoder in self._files.items():
            (self._folder / path.format(self._dataset.name(index))).write_bytes(encoder(frame, corrected))
        self._newest = frame, corrected

    def describe(self, texts: Mapping[str, str]) -> None:
        """See `Output`."""
        for name, text in texts.items():
            (self._folder / name).write_text(text, encoding="utf-8")
        if self._newest is not None:
            (self._folder / PICTURE).write_bytes(encode(before_and_after(*self._newest), level=9))


class BagTopics:
    """Topics of the gray image, depth, source, confidence and camera in a bag, with the headers of the dataset."""

    def __init__(self, writer: "Writer", dataset: Dataset) -> None:
        from rosbags.typesys import Stores, get_typestore

        self._writer, self._dataset, self._store = writer, dataset, get_typestore(Stores.ROS2_JAZZY)
        for index, header in enumerate(map(dataset.header, range(len(dataset)))):
            if header.stamp_ns // 10**9 not in TIMES_S:
                raise ToolError(
                    f"expected times of 0 to {TIMES_S.stop} s for a bag of ROS 2, got {header.stamp_ns / 1e9} s of "
                    f"frame {dataset.name(index)}: write images (--out FOLDER), or correct the times of the input"
                )
        self._camera_info = camera_info_fields(dataset.intrinsics) | {
            "binning_x": 0,
            "binning_y": 0,
            "roi": self._message("RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False),
        }
        kinds = dict.fromkeys(("gray", "depth", "source", "confidence"), "Image") | {"camera_info": "CameraInfo"}
        self._connections = {
            name: writer.add_connection(f"{TOPICS}/{name}", f"sensor_msgs/msg/{kind}", typestore=self._store)
            for name, kind in kinds.items()
        }

    def add(self, index: int, frame: Frame, corrected: CorrectedDepth) -> None:
        """See `Output`."""
        header = self._dataset.header(index)
        self._write("camera_info", header, "CameraInfo", self._camera_info)
        self._write("gray", header, "Image", gray_fields(frame.gray))
        self._write("depth", header, "Image", depth_fields(corrected.depth_m))
        self._write("source", header, "Image", source_fields(corrected.source))
        self._write("confidence", header, "Image", confidence_fields(corrected.confidence))

    def describe(self, texts: Mapping[str, str]) -> None:
        """Write the texts but that of the frames into the metadata: a reader loads all of those."""
        for name in (CONFIG, REPORT):
            self._writer.set_custom_data(name, texts[name])

    def _write(self, name: str, header: Header, kind: str, fields: Mapping[str, Any]) -> None:
        seconds, nanoseconds = divmod(header.stamp_ns, 10**9)
        stamp = self._store.types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds)
        written = self._store.types["std_msgs/msg/Header"](stamp=stamp, frame_id=header.frame_id)
        data = self._store.serialize_cdr(self._message(kind, header=written, **fields), f"sensor_msgs/msg/{kind}")
        self._writer.write(self._connections[name], header.stamp_ns, data)

    def _message(self, kind: str, **fields: Any) -> Any:
        return self._store.types[f"sensor_msgs/msg/{kind}"](**fields)


@contextmanager
def open_output(path: Path, dataset: Dataset, *, has_points: bool = False) -> Iterator[Output]:
    """Open a folder of images, or an MCAP file that ROS 2 plays, by its name; it is whole when the block ends.

    Nothing is at the path or, for a file, in its folder, where rosbags writes a whole bag first. A folder has a cloud
    of points of every frame, too, if `has_points`.
    """
    if path.suffix != MCAP:
        points = {POINTS: partial(ply, dataset.intrinsics)} if has_points else {}
        yield Folder(path, dataset, {**IMAGES, **points})
        return
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

    from ..zstandard import zstd

    bag = path.with_suffix("")
    writer = Writer(bag, version=BAG_VERSION, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with writer:
        storage: Any = writer.storage  # rosbags leaves out the checksum of MCAP: that of Zstandard is as good.
        storage.compressor = partial(zstd.compress, options={zstd.CompressionParameter.checksum_flag: 1})
        yield BagTopics(writer, dataset)
    (bag / f"{bag.name}{MCAP}").rename(path)


def encode(image: npt.NDArray[Any], level: int = 1) -> bytes:
    """Encode a PNG, level 1 (fast) to 9 (small); without row filters, quantised depth is smaller than by default."""
    options = (cv2.IMWRITE_PNG_COMPRESSION, level, cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_NONE)
    return cv2.imencode(".png", image, options)[1].tobytes()
