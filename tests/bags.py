"""Bags for tests: messages of ROS 1 and ROS 2, and files of every kind with them."""

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any, NamedTuple

import numpy as np
from rosbags import rosbag1, rosbag2
from rosbags.serde import cdr, ros1
from rosbags.typesys import Stores, get_typestore

from voxdepth.ros import camera_info_fields
from voxdepth.types import Intrinsics

ROS1, ROS2 = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_HUMBLE)
S = 10**9
FLOAT32 = "std_msgs/msg/Float32"


@cache
def _code(text: str) -> CodeType:
    return compile(text, "<rosbags>", "exec")


def _module(lines: list[str]) -> ModuleType:
    """A module of generated lines; rosbags compiles them for every file, most of the time that a small one takes."""
    module = ModuleType("generated")
    exec(_code("\n".join(lines)), module.__dict__)
    return module


cdr.compile_lines = ros1.compile_lines = _module


class Entry(NamedTuple):
    """A message of a bag, as its type and fields; `tail` are bytes after it."""

    topic: str
    received_ns: int
    kind: str
    fields: dict[str, Any]
    tail: bytes = b""


def message(kind: str, fields: dict[str, Any], store: Any = ROS2) -> Any:
    """A message of a kind; a header is (stamp in ns, frame_id)."""
    names = [name for name, _ in store.fielddefs[kind][1]]
    values = {name if name in names else name.upper(): value for name, value in fields.items()}
    if isinstance(values.get("header"), tuple):
        stamp_ns, frame_id = values["header"]
        time = store.types["builtin_interfaces/msg/Time"](sec=stamp_ns // S, nanosec=stamp_ns % S)
        sequence = {"seq": 7} if store is ROS1 else {}
        values["header"] = store.types["std_msgs/msg/Header"](stamp=time, frame_id=frame_id, **sequence)
    if kind.endswith("CameraInfo"):
        roi = store.types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
        values = {"binning_x": 0, "binning_y": 0, "roi": roi} | values
    return store.types[kind](**values)


def image(pixels: np.ndarray, encoding: str, header: tuple[int, str] = (S, "left"), *, padding: int = 0) -> dict:
    """Fields of an Image; the byte order is that of the array, and `padding` bytes of 171 end each row."""
    height, width = pixels.shape[:2]
    rows = np.frombuffer(pixels.tobytes(), np.uint8).reshape(height, -1)
    data = np.pad(rows, ((0, 0), (0, padding)), constant_values=171)
    return {
        "header": header, "height": height, "width": width, "encoding": encoding,
        "is_bigendian": int(pixels.dtype.byteorder == ">"), "step": data.shape[1], "data": data.ravel(),
    }  # fmt: skip


def compressed(data: bytes, format: str, header: tuple[int, str] = (S, "left")) -> dict:
    """Fields of a CompressedImage."""
    return {"header": header, "format": format, "data": np.frombuffer(data, np.uint8)}


def camera_info(camera: Intrinsics, header: tuple[int, str] = (S, "left"), *, baseline_m: float = 0.0) -> dict:
    """Fields of a CameraInfo; with a baseline, that of the right camera."""
    fields = camera_info_fields(camera) | {"header": header}
    fields["p"][3] = -camera.fx_px * baseline_m
    return fields


def images(topic: str, frames: Sequence[dict], kind: str = "Image") -> list[Entry]:
    """The messages of a topic, each received 5 ms after its stamp."""
    return [Entry(topic, fields["header"][0] + S // 200, f"sensor_msgs/msg/{kind}", fields) for fields in frames]


def in_order(entries: Sequence[Entry]) -> list[Entry]:
    """The messages in the order of their reception."""
    return sorted(entries, key=lambda entry: entry.received_ns)


def write_bag(path: Path, ordered: Sequence[Entry], compression: str = "none") -> Path:
    """Write messages, in their order, into a bag of the kind of the suffix; without one into a folder of ROS 2.

    The storage of a folder is the last word of its name: `walk-mcap`, or else SQLite.
    """
    if path.suffix == ".bag":
        with rosbag1.Writer(path) as writer:
            _write(writer, ordered, ROS1)
        return path
    storage = "mcap" if path.name.endswith("mcap") else "sqlite3"
    folder = path.parent / path.stem
    writer = rosbag2.Writer(folder, version=8, storage_plugin=rosbag2.StoragePlugin[storage.upper()])
    if compression != "none":
        writer.set_compression(rosbag2.CompressionMode[compression.upper()], rosbag2.CompressionFormat.ZSTD)
    with writer:
        _write(writer, ordered, ROS2)
    if path.suffix:
        (folder / path.name).rename(path)
        (folder / "metadata.yaml").unlink()
        folder.rmdir()
    return path


def _write(writer: Any, entries: Sequence[Entry], store: Any) -> None:
    connections: dict[str, Any] = {}
    for entry in entries:
        if entry.topic not in connections:
            connections[entry.topic] = writer.add_connection(entry.topic, entry.kind, typestore=store)
        made = message(entry.kind, entry.fields, store)
        data = store.serialize_ros1(made, entry.kind) if store is ROS1 else store.serialize_cdr(made, entry.kind)
        writer.write(connections[entry.topic], entry.received_ns, bytes(data) + entry.tail)
